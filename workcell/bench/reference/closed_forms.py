"""Every configuration that reaches a pose, in closed form: a judge of "no solution" that knows nothing of boxes.

Products of exponentials about the axes of the zero configuration; each angle follows from one equation a + b cos q +
c sin q = 0 (Paden and Kahan's subproblems; Murray, Li and Sastry, A Mathematical Introduction to Robotic
Manipulation, section 3.3). The family here: six joints, the second to fourth parallel and the last two meeting
(Universal Robots).
"""

from __future__ import annotations

import numpy as np

from workcell.errors import InputError
from workcell.ik.judge.exact import ExactKinematics
from workcell.model.robot import Robot
from workcell.pose import Array, Pose, axis_angle_to_matrix

MEETS = 1e-6
"""Metres within which axes count as meeting."""
_REACHES = 1e-7


class Screws:
    """Joint axes (n, 3) and points on them (n, 3) in the zero configuration, and the tool's pose there."""

    def __init__(self, robot: Robot) -> None:
        kinematics = ExactKinematics(robot)
        rotation, position = kinematics.links(np.zeros(robot.dof))
        self.z = np.einsum("kij,kj->ki", rotation[1:], robot.axis)
        self.o = position[1:]
        self.robot = robot
        R, p = kinematics.tool(rotation, position)
        self.zero = _matrix(R, p)

    def turn(self, k: int, angle: float) -> Array:
        """(4, 4) rotation of joint k."""
        R = axis_angle_to_matrix(self.z[k], angle)
        return _matrix(R, self.o[k] - R @ self.o[k])

    def meeting(self, i: int, j: int) -> Array:
        """The point where two axes meet."""
        normal = np.cross(self.z[i], self.z[j])
        apart = self.o[j] - self.o[i]
        if abs(apart @ normal) > MEETS:
            raise InputError(f"axes {i + 1} and {j + 1} don't meet", where=self.robot.name)
        point: Array = self.o[i] + self.z[i] * (np.cross(apart, self.z[j]) @ normal / (normal @ normal))
        return point

    def reaching(self, candidates: list[Array], motion: Array) -> Array:
        """(k, n) those candidates whose product of turns is `motion`; some equations lose a sign."""
        kept = []
        for q in candidates:
            T = np.eye(4)
            for k, angle in enumerate(q):
                T = T @ self.turn(k, angle)
            if np.abs(T - motion).max() < _REACHES:
                kept.append((np.array(q) + np.pi) % (2 * np.pi) - np.pi)
        return np.array(kept).reshape(-1, len(self.z))


def parallel_arm(robot: Robot, target: Pose) -> Array:
    """(k, 6) angles in [-pi, pi) of a UR-like arm at `T_world_tool`, up to eight; without those at singular poses.

    Raises:
        InputError: joints two to four aren't parallel, or the last two don't meet.
    """
    s = Screws(robot)
    if robot.dof != 6 or max(np.abs(np.cross(s.z[1], s.z[k])).max() for k in (2, 3)) > 1e-9:
        raise InputError("not an arm with six joints, the second to fourth parallel", where=robot.name)
    motion = target.matrix @ np.linalg.inv(s.zero)
    wrist = s.meeting(4, 5)
    there = transformed(motion, wrist)
    side = s.z[1]
    found: list[Array] = []
    # Turned back by joint 1, the wrist's offset from the arm's plane is what it is at zero.
    for q1 in roots(-s.z[0], there - s.o[0], side, side @ (wrist - s.o[0])):
        back = np.linalg.inv(s.turn(0, q1)) @ motion
        for q5 in roots(s.z[4], s.z[5], side, float(side @ back[:3, :3] @ s.z[5])):
            q6 = -turn_between(s.z[5], s.turn(4, -q5)[:3, :3] @ side, back[:3, :3].T @ side)
            planar = back @ np.linalg.inv(s.turn(4, q5) @ s.turn(5, q6))
            elbow = transformed(planar, s.o[3])
            for q3 in roots_of_distance(
                s.z[2], s.o[2], s.o[3], s.o[1], float(np.linalg.norm(elbow - s.o[1]))
            ):
                q2 = turn_between(side, transformed(s.turn(2, q3), s.o[3]) - s.o[1], elbow - s.o[1])
                rest = np.linalg.inv(s.turn(1, q2) @ s.turn(2, q3)) @ planar
                x: Array = np.cross(side, s.z[4])
                found.append(
                    np.array(
                        [
                            q1,
                            q2,
                            q3,
                            turn_between(s.z[3], x, np.asarray(rest[:3, :3] @ x, dtype=float)),
                            q5,
                            q6,
                        ]
                    )
                )
    return s.reaching(found, motion)


def _matrix(R: Array, p: Array) -> Array:
    T = np.eye(4)
    T[:3, :3], T[:3, 3] = R, p
    return T


def transformed(T: Array, point: Array) -> Array:
    """A point (3,) moved by a transform (4, 4)."""
    moved: Array = T[:3, :3] @ point + T[:3, 3]
    return moved


def turn_between(z: Array, u: Array, v: Array) -> float:
    """The turn about z that brings u's part across z to that of v."""
    return float(np.arctan2(z @ np.cross(u, v), u @ v - (z @ u) * (z @ v)))


def roots(z: Array, u: Array, w: Array, value: float) -> list[float]:
    """Angles at which w . (u turned about z) is `value`: two, or none."""
    along = (z @ u) * (z @ w)
    cosine, sine = w @ u - along, w @ np.cross(z, u)
    size = float(np.hypot(cosine, sine))
    if abs(value - along) > size or size < 1e-12:
        return []
    phase, half = float(np.arctan2(sine, cosine)), float(np.arccos((value - along) / size))
    return [phase + half, phase - half]


def roots_of_distance(z: Array, o: Array, p: Array, q: Array, distance: float) -> list[float]:
    """Turns of p about the axis (z, o) that bring it to a distance from q."""
    u, w = p - o, q - o
    return roots(z, u, w, 0.5 * float(u @ u + w @ w - distance**2))
