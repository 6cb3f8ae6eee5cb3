"""All configurations of a UR10 that reach a pose, in closed form: the truth behind CIDGIK's infeasible problems."""

from __future__ import annotations

from itertools import product

import numpy as np

from workcell.model.robot import Robot
from workcell.pose import Array

_REACHES = 1e-6


def closed_form(robot: Robot, T_base_tool: Array) -> Array:
    """(k, 6) configurations in (-pi, pi] whose tool pose is (4, 4) `T_base_tool`, up to eight.

    Args:
        robot: `bench_arm("ur10")`; lengths are read off its Denavit-Hartenberg frames.
        T_base_tool: in the base frame.
    """
    xyz = [*robot.joint_xyz[1:], robot.tool().T_link_tool.position]
    a2, a3 = xyz[1][0], xyz[2][0]
    d1, d4, d5, d6 = xyz[0][2], xyz[3][2], xyz[4][2], xyz[5][2]
    R, p = T_base_tool[:3, :3], T_base_tool[:3, 3]
    found = []
    for shoulder, wrist, elbow in product((1.0, -1.0), repeat=3):
        wrist_point = p - d6 * R[:, 2]
        out = float(np.hypot(wrist_point[0], wrist_point[1]))
        if out < abs(d4):
            continue
        q1 = np.arctan2(wrist_point[1], wrist_point[0]) + shoulder * np.arccos(d4 / out) + 0.5 * np.pi
        c1, s1 = np.cos(q1), np.sin(q1)
        cosine = (p[0] * s1 - p[1] * c1 - d4) / d6
        if abs(cosine) > 1.0:
            continue
        q5 = wrist * np.arccos(cosine)
        s5 = np.sin(q5)
        if abs(s5) < 1e-9:
            continue
        q6 = np.arctan2((-R[0, 1] * s1 + R[1, 1] * c1) / s5, (R[0, 0] * s1 - R[1, 0] * c1) / s5)
        x, y, angle = _planar(R, p, d1, d5, d6, q1, q5, q6)
        cosine = (x * x + y * y - a2 * a2 - a3 * a3) / (2 * a2 * a3)
        if abs(cosine) > 1.0:
            continue
        q3 = elbow * np.arccos(cosine)
        q2 = np.arctan2(y, x) - np.arctan2(a3 * np.sin(q3), a2 + a3 * np.cos(q3))
        q = np.array([q1, q2, q3, angle - q2 - q3, q5, q6])
        found.append(q - 2 * np.pi * np.round(q / (2 * np.pi)))
    reached = [q for q in found if np.abs(robot.fk_transform(q) - T_base_tool).max() < _REACHES]
    return np.array(reached).reshape(-1, 6)


def _planar(
    R: Array, p: Array, d1: float, d5: float, d6: float, q1: float, q5: float, q6: float
) -> tuple[float, float, float]:
    """Where joint 4 is in the plane of the arm (metres), and the sum of the angles of joints 2, 3, 4."""
    c1, s1 = np.cos(q1), np.sin(q1)
    # frame 1: x along the arm, y up, z along the axes of joints 2, 3 and 4
    R1 = np.array([[c1, 0.0, s1], [s1, 0.0, -c1], [0.0, 1.0, 0.0]])
    c5, s5, c6, s6 = np.cos(q5), np.sin(q5), np.cos(q6), np.sin(q6)
    R45 = np.array([[c5, 0.0, -s5], [s5, 0.0, c5], [0.0, -1.0, 0.0]])
    R56 = np.array([[c6, -s6, 0.0], [s6, c6, 0.0], [0.0, 0.0, 1.0]])
    R04 = R @ (R45 @ R56).T
    p4 = p - d6 * R[:, 2] - d5 * R04[:, 2] - np.array([0.0, 0.0, d1])
    in_arm = R1.T @ p4
    R14 = R1.T @ R04
    return float(in_arm[0]), float(in_arm[1]), float(np.arctan2(R14[1, 0], R14[0, 0]))
