"""The posture of a serial arm: on which side of shoulder, elbow and wrist singularities a configuration lies.

Two configurations of different posture can't be joined without passing such a singularity, so a set of solutions
that covers several postures is diverse where it matters: some of them go around what blocks the others.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import ArrayLike

from workcell.identity_cache import ByIdentity
from workcell.model.robot import Robot
from workcell.pose import Array

FLAT = 1e-6
"""Below this (a sine, or square metres a radian) a sign means nothing, and the posture says 0."""
_SAMPLES = 16

_elbows = ByIdentity()


class Posture(NamedTuple):
    """Signs, -1 or 1; 0 at the singularity itself, and for arms that have no such joint.

    Attributes:
        shoulder: of z_1 . (z_2 x z_3); where the second and third axes are parallel, on which side of the plane of the
            first two axes the wrist is.
        elbow: whether the elbow's turning takes the wrist away from the shoulder or towards it.
        wrist: of z_{n-2} . (z_{n-1} x z_n), the last three axes.
    """

    shoulder: int
    elbow: int
    wrist: int


def posture(robot: Robot, q: ArrayLike) -> Posture:
    """The posture of a serial robot at q (n,).

    Raises:
        InputError: a configuration of the wrong size, or not finite.
    """
    values = robot.configuration(np.asarray(q, dtype=float))
    if robot.joint_count < 3:
        return Posture(0, 0, 0)
    z, p, shoulder, wrist = _lines(robot, values)
    elbow = _elbows.get((robot,), lambda: _elbow_joint(robot))
    side = float(z[0] @ np.cross(z[1], z[2]))
    if np.linalg.norm(np.cross(robot.joint_rotation[2] @ robot.axis[2], robot.axis[1])) < FLAT:
        side = float((wrist - p[0]) @ np.cross(z[0], z[1]))
    away = 0.0 if elbow < 0 else _stretching(z, p, shoulder, wrist, elbow)
    return Posture(_sign(side), _sign(away), _sign(float(z[-3] @ np.cross(z[-2], z[-1]))))


def _lines(robot: Robot, q: Array) -> tuple[Array, Array, Array, Array]:
    """Axes (n, 3), points on them (n, 3), and the points where the first two and the last two come closest."""
    T = robot.link_transforms(q)[1:]
    z, p = (T[:, :3, :3] @ robot.axis[:, :, None])[..., 0], T[:, :3, 3]
    return z, p, _nearest(p[1], z[1], p[0], z[0]), _nearest(p[-2], z[-2], p[-1], z[-1])


def _nearest(point: Array, axis: Array, other: Array, direction: Array) -> Array:
    """The point of a line that is nearest to another line; of parallel ones, the given point."""
    across = np.cross(axis, direction)
    square = float(across @ across)
    if square < FLAT:
        return point
    nearest: Array = point + axis * float(np.cross(other - point, direction) @ across) / square
    return nearest


def _stretching(z: Array, p: Array, shoulder: Array, wrist: Array, joint: int) -> float:
    """Derivative of half the squared distance from shoulder to wrist when a revolute joint turns."""
    return float((wrist - shoulder) @ np.cross(z[joint], wrist - p[joint]))


def _elbow_joint(robot: Robot) -> int:
    """The inner joint that changes the distance from shoulder to wrist most; -1 where none does."""
    rng = np.random.default_rng(0)
    effect = np.zeros(robot.joint_count)
    for q in robot.random_configuration(rng, _SAMPLES):
        lines = _lines(robot, q)
        for joint in range(1, robot.joint_count - 1):
            if not robot.prismatic[joint]:
                effect[joint] += abs(_stretching(*lines, joint))
    return int(effect.argmax()) if effect.max() > FLAT else -1


def _sign(value: float) -> int:
    return 0 if abs(value) < FLAT else (1 if value > 0 else -1)
