"""Joint angles from points: base to tips, each by least squares over all directions of the link that it moves."""

from __future__ import annotations

import numpy as np

from workcell.ik.cidgik_relaxation import Instance
from workcell.pose import Array, axis_angle_to_matrix


def joint_angles(instance: Instance, X: Array) -> Array:
    """(n,) angles in (-pi, pi] of the configuration with basis X (r, d); a posed link's directions are the goal's."""
    structure = instance.structure
    skeleton, reduction = structure.skeleton, structure.reduction
    robot, d = skeleton.robot, skeleton.dimension
    columns = np.vstack([X, np.eye(d)])
    rotation = np.empty((robot.dof + 1, 3, 3))
    rotation[0] = np.eye(3)
    q = np.zeros(robot.dof)
    for joint in range(robot.dof):
        before = rotation[int(robot.parents[joint])] @ robot.joint_rotation[joint]
        world = reduction.directions[joint + 1].at(instance.G) @ columns @ skeleton.plane
        q[joint] = _angle(robot.axis[joint], skeleton.basis[joint + 1], before.T @ world.T)
        rotation[joint + 1] = before @ axis_angle_to_matrix(robot.axis[joint], q[joint])
    return q


def _angle(axis: Array, zero: Array, turned: Array) -> float:
    """Angle about `axis` that best takes directions zero (3, s) to turned (3, s)."""
    sine = float(np.sum(axis[:, None] * np.cross(zero, turned, axis=0)))
    cosine = float(np.sum(zero * turned) - (axis @ zero) @ (axis @ turned))
    return float(np.arctan2(sine, cosine))
