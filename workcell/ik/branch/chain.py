"""Robots as the branch and bound's kernels take them: what depends on the robot and the kind of goal alone."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from workcell.identity_cache import ByIdentity
from workcell.ik.problem import Goal, IKProblem
from workcell.ik.shared.limits import Interval
from workcell.model.coupling import Coupling, value_range
from workcell.model.robot import LIMIT_SLACK, Robot
from workcell.pose import Array

_LEVER = 0.3
_PARALLEL = 1e-4
"""Square of the sine below which two axes count as parallel: their common normal may be far away.

Any points of two axes will do for the bounds; those that are nearest each other make them tight."""
_FARTHEST = 10.0
"""Metres along an axis beyond which no point of it is taken: rounding grows with the lengths."""
_OUTER_WEIGHT = 20.0
"""How much wider the joints next to the ends count until the linear step applies."""
_SLIDING_WEIGHT = 2.0
"""Radians that a metre counts as."""
_IDLE_WEIGHT = 1e-3
"""For joints that only turn the tool where its rotation doesn't count, and for those that follow others."""
_SPARE = 1e-6
TURN = 2 * np.pi + 1e-9
FREE_JOINTS: dict[Goal, Array] = {
    "pose": np.zeros((0, 3)),
    "position": np.eye(3),
    "axis": np.array([[0.0, 0.0, 1.0]]),
}
"""Axes in the tool's frame, outermost first, about which the target may be turned: joints of the target, as it were."""
_FREE_RANGES: dict[Goal, Array] = {
    "pose": np.zeros(0),
    "position": 0.5 * np.array([TURN, 0.5 * TURN, TURN]),
    "axis": 0.5 * np.array([TURN]),
}


@dataclass(frozen=True, slots=True)
class Kinematics:
    """A robot with the free joints of its goal, see `workcell.ik.branch.kernels.state.Chain`.

    Attributes:
        turned: (n, 3, 3) rotations whose third columns are the joint axes.
        base: (4, 4) frame of the line that is fixed to the base.
        fixed, feet, slides, around, weights, middle, follows, polynomials: as in `Chain`.
        T_tool_end: (4, 4) frame of the line that is fixed to the target, in the tool's frame.
        T_base_world: (4, 4).
    """

    turned: Array
    base: Array
    fixed: Array
    feet: Array
    slides: Array
    around: Array
    weights: Array
    middle: int
    follows: NDArray[np.int64]
    polynomials: Array
    T_tool_end: Array
    T_base_world: Array


_remembered = ByIdentity()


def kinematics(robot: Robot, goal: Goal) -> Kinematics:
    """The kinematics of a robot for a kind of goal, remembered."""
    return _remembered.get((robot, goal), lambda: _kinematics(robot, goal))


def joint_box(problem: IKProblem) -> tuple[Array, Array]:
    """The box (N - 2,), (N - 2,) of all admissible configurations, with `LIMIT_SLACK`, free joints of the goal last.

    A joint that can turn fully has one turn.
    """
    robot = problem.robot
    interval = Interval.of(problem, LIMIT_SLACK)
    lower, upper = interval.lower, interval.upper
    wide = (upper - lower > TURN) & ~robot.prismatic if robot.coupling is None else np.zeros(0, dtype=bool)
    if robot.coupling is not None:
        lower, upper = _coupled_box(robot.coupling, lower, upper)
        turning = ~robot.prismatic & ~np.isin(
            robot.coupling.variable, robot.coupling.variable[robot.coupling.followers]
        )
        wide = (upper - lower > TURN) & turning
    if wide.any():
        middle = 0.5 * (lower + upper)
        lower = np.where(wide, middle - TURN / 2, lower)
        upper = np.where(wide, middle + TURN / 2, upper)
    free = _FREE_RANGES[problem.goal]
    return np.concatenate([lower, -free]), np.concatenate([upper, free])


def _coupled_box(coupling: Coupling, lower: Array, upper: Array) -> tuple[Array, Array]:
    """The box (m,), (m,) of all joints, of one of the variables."""
    low, high = np.array(lower[coupling.variable]), np.array(upper[coupling.variable])
    for k in coupling.followers:
        row, first, last = coupling.coefficients[k], float(low[k]), float(high[k])
        least, most = value_range(row, first, last)
        # wider than whoever checks the proof may find the range to be: contracting begins with that
        reach = max(abs(first), abs(last))
        spare = _SPARE * (
            1.0
            + (last - first) ** 2 * sum(i * i * abs(c) * reach ** max(i - 2, 0) for i, c in enumerate(row))
        )
        low[k], high[k] = least - spare, most + spare
    return low, high


def _followers(robot: Robot) -> tuple[NDArray[np.int64], Array]:
    """The joints (as the kernels count them) that follow others, with those that lead them; and the polynomials."""
    coupling = robot.coupling
    if coupling is None:
        return np.zeros((0, 2), dtype=np.int64), np.zeros((0, 2))
    k = coupling.followers
    return np.stack([k, coupling.own[coupling.variable[k]]], axis=1) + 1, np.array(coupling.coefficients[k])


def _kinematics(robot: Robot, goal: Goal) -> Kinematics:
    follows, polynomials = _followers(robot)
    robot = robot.uncoupled
    turned = np.array([_frame_with_z(axis) for axis in robot.axis])
    fixed: list[Array] = []
    base = _line_beside(np.eye(4), _transform(robot.joint_rotation[0] @ turned[0], robot.joint_xyz[0]))
    before = np.linalg.inv(base)
    for k in range(robot.dof):
        fixed.append(before @ _transform(robot.joint_rotation[k] @ turned[k], robot.joint_xyz[k]))
        before = _transform(turned[k].T, np.zeros(3))
    before = before @ robot.tool().T_link_tool.matrix
    for axis in FREE_JOINTS[goal]:
        z = _frame_with_z(axis)
        fixed.append(before @ _transform(z, np.zeros(3)))
        before = _transform(z.T, np.zeros(3))
    end = _line_beside(before, np.eye(4))
    frames = np.array([base, *fixed, end])
    feet = _feet(frames)
    count, n = len(frames), robot.dof
    slides = np.zeros(count)
    slides[1 : n + 1] = robot.prismatic
    weights = np.where(slides, _SLIDING_WEIGHT, np.ones((2, count)))
    outer = [1, 2, n - 1, n] if goal == "position" else [1, 2, count - 3, count - 2]
    weights[0, outer] *= _OUTER_WEIGHT
    weights[:, follows[:, 0]] *= _IDLE_WEIGHT
    middle = (count - 1) // 2
    if goal == "position":
        weights[:, n + 1 :] = _IDLE_WEIGHT
        middle = n + 1
    rows = np.concatenate([frames[:, :3, :3].reshape(-1, 9), frames[:, :3, 3]], axis=1)
    around = _around(frames, feet)
    T_tool_end, T_base_world = np.linalg.inv(before) @ end, robot.T_world_base.inverse().matrix
    return Kinematics(
        turned,
        base,
        rows,
        feet,
        slides,
        around,
        weights,
        middle,
        follows,
        polynomials,
        T_tool_end,
        T_base_world,
    )


def _transform(R: Array, p: Array) -> Array:
    T = np.eye(4)
    T[:3, :3], T[:3, 3] = R, p
    return T


def _frame_with_z(axis: Array) -> Array:
    """A rotation whose third column is `axis`."""
    z = axis / np.linalg.norm(axis)
    x = np.cross(np.eye(3)[int(np.argmin(np.abs(z)))], z)
    x /= np.linalg.norm(x)
    return np.stack([x, np.cross(z, x), z], axis=1)


def _line_beside(T_frame: Array, T_joint: Array) -> Array:
    """A frame whose z axis is a line at right angles to a joint's axis and beside it: what fixes the joint's angle.

    It passes at the height of `T_frame`'s origin; both transforms are in the frame of the result.
    """
    R = T_joint[:3, :3]
    along = R[:, 2] @ (T_frame[:3, 3] - T_joint[:3, 3])
    line = np.stack([R[:, 2], R[:, 0], R[:, 1]], axis=1)
    return _transform(line, T_joint[:3, 3] + along * R[:, 2] + _LEVER * R[:, 0])


def _feet(frames: Array) -> Array:
    """(N, 2) where along its axis each joint is nearest to the axis before it, and after it."""
    feet = np.zeros((len(frames), 2))
    for k in range(1, len(frames)):
        p, z = frames[k][:3, 3], frames[k][:3, 2]
        across = z[0] ** 2 + z[1] ** 2
        foot = -(p[0] * z[0] + p[1] * z[1]) / across if across > _PARALLEL else 0.0
        if max(abs(foot), abs(p[2] + foot * z[2])) > _FARTHEST:
            foot = 0.0
        feet[k, 0], feet[k - 1, 1] = foot, p[2] + foot * z[2]
    feet[0, 0], feet[-1, 1] = feet[0, 1], feet[-1, 0]
    return feet


def _around(frames: Array, feet: Array) -> Array:
    """(N, 4, 3) the neighbours' axes about each joint, see `Chain`."""
    around = np.zeros((len(frames), 4, 3))
    for i in range(1, len(frames) - 1):
        back = np.linalg.inv(frames[i])
        around[i, 0] = back[:3, 3] + feet[i - 1, 0] * back[:3, 2]
        around[i, 1] = back[:3, 2]
        around[i, 2] = frames[i + 1][:3, 3] + feet[i + 1, 1] * frames[i + 1][:3, 2]
        around[i, 3] = frames[i + 1][:3, 2]
    return around
