"""Bring an arm's tool to a pose, and print the answer: a configuration that an independent check accepted.

An answer is only called SOLVED once a judge that shares no code with the solvers has found the tool where it should be,
within the joint limits.
"""

import numpy as np

from workcell import Budget, IKProblem, Pose, load_robot, solve

robot = load_robot("ur10")  # or the path of an MJCF or URDF file
target = Pose(
    [0.6, 0.2, 0.5], [0.0, 1.0, 0.0, 0.0]
)  # metres in the world; quaternion w, x, y, z: pointing down

result = solve(IKProblem(robot, target), budget=Budget(2.0), seed=0)  # seconds of CPU time
print(f"{result.status.value} by {result.solver}: {result.status.sentence}")
for joint, angle in zip(robot.joint_names, result.unwrap(), strict=True):
    print(f"  {joint:22} {np.rad2deg(angle):8.2f} degrees")
print(f"off the target by {1e6 * result.position_error:.3f} um and {1e6 * result.rotation_error:.3f} urad")

reached = robot.fk(result.q)  # where the configuration has the tool
print(f"the tool is at {np.round(reached.position, 4)}")
