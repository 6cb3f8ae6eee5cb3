"""A problem's chain as proofs speak of it (docs/proofs.md, 7.2), made from the problem alone."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from workcell.ik.problem import IKProblem
from workcell.model.robot import LIMIT_SLACK
from workcell.pose import Array

LONGEST = 50.0
"""Metres of a chain and its target for which roundings are accounted for."""
MOST_JOINTS = 64
"""Joints for which they are."""


@dataclass(frozen=True, slots=True)
class Chain:
    """A problem's chain in the base's frame, and the target.

    Attributes:
        xyz, axis, along: (n, 3) offsets, axes in the links they move, the same in the links before.
        turn: (n, 3, 3) the joints' rotations.
        middle, half: (n,) of the joints' intervals; half with the slack, at most pi.
        across, turned: (n, 3) e_k in the link that joint k moves, and J u_k in the link before.
        tool: (3,) tool point in the last link.
        position, last: (3,) and (3, 3), target point and rotation of the last link there.
    """

    xyz: Array
    axis: Array
    along: Array
    turn: Array
    middle: Array
    half: Array
    across: Array
    turned: Array
    tool: Array
    position: Array
    last: Array

    @staticmethod
    def of(problem: IKProblem) -> Chain:
        """The chain of a problem's serial robot, all of its joints turning."""
        robot = problem.robot
        frame, goal = robot.tool().T_link_tool, problem.T_base_tool
        axis = robot.axis / np.linalg.norm(robot.axis, axis=1)[:, None]
        lower, upper = robot.lower, robot.upper
        if problem.max_step is not None and problem.q_reference is not None:
            lower = np.maximum(lower, problem.q_reference - problem.max_step)
            upper = np.minimum(upper, problem.q_reference + problem.max_step)
        middle, half = 0.5 * (lower + upper), np.minimum(0.5 * (upper - lower) + LIMIT_SLACK, np.pi)
        helper = np.eye(3)[np.argmin(np.abs(axis), axis=1)]
        across = np.cross(helper, axis)
        across /= np.linalg.norm(across, axis=1)[:, None]
        side = np.cross(axis, across)
        moved = np.cos(middle)[:, None] * across + np.sin(middle)[:, None] * side
        turn = robot.joint_rotation
        return Chain(
            robot.joint_xyz,
            axis,
            (turn @ axis[:, :, None])[..., 0],
            turn,
            middle,
            half,
            across,
            (turn @ moved[:, :, None])[..., 0],
            frame.position,
            goal.position,
            goal.rotation @ frame.rotation.T,
        )

    @property
    def joints(self) -> int:
        """n."""
        return len(self.xyz)

    @property
    def length(self) -> float:
        """Metres that all offsets have together, the target's distance included."""
        lengths = np.linalg.norm(np.vstack([self.xyz, self.tool, self.position]), axis=1)
        return float(lengths.sum())


def skew(d: Array) -> Array:
    """[d], the matrix (3, 3) of the cross product with d."""
    return np.array([[0.0, -d[2], d[1]], [d[2], 0.0, -d[0]], [-d[1], d[0], 0.0]])


def quaternion_forms(N: Array) -> Array:
    """(m, 4, 4) K with `<N, R> = q^T K q` for the unit quaternion q (wxyz) of any R; N (m, 3, 3)."""
    K = np.empty((len(N), 4, 4))
    a, b, c = N[:, 0, 0], N[:, 1, 1], N[:, 2, 2]
    K[:, 0, 0], K[:, 1, 1], K[:, 2, 2], K[:, 3, 3] = a + b + c, a - b - c, b - a - c, c - a - b
    K[:, 0, 1] = K[:, 1, 0] = N[:, 2, 1] - N[:, 1, 2]
    K[:, 0, 2] = K[:, 2, 0] = N[:, 0, 2] - N[:, 2, 0]
    K[:, 0, 3] = K[:, 3, 0] = N[:, 1, 0] - N[:, 0, 1]
    K[:, 1, 2] = K[:, 2, 1] = N[:, 0, 1] + N[:, 1, 0]
    K[:, 1, 3] = K[:, 3, 1] = N[:, 0, 2] + N[:, 2, 0]
    K[:, 2, 3] = K[:, 3, 2] = N[:, 1, 2] + N[:, 2, 1]
    return K


def rotation_sums(P: Array) -> Array:
    """(m, 3, 3) N with `<N, R> = <P, K(R)>` for symmetric P (m, 4, 4): K(R) is `quaternion_forms` of R.

    For P = q q^T of a unit quaternion it is that quaternion's rotation.
    """
    N = np.empty((len(P), 3, 3))
    w, x, y, z = (P[:, k, k] for k in range(4))
    N[:, 0, 0], N[:, 1, 1], N[:, 2, 2] = w + x - y - z, w - x + y - z, w - x - y + z
    for i, j, k in ((0, 1, 2), (1, 2, 0), (2, 0, 1)):
        N[:, i, j] = 2.0 * (P[:, i + 1, j + 1] - P[:, 0, k + 1])
        N[:, j, i] = 2.0 * (P[:, i + 1, j + 1] + P[:, 0, k + 1])
    return N


def unsuited(problem: IKProblem) -> str | None:
    """Why the convex proofs' kinds can't be about a problem, or their rounding isn't accounted for; or None."""
    robot = problem.robot
    if robot.coupling is not None:
        return "the robot has joints that follow others"
    if bool(np.any(robot.prismatic)) or not robot.is_serial or robot.tool().link != robot.dof:
        return "such proofs are about serial chains of turning joints"
    if robot.dof > MOST_JOINTS:
        return f"the robot has {robot.dof} joints; the checker's rounding is proved up to {MOST_JOINTS}"
    length = Chain.of(problem).length
    if not length <= LONGEST:
        return f"the robot and its target reach {length:.3g} m; the checker's rounding is proved up to {LONGEST:g}"
    return None
