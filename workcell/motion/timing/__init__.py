"""Time along a path: within limits on velocity, acceleration and torque."""
