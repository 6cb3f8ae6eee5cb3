"""Robots and scenes: what is simulated, and the kinematics that the solvers see."""
