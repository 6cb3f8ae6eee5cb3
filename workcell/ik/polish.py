"""Joint-space polish: damped Gauss-Newton on the tool's pose, inside the joint intervals."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from workcell.ik.problem import IKProblem
from workcell.ik.relaxation import Interval
from workcell.pose import Array, rotation_vector

_CONVERGED = 1e-10
_LENGTH = 0.3
"""Metres that weigh as much as a radian."""


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


def polish(problem: IKProblem, q: Array, *, steps: int = 10) -> Polished:
    """Levenberg-Marquardt from `q` (n,), clipped into limits and `max_step`; returns the best point seen.

    From a rank-1 point two steps suffice; as a local search (`ikspark+lm`) give it more. `moved` is measured from
    `q` as given (radians, the largest of the joints).
    """
    interval = Interval.of(problem)
    lower, upper = interval.lower, np.maximum(interval.lower, interval.upper)
    tool, robot = problem.robot.tool(), problem.robot
    target, R_target = problem.target.position, problem.target.rotation
    start = np.asarray(q, dtype=float)

    def evaluate(at: Array) -> tuple[Array, Array, Array]:
        T = robot.link_transforms(at)
        tip = T[tool.link] @ tool.T_link_tool.matrix
        e = np.concatenate([(target - tip[:3, 3]) / _LENGTH, rotation_vector(R_target @ tip[:3, :3].T)])
        return T, tip[:3, 3], e

    now = np.clip(start, lower, upper)
    T, tip, e = evaluate(now)
    damping = 1e-9
    for _ in range(steps):
        cost = float(e @ e)
        if cost < _CONVERGED**2 or damping > 1e3:
            break
        J = robot.point_jacobian(T, tool.link, tip)
        J[:3] /= _LENGTH
        step = _free_step(J, e, damping * (1.0 + cost), now, lower, upper)
        trial = np.clip(now + step, lower, upper)
        T_trial, tip_trial, e_trial = evaluate(trial)
        if float(e_trial @ e_trial) < cost:
            now, T, tip, e = trial, T_trial, tip_trial, e_trial
            damping = max(0.1 * damping, 1e-12)
        else:
            damping = max(10.0 * damping, 1e-4)
    moved = float(np.abs(now - start).max())
    return Polished(now, float(np.linalg.norm(e[:3])) * _LENGTH, float(np.linalg.norm(e[3:])), moved)


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
