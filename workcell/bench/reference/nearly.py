"""Arms whose axes are nearly parallel, nearly meet or are nearly at right angles, as files have them."""

from __future__ import annotations

import numpy as np

from workcell.ik.problem import IKProblem
from workcell.model.robot import Robot
from workcell.model.serial import serial_robot
from workcell.pose import Array, Pose, axis_angle_to_matrix, matrix_to_quat

WRITTEN = {
    np.pi / 2: ("1.57", "1.571", "1.5708", "1.570796", "1.5707963268"),
    np.pi: ("3.14", "3.142", "3.1416", "3.141593", "3.1415926536"),
}
"""How people write right angles and half turns."""

X, Y, Z = np.eye(3)
_PATTERNS = (
    "zyyyzy",
    "zyzyzyz",
    "zzyyzy",
    "zyzyyy",
    "zzzyzx",
    "zyyzxx",
    "zyzxzz",
    "zxxyxy",
    "zyyyzyy",
    "xxyzzy",
)
"""Directions of the axes at zero: neighbours are parallel or at right angles."""


def written_arm(rng: np.random.Generator, digits: int | None = None) -> Robot:
    """An arm of a URDF: all axes z, frames turned by right angles and half turns that are written in few digits."""
    digits = int(rng.integers(len(WRITTEN[np.pi]))) if digits is None else digits
    joints, rotation, before = [], np.eye(3), ""
    for k, letter in enumerate(rng.choice(_PATTERNS)):
        wanted = {"x": X, "y": Y, "z": Z}[letter] * rng.choice([-1.0, 1.0])
        rpy = _rpy_to(rotation.T @ wanted, rng)
        rotation = rotation @ _matrix(rpy)
        turned = _matrix([_written(angle, digits) for angle in rpy])
        joints.append(_joint(k, _offset(rng, letter == before), turned, Z, rng))
        before = letter
    tool = Pose(np.array([0.0, 0.0, rng.uniform(0.05, 0.2)]), np.array([1.0, 0.0, 0.0, 0.0]))
    return serial_robot("written", joints, tool)


def nearly_arm(rng: np.random.Generator, least: float = 1e-12, most: float = 1e-2) -> Robot:
    """An arm of parallel, meeting and orthogonal axes, some of which are off by `least` to `most` (log-uniform)."""
    joints, before = [], ""
    for k, letter in enumerate(rng.choice(_PATTERNS)):
        axis = {"x": X, "y": Y, "z": Z}[letter] * rng.choice([-1.0, 1.0])
        turned, offset = np.eye(3), _offset(rng, letter == before)
        if rng.random() < 0.5:
            turned = axis_angle_to_matrix(_unit(rng, 3), _small(rng, least, most))
        if rng.random() < 0.5:
            offset = offset + _small(rng, least, most) * _unit(rng, 3)
        if rng.random() < 0.3:
            axis = axis * (1.0 + rng.uniform(-1e-7, 1e-7))
        joints.append(_joint(k, offset, turned, axis, rng))
        before = letter
    return serial_robot("nearly", joints, Pose(rng.uniform(-0.2, 0.2, 3), _unit(rng, 4)))


def planted(robot: Robot, rng: np.random.Generator) -> tuple[IKProblem, Array]:
    """A pose that the arm has at a random configuration, often with joints at their limits; and the configuration."""
    q = robot.random_configuration(rng)
    if rng.random() < 0.2:
        q = np.where(rng.random(robot.dof) < 0.3, rng.choice([robot.lower, robot.upper]), q)
    return IKProblem(robot, robot.fk(q)), q


def _joint(k: int, offset: Array, turned: Array, axis: Array, rng: np.random.Generator) -> dict[str, object]:
    quat = matrix_to_quat(turned)
    if rng.random() < 0.2:
        # 0.7071, or a quaternion that is not of unit length in its seventh digit
        quat = np.round(quat, 4) if rng.random() < 0.5 else quat * (1.0 + rng.uniform(-1e-7, 1e-7))
    half = float(rng.choice([2.0, 2.8, np.pi, 2 * np.pi]))
    unit = quat / np.linalg.norm(quat)
    return {"name": f"j{k}", "xyz": offset, "quat": unit, "axis": axis, "lower": -half, "upper": half}


def _offset(rng: np.random.Generator, parallel: bool) -> Array:
    """From one joint to the next: some coordinates are zero; axes that are parallel are not the same."""
    offset: Array = rng.choice([0.0, 0.1, 0.35], 3) * rng.choice([-1.0, 1.0], 3)
    return np.array([0.3, 0.2, 0.25]) if parallel else offset


def _rpy_to(direction: Array, rng: np.random.Generator) -> list[float]:
    """Roll, pitch and yaw, right angles and half turns, that turn z into a direction along an axis."""
    angles = [0.0, np.pi / 2, -np.pi / 2, np.pi]
    fitting = [
        [a, b, c]
        for a in angles
        for b in angles[:3]
        for c in angles
        if np.linalg.norm(_matrix([a, b, c]) @ Z - direction) < 1e-9
    ]
    return fitting[int(rng.integers(len(fitting)))]


def _matrix(rpy: list[float]) -> Array:
    R: Array = np.eye(3)
    for axis, angle in zip((Z, Y, X), reversed(rpy), strict=True):
        R = R @ axis_angle_to_matrix(axis, angle)
    return R


def _written(angle: float, digits: int) -> float:
    """A right angle or half turn as a file has it, of either sign; zero as it is."""
    for exact, texts in WRITTEN.items():
        if abs(abs(angle) - exact) < 1e-12:
            return float(np.sign(angle)) * float(texts[digits])
    return angle


def _small(rng: np.random.Generator, least: float, most: float) -> float:
    return float(np.exp(rng.uniform(np.log(least), np.log(most))))


def _unit(rng: np.random.Generator, size: int) -> Array:
    v = rng.standard_normal(size)
    unit: Array = v / np.linalg.norm(v)
    return unit
