"""Damped Newton polish on the pose within limits, after HJCD-IK's second phase: the end of every restart.

Section IV, Eqs. 12-16 of HJCD-IK (see `workcell.ik.hjcd.solver`), with fixed weights and without random updates, which
restarts are there for; the phase as published is `weighted_polish`.
"""

from __future__ import annotations

import math

from workcell.jit import inner
from workcell.kernels.chain import Arm, forward
from workcell.kernels.cholesky import factor6, gram, solve6
from workcell.kernels.constants import HUGE
from workcell.kernels.pose_error import jacobian, move, pose_error
from workcell.kernels.structures import Work
from workcell.pose import Array

LONGEST_STEP = 2.0
"""Trust radius in joint space, radians."""
ITERATIONS = 24
"""Most iterations of one polish."""
ROUND, PROGRESS = 5, 0.3
"""Iterations after which the cost must have fallen to this share, or the polish gives up."""


@inner
def _freeze(q: Array, bounds: Array, J: Array, e: Array, g: Array) -> None:
    """The gradient g = J^T e (n,); joints that it pushes out of their limits lose their column of J."""
    for k in range(q.shape[0]):
        total = 0.0
        for r in range(6):
            total += J[r, k] * e[r]
        if bounds[2, k] == 0.0 and (
            (q[k] >= bounds[1, k] and total > 0) or (q[k] <= bounds[0, k] and total < 0)
        ):
            total = 0.0
            for r in range(6):
                J[r, k] = 0.0
        g[k] = total


@inner
def _length(x: Array) -> float:
    total = 0.0
    for k in range(x.shape[0]):
        total += x[k] * x[k]
    return math.sqrt(total)


@inner
def _pull_back(J: Array, y: Array, step: Array) -> None:
    """step = J^T y."""
    for k in range(step.shape[0]):
        total = 0.0
        for r in range(6):
            total += J[r, k] * y[r]
        step[k] = total


@inner
def _left_over(J: Array, e: Array, step: Array) -> float:
    """|e - J step|^2: the cost that the linear model predicts."""
    total = 0.0
    for r in range(6):
        row = e[r]
        for k in range(step.shape[0]):
            row -= J[r, k] * step[k]
        total += row * row
    return total


@inner
def _try(arm: Arm, target: Array, q: Array, share: float, work: Work, e: Array) -> float:
    """Cost at q + share * work.step, which is left in `work.trial` with its frames in `work.T`, its residual in e."""
    move(q, work.step, share, arm.bounds, work.trial)
    forward(arm.frames, work.trial, work.T)
    return pose_error(work.T, target, e)


@inner
def _fall_back(arm: Arm, target: Array, q: Array, cost: float, work: Work, e: Array) -> float:
    """When the damped step fails: backtracking, then dogleg (Eqs. 14-15), then the best single joint (Eq. 16)."""
    n = q.shape[0]
    for halving in range(1, 3):
        trial = _try(arm, target, q, 0.5**halving, work, e)
        if trial < cost:
            return trial
    g = work.gradient
    square, image = 0.0, 0.0
    for r in range(6):
        row = 0.0
        for k in range(n):
            row += work.J[r, k] * g[k]
        image += row * row
    for k in range(n):
        square += g[k] * g[k]
    if image < 1e-300 or square < 1e-300:
        return HUGE
    radius = min(0.1 * LONGEST_STEP, 0.5 * _length(work.newton))
    length = min(square / image, radius / math.sqrt(square))
    for k in range(n):
        work.step[k] = length * g[k]
    rest = radius - length * math.sqrt(square)
    if rest > 0:
        for k in range(n):
            work.step[k] += (work.newton[k] - work.step[k]) * rest / max(_length(work.newton), 1e-12)
    trial = _try(arm, target, q, 1.0, work, e)
    if trial < cost:
        return trial
    best = 0
    for k in range(n):
        if abs(g[k]) > abs(g[best]):
            best = k
    for k in range(n):
        work.step[k] = 0.0
    work.step[best] = math.copysign(0.1, g[best])
    return _try(arm, target, q, 1.0, work, e)


@inner
def polish(arm: Arm, target: Array, accuracy: float, q: Array, work: Work) -> float:
    """Bring the tool to its target from q (n,), in place; returns the squared residual reached.

    Stops at a residual of `accuracy` metres (rotation weighted), when no step helps, or where progress is slow.
    """
    n = q.shape[0]
    forward(arm.frames, q, work.T)
    cost = pose_error(work.T, target, work.e)
    goal, damping, mark = accuracy * accuracy, 0.03, cost
    e = work.column[:6] if n >= 6 else work.e.copy()
    for iteration in range(ITERATIONS):
        if cost < goal:
            break
        if iteration % ROUND == ROUND - 1:
            if cost > PROGRESS * mark:
                break
            mark = cost
        jacobian(arm.frames, work.T, work.J)
        _freeze(q, arm.bounds, work.J, work.e, work.gradient)
        gram(work.J, damping * cost + 1e-14, work.A)
        if not factor6(work.A):
            break
        solve6(work.A, work.e, work.y)
        _pull_back(work.J, work.y, work.step)
        length = _length(work.step)
        share = min(1.0, LONGEST_STEP / max(length, 1e-300))
        for k in range(n):
            work.step[k] *= share
            work.newton[k] = work.step[k]
        predicted = _left_over(work.J, work.e, work.step)
        trial = _try(arm, target, q, 1.0, work, e)
        if trial < cost:
            gain = (cost - trial) / max(cost - predicted, 1e-300)
            damping *= 0.3 if gain > 0.9 else (0.5 if gain > 0.5 else (3.0 if gain < 0.25 else 1.0))
        else:
            damping *= 4.0
            trial = _fall_back(arm, target, q, cost, work, e)
            if not trial < cost:
                break
        damping = min(max(damping, 1e-6), 1e4)
        cost = trial
        for k in range(n):
            q[k] = work.trial[k]
        for r in range(6):
            work.e[r] = e[r]
    return cost
