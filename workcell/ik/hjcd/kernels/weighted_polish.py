"""PJ-IK, HJCD-IK's second phase as published, over a batch of configurations.

Section IV-B and Alg. 4 of HJCD-IK (see `workcell.ik.hjcd.solver`): the weighted and damped step, shortened until it
helps; else the dogleg; else the joint with the steepest gradient; else a kick.
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from workcell.ik.hjcd.kernels.greedy import KICK, kick
from workcell.ik.hjcd.kernels.weighted import apply_weights, damped_step, dogleg, weigh
from workcell.jit import inner, kernel
from workcell.kernels.chain import Arm, forward
from workcell.kernels.constants import HUGE
from workcell.kernels.pose_error import jacobian, move, pose_error, read_target
from workcell.kernels.random import RandomState
from workcell.kernels.structures import Work, scratch
from workcell.pose import Array

ITERATIONS = 40
"""Steps of a configuration at most."""
RADIUS = 1.0
"""Of the trust region, radians."""
HALVINGS = 4
"""Times that a step is halved at most."""
FIRST_DAMPING, LEAST_DAMPING, MOST_DAMPING = 5e-3, 1e-12, 1e6


class Weights(NamedTuple):
    """What a step is weighed with.

    Attributes:
        w: (6,) the diagonal of W.
        e: (6,) the weighted residual.
        found: (6,) the residual of what is tried.
    """

    w: Array
    e: Array
    found: Array


@inner
def _freeze(q: Array, bounds: Array, J: Array, e: Array, gradient: Array) -> None:
    """The gradient J^T e (n,); joints that it pushes out of their limits lose their column of J."""
    for k in range(q.shape[0]):
        total = 0.0
        for r in range(6):
            total += J[r, k] * e[r]
        held = (q[k] >= bounds[1, k] and total > 0) or (q[k] <= bounds[0, k] and total < 0)
        if bounds[2, k] == 0.0 and held:
            total = 0.0
            for r in range(6):
                J[r, k] = 0.0
        gradient[k] = total


@inner
def _squared_image(J: Array, x: Array) -> float:
    """|J x|^2."""
    total = 0.0
    for r in range(6):
        row = 0.0
        for k in range(x.shape[0]):
            row += J[r, k] * x[k]
        total += row * row
    return total


@inner
def _at(arm: Arm, target: Array, q: Array, share: float, work: Work, weights: Weights) -> float:
    """|W e|^2 at q + share * work.step, which is left in `work.trial`, its residual in `weights.found`."""
    move(q, work.step, share, arm.bounds, work.trial)
    forward(arm.frames, work.trial, work.T)
    pose_error(work.T, target, weights.found)
    total = 0.0
    for r in range(6):
        total += (weights.w[r] * weights.found[r]) ** 2
    return total


@inner
def _shortened(arm: Arm, target: Array, q: Array, cost: float, work: Work, weights: Weights) -> float:
    """The first of `work.step`, its half, its quarter ... that lowers the cost (Eq. 13): its share, 0 for none."""
    share = 1.0
    for _ in range(HALVINGS + 1):
        if _at(arm, target, q, share, work, weights) < cost:
            return share
        share *= 0.5
    return 0.0


@inner
def _falls_back(
    arm: Arm, target: Array, q: Array, cost: float, radius: float, work: Work, weights: Weights
) -> bool:
    """Whether the dogleg at `radius` (Eqs. 14-15) or the joint with the steepest gradient (Eq. 16) lowers the cost."""
    n, J, g = q.shape[0], work.J, work.gradient
    if damped_step(J, weights.e, LEAST_DAMPING, HUGE, work.A, work.y, work.newton):
        dogleg(g, _squared_image(J, g), work.newton, radius, work.step)
        if _at(arm, target, q, 1.0, work, weights) < cost:
            return True
    steepest = 0
    for k in range(n):
        work.step[k] = 0.0
        if abs(g[k]) > abs(g[steepest]):
            steepest = k
    square = 0.0
    for r in range(6):
        square += J[r, steepest] * J[r, steepest]
    if square < 1e-300:
        return False
    turn = g[steepest] / square
    work.step[steepest] = min(max(turn, -RADIUS), RADIUS)
    return _shortened(arm, target, q, cost, work, weights) > 0.0


@inner
def _next(arm: Arm, target: Array, q: Array, damping: float, work: Work, weights: Weights) -> float:
    """One step from q, whose residual is in `work.e`, into `work.trial`; the damping after it, 0 where none helps."""
    jacobian(arm.frames, work.T, work.J)
    weigh(work.J, work.e, weights.w)
    for r in range(6):
        weights.e[r] = work.e[r]
    cost = apply_weights(weights.w, work.J, weights.e)
    _freeze(q, arm.bounds, work.J, weights.e, work.gradient)
    radius = RADIUS
    if damped_step(work.J, weights.e, damping, RADIUS, work.A, work.y, work.step):
        square = 0.0
        for k in range(q.shape[0]):
            square += work.step[k] * work.step[k]
        # what is longer has been tried
        radius = 0.5**HALVINGS * math.sqrt(square)
        share = _shortened(arm, target, q, cost, work, weights)
        if share > 0.0:
            after, slope = 0.0, 0.0
            for r in range(6):
                after += (weights.w[r] * weights.found[r]) ** 2
            for k in range(q.shape[0]):
                slope += work.gradient[k] * work.step[k]
            predicted = 2.0 * share * slope - share * share * _squared_image(work.J, work.step)
            gain = (cost - after) / max(predicted, 1e-300)
            damping *= 0.3 if gain > 0.9 else (0.5 if gain > 0.5 else (3.0 if gain < 0.25 else 1.0))
            return min(max(damping, LEAST_DAMPING), MOST_DAMPING)
    if _falls_back(arm, target, q, cost, radius, work, weights):
        return min(3.0 * damping, MOST_DAMPING)
    return 0.0


@inner
def _polish(
    arm: Arm,
    target: Array,
    accuracy: float,
    iterations: int,
    random: RandomState,
    q: Array,
    best: Array,
    work: Work,
    weights: Weights,
) -> float:
    """Bring the tool to its target from q (n,), in place; returns the smallest squared residual met, at q then."""
    n = q.shape[0]
    forward(arm.frames, q, work.T)
    cost = pose_error(work.T, target, work.e)
    damping, least = FIRST_DAMPING, cost
    for k in range(n):
        best[k] = q[k]
    for _ in range(iterations):
        if least < accuracy * accuracy:
            break
        damping = _next(arm, target, q, damping, work, weights)
        if damping == 0.0:
            kick(arm, random, KICK, q, work.trial)
            damping = FIRST_DAMPING
            forward(arm.frames, work.trial, work.T)
            pose_error(work.T, target, weights.found)
        cost = 0.0
        for r in range(6):
            work.e[r] = weights.found[r]
            cost += work.e[r] * work.e[r]
        for k in range(n):
            q[k] = work.trial[k]
        if cost < least:
            least = cost
            for k in range(n):
                best[k] = q[k]
    for k in range(n):
        q[k] = best[k]
    return least


@kernel
def polish_copies(
    arm: Arm,
    pose: Array,
    accuracy: float,
    iterations: int,
    random: NDArray[np.uint64],
    q: Array,
    cost: Array,
) -> None:
    """Phase two over q (b, n), in place, with the squared residuals left in cost (b,).

    Kicks come from random (b, 1). A copy ends at a residual of `accuracy` metres (rotation weighted), or after
    `iterations`, at the best it has met.
    """
    n = q.shape[1]
    work, target, best = scratch(n), np.empty(12), np.empty(n)
    weights = Weights(np.empty(6), np.empty(6), np.empty(6))
    read_target(pose, target)
    for i in range(q.shape[0]):
        cost[i] = _polish(arm, target, accuracy, iterations, random[i], q[i], best, work, weights)
