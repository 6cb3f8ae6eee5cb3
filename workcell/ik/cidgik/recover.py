"""Joint angles from points: base to tips, each by least squares over all directions of the link that it moves."""

from __future__ import annotations

import math
from collections.abc import Mapping

import numpy as np

from workcell.identity_cache import ByIdentity
from workcell.ik.cidgik.skeleton import Skeleton
from workcell.pose import Array

_tables = ByIdentity()


def joint_angles(skeleton: Skeleton, directions: Mapping[int, Array]) -> Array:
    """(n,) angles in (-pi, pi] of the configuration whose links have basis directions (s, d), seen from the base.

    Joint by joint, with the link before known, the angle about the axis z that best takes the link's directions b0 at
    angle zero to the found ones b: atan2(sum z . (b0 x b), sum of products across the axis). A posed link's directions
    are the goal's, so the last angle is read off the goal frame.
    """
    robot = skeleton.robot
    rotation = np.empty((robot.dof + 1, 3, 3))
    rotation[0] = np.eye(3)
    q = np.zeros(robot.dof)
    tables: list[tuple[Array, ...]] = _tables.get((skeleton,), lambda: _per_joint(skeleton))
    for joint, (across, side, K, squared) in enumerate(tables):
        before = rotation[int(robot.parents[joint])] @ robot.joint_rotation[joint]
        turned = before.T @ (directions[joint + 1] @ skeleton.plane).T
        q[joint] = math.atan2(float((side * turned).sum()), float((across * turned).sum()))
        rotation[joint + 1] = before @ (
            np.eye(3) + math.sin(q[joint]) * K + (1.0 - math.cos(q[joint])) * squared
        )
    return q


def nearest_turn(q: Array, middle: Array) -> Array:
    """Angles (n,) moved by whole turns to be as near as can be to the middles (n,) of their intervals."""
    nearest: Array = q - 2 * np.pi * np.round((q - middle) / (2 * np.pi))
    return nearest


def _per_joint(skeleton: Skeleton) -> list[tuple[Array, ...]]:
    """For each joint: its link's directions without the part along the axis, z x them, and [z]x and its square."""
    tables: list[tuple[Array, ...]] = []
    for joint in range(skeleton.robot.dof):
        z = skeleton.robot.axis[joint]
        K = np.array([[0.0, -z[2], z[1]], [z[2], 0.0, -z[0]], [-z[1], z[0], 0.0]])
        zero = skeleton.basis[joint + 1]
        tables.append((-K @ K @ zero, K @ zero, K, K @ K))
    return tables
