"""Joint-space polish: damped Gauss-Newton on the tool's pose, inside the joint intervals."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from workcell.ik.problem import IKProblem
from workcell.ik.shared.limits import Interval
from workcell.kernels.constants import ROTATION_WEIGHT
from workcell.pose import Array, rotation_vector

CONVERGED = 1e-10
"""Length of the weighted error (a radian counts as one) from which a polish has arrived."""


class Polished(NamedTuple):
    """Where the polish ended: q (n,), what is left of the pose error, and the largest joint motion it took."""

    q: Array
    position_error: float
    rotation_error: float
    moved: float

    def reaches(self, problem: IKProblem) -> bool:
        """Whether the pose is within the problem's tolerances."""
        allowed = problem.tolerances
        return self.position_error <= allowed.position and self.rotation_error <= allowed.rotation


def polish(problem: IKProblem, q: Array, *, steps: int = 10, damping: float = 1e-9) -> Polished:
    """Levenberg-Marquardt from `q` (n,), clipped into limits and `max_step`; returns the best point seen.

    From a rank-1 point two steps without damping suffice; as a local search (`ikspark+lm`) give it more of both.
    `moved` is measured from `q` as given (radians, the largest of the joints).
    """
    interval = Interval.of(problem).closed
    lower, upper = interval.lower, interval.upper
    chain = _Chain(problem)
    start = np.asarray(q, dtype=float)
    now = np.clip(start, lower, upper)
    e, J = chain.error(now)
    for _ in range(steps):
        cost = float(e @ e)
        if cost < CONVERGED**2 or damping > 1e3:
            break
        trial = np.clip(now + _free_step(J, e, damping * (1.0 + cost), now, lower, upper), lower, upper)
        e_trial, J_trial = chain.error(trial)
        if float(e_trial @ e_trial) < cost:
            now, e, J = trial, e_trial, J_trial
            damping = max(0.1 * damping, 1e-12)
        else:
            damping = max(10.0 * damping, 1e-4)
    moved = float(np.abs(now - start).max())
    return Polished(now, float(np.linalg.norm(e[:3])) * ROTATION_WEIGHT, float(np.linalg.norm(e[3:])), moved)


class _Chain:
    """Pose error and Jacobian of one problem's chain, seen from the base."""

    def __init__(self, problem: IKProblem) -> None:
        robot, target = problem.robot, problem.T_base_tool
        tool = robot.tool().T_link_tool
        self._position, self._rotation = target.position, target.rotation
        self._tool_position, self._tool_rotation = tool.position, tool.rotation
        self._xyz, self._axis = robot.joint_xyz, robot.axis
        a = robot.axis
        K = np.zeros((robot.dof, 3, 3))
        K[:, 0, 1], K[:, 0, 2], K[:, 1, 2] = -a[:, 2], a[:, 1], -a[:, 0]
        K -= np.swapaxes(K, 1, 2)
        self._parts = (robot.joint_rotation, robot.joint_rotation @ K, robot.joint_rotation @ K @ K)

    def error(self, q: Array) -> tuple[Array, Array]:
        """(6,) position, weighted, and rotation vector from the tool to its target, and the Jacobian (6, n)."""
        still, sine, cosine = self._parts
        joints = still + np.sin(q)[:, None, None] * sine + (1.0 - np.cos(q))[:, None, None] * cosine
        n = len(q)
        R, p = np.eye(3), np.zeros(3)
        axes, origins = np.empty((n, 3)), np.empty((n, 3))
        for k in range(n):
            p = p + R @ self._xyz[k]
            R = R @ joints[k]
            origins[k], axes[k] = p, R @ self._axis[k]
        tip = p + R @ self._tool_position
        e, J = np.empty(6), np.empty((6, n))
        e[:3] = (self._position - tip) / ROTATION_WEIGHT
        e[3:] = rotation_vector(self._rotation @ (R @ self._tool_rotation).T)
        J[:3] = np.cross(axes, tip - origins).T / ROTATION_WEIGHT
        J[3:] = axes.T
        return e, J


def _free_step(J: Array, e: Array, damping: float, q: Array, lower: Array, upper: Array) -> Array:
    """The damped least-squares step, without the joints that it would push out of their interval."""
    free = np.ones(len(q), dtype=bool)
    step = np.zeros(len(q))
    for _ in range(2):
        A = J[:, free]
        step = np.zeros(len(q))
        step[free] = A.T @ np.linalg.solve(A @ A.T + damping * np.eye(6), e)
        stuck = ((q <= lower) & (step < 0)) | ((q >= upper) & (step > 0))
        if not np.any(stuck & free):
            break
        free &= ~stuck
    return step
