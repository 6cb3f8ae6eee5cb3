"""Arms for the tests of the solvers: random skew chains, and the awkward special cases."""

from __future__ import annotations

import numpy as np

from workcell.model.robot import Robot
from workcell.model.serial import serial_robot
from workcell.pose import Pose, axis_angle_to_matrix, matrix_to_quat


def unit(rng: np.random.Generator, size: int = 3) -> np.ndarray:
    v = rng.standard_normal(size)
    return v / np.linalg.norm(v)


def arm(axes, offsets, lower, upper, tool=None) -> Robot:
    joints = [
        {
            "name": f"j{k}",
            "xyz": list(offset),
            "quat": [1.0, 0.0, 0.0, 0.0],
            "axis": list(axis),
            "lower": float(lo),
            "upper": float(hi),
        }
        for k, (axis, offset, lo, hi) in enumerate(zip(axes, offsets, lower, upper, strict=True))
    ]
    return serial_robot("arm", joints, tool or Pose.from_xyz([0.0, 0.05, 0.1]))


def skew_arm(seed: int, n: int, spread: float = 2.5) -> Robot:
    """Random axes and offsets, limits off centre."""
    rng = np.random.default_rng(seed)
    joints = []
    for k in range(n):
        middle, half = rng.uniform(-0.5, 0.5), rng.uniform(0.6, 1.0) * spread
        joints.append(
            {
                "name": f"j{k}",
                "xyz": rng.uniform(-0.3, 0.3, 3).tolist(),
                "quat": matrix_to_quat(axis_angle_to_matrix(unit(rng), rng.uniform(0, 3))).tolist(),
                "axis": unit(rng).tolist(),
                "lower": middle - half,
                "upper": middle + half,
            }
        )
    tool = Pose(rng.uniform(-0.2, 0.2, 3), unit(rng, 4))
    return serial_robot(f"skew{n}", joints, tool)


X, Y, Z = np.eye(3)


def seven_axis(half: float = 2.8) -> Robot:
    """An anthropomorphic arm: shoulder, elbow, wrist."""
    offsets = [[0, 0, 0.3], [0, 0, 0], [0, 0, 0.4], [0, 0, 0], [0, 0, 0.4], [0, 0, 0], [0, 0, 0.1]]
    axes = [Z, Y, Z, Y, Z, Y, Z]
    return arm(axes, offsets, [-half] * 7, [half] * 7)


def scara() -> Robot:
    """Three parallel vertical axes: links are planar about a known axis and the height can't change."""
    return arm([Z, Z, Z], [[0, 0, 0.2], [0.3, 0, 0], [0.3, 0, 0]], [-2.5] * 3, [2.5] * 3)


def parallel_elbow() -> Robot:
    """Six axes with three neighbouring parallel ones and full turns, like many industrial arms."""
    axes = [Z, Y, Y, Y, Z, Y]
    offsets = [[0, 0, 0.1], [0, 0.2, 0], [0.6, -0.1, 0], [0.55, 0, 0], [0, 0.1, 0], [0, 0, -0.1]]
    return arm(axes, offsets, [-2 * np.pi] * 6, [2 * np.pi] * 6)
