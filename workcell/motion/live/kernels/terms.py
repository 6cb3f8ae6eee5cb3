"""RelaxedIK's weighted sum at one configuration: its value, gradient and a positive matrix for Newton's steps.

Every term but the last is the length of a residual r that goes through the groove loss (Eq. 3), a function of u = r'r:

    f(u) = -exp(-u / (2 c^2)) + r u^2

The gradient is exact. The matrix takes the loss's slope as the weight of r'r, which bounds the concave part from above,
and the whole of the convex part, so that it is positive definite wherever a smoothness term has a weight.
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from workcell.jit import inlined, lean
from workcell.motion.live.kernels.limbs import Limbs, Place, tool_jacobian, turn_error
from workcell.motion.live.kernels.near import Near
from workcell.pose import Array

GROOVE, STEEPNESS = 0.2, 5.0
"""c and r of the groove loss, the same for every term."""
AWARE = 0.06
"""Metres of clearance below which the collision term counts."""
SHY = 2e-3
"""Metres of clearance at which the collision term is a quarter of its value in contact."""


class Wish(NamedTuple):
    """What a frame asks for.

    Attributes:
        goals: (k, 26) of each tool: frame (12), weight, lowest (6) and highest (6) offset of position and rotation
            vector, and 1 where there is a goal.
        weights: (8,) of the seven terms, then 1 for the quadratic loss.
        past: (3, n) the last three configurations, the newest first.
        tools: (k, 3) positions of the tools at the newest.
    """

    goals: Array
    weights: Array
    past: Array
    tools: Array


class Sum(NamedTuple):
    """A weighted sum.

    Attributes:
        gradient: (n,); matrix: (n, n).
        terms: (7,) the terms before their losses; of several tools the largest.
        errors: (k, 2) position and rotation error of each tool, outside of its bands.
        J: (6, n) scratch; residual: (6,), rows: (6, n): the residual of a tool and its rates.
        vector: (3,) scratch.
    """

    gradient: Array
    matrix: Array
    terms: Array
    errors: Array
    J: Array
    residual: Array
    rows: Array
    vector: Array


@inlined
def _loss(u: float, quadratic: bool) -> tuple[float, float, float]:
    """Value and slope of the loss at a squared length, and the curvature of its convex part."""
    if quadratic:
        return u, 1.0, 0.0
    well = math.exp(-u / (2.0 * GROOVE * GROOVE))
    return (
        -well + STEEPNESS * u * u,
        well / (2.0 * GROOVE * GROOVE) + 2.0 * STEEPNESS * u,
        2.0 * STEEPNESS,
    )


@lean
def _add_rows(total: Sum, first: int, weight: float, quadratic: bool) -> tuple[float, float]:
    """Add the term of three residuals and their rates; its length, and what it adds to the value."""
    n = total.gradient.shape[0]
    r, rows = total.residual, total.rows
    u = r[first] * r[first] + r[first + 1] * r[first + 1] + r[first + 2] * r[first + 2]
    value, slope, bend = _loss(u, quadratic)
    if weight == 0.0:
        return math.sqrt(u), 0.0
    slope, bend = 2.0 * weight * slope, 4.0 * weight * bend
    for k in range(n):
        part = (
            r[first] * rows[first, k] + r[first + 1] * rows[first + 1, k] + r[first + 2] * rows[first + 2, k]
        )
        total.gradient[k] += slope * part
        for m in range(k + 1):
            other = (
                r[first] * rows[first, m]
                + r[first + 1] * rows[first + 1, m]
                + r[first + 2] * rows[first + 2, m]
            )
            total.matrix[k, m] += bend * part * other + slope * (
                rows[first, k] * rows[first, m]
                + rows[first + 1, k] * rows[first + 1, m]
                + rows[first + 2, k] * rows[first + 2, m]
            )
    return math.sqrt(u), weight * value


@inlined
def _outside(value: float, low: float, high: float) -> float:
    return value - high if value > high else value - low if value < low else 0.0


@lean
def _tool_residual(wish: Wish, place: Place, t: int, total: Sum) -> None:
    """How far tool t is outside of its goal's bands, along the goal's axes, and how fast that changes."""
    n = total.gradient.shape[0]
    goal, tool, J, w = wish.goals[t], place.tools[t], total.J, total.vector
    x, y, z = tool[9] - goal[9], tool[10] - goal[10], tool[11] - goal[11]
    angle = turn_error(goal, tool, w)
    square = angle * angle
    bend = 1.0 / 12.0
    if square > 1e-6:
        half = 0.5 * angle
        bend = (1.0 - half * math.cos(half) / math.sin(half)) / square
    for c in range(3):
        offset = goal[c] * x + goal[3 + c] * y + goal[6 + c] * z
        total.residual[c] = _outside(offset, goal[13 + c], goal[19 + c])
        total.residual[3 + c] = _outside(w[c], goal[16 + c], goal[22 + c])
    a, b, d = w[0], w[1], w[2]
    for k in range(n):
        for c in range(3):
            along = goal[c] * J[0, k] + goal[3 + c] * J[1, k] + goal[6 + c] * J[2, k]
            total.rows[c, k] = along if total.residual[c] != 0.0 or goal[13 + c] == goal[19 + c] else 0.0
        u = goal[0] * J[3, k] + goal[3] * J[4, k] + goal[6] * J[5, k]
        v = goal[1] * J[3, k] + goal[4] * J[4, k] + goal[7] * J[5, k]
        s = goal[2] * J[3, k] + goal[5] * J[4, k] + goal[8] * J[5, k]
        # d log(exp(turn) R) = (I - [w]/2 + bend [w]^2) turn
        dot = a * u + b * v + d * s
        rates = (
            u - 0.5 * (b * s - d * v) + bend * (a * dot - square * u),
            v - 0.5 * (d * u - a * s) + bend * (b * dot - square * v),
            s - 0.5 * (a * v - b * u) + bend * (d * dot - square * s),
        )
        for c in range(3):
            free = total.residual[3 + c] == 0.0 and goal[16 + c] != goal[22 + c]
            total.rows[3 + c, k] = 0.0 if free else rates[c]


@lean
def _add_joints(
    total: Sum, wish: Wish, q: Array, kind: int, weight: float, quadratic: bool
) -> tuple[float, float]:
    """Add the term of joint velocity (kind 0), acceleration (1) or jerk (2): differences over the last solutions."""
    n, past = q.shape[0], wish.past
    b, c, d = (-1.0, 0.0, 0.0) if kind == 0 else (-2.0, 1.0, 0.0) if kind == 1 else (-3.0, 3.0, -1.0)
    u = 0.0
    for k in range(n):
        r = q[k] + b * past[0, k] + c * past[1, k] + d * past[2, k]
        u += r * r
    value, slope, bend = _loss(u, quadratic)
    if weight == 0.0:
        return math.sqrt(u), 0.0
    slope, bend = 2.0 * weight * slope, 4.0 * weight * bend
    for k in range(n):
        r = q[k] + b * past[0, k] + c * past[1, k] + d * past[2, k]
        total.gradient[k] += slope * r
        total.matrix[k, k] += slope
        for m in range(k + 1):
            other = q[m] + b * past[0, m] + c * past[1, m] + d * past[2, m]
            total.matrix[k, m] += bend * r * other
    return math.sqrt(u), weight * value


@lean
def _add_collision(limbs: Limbs, near: Near, total: Sum, weight: float) -> tuple[float, float]:
    """Add the term that keeps off what is near: (d / (gap + d))^2 with a small d, going on straight below 0.

    Of the spheres of a link and one other thing only the nearest pair counts.
    """
    n, value = total.gradient.shape[0], 0.0
    for c in range(near.used[0]):
        if _is_outdone(limbs.spheres, near.who, near.gap, c, near.used[0]):
            continue
        d = SHY
        if near.who[c, 1] == 2:
            a, b = int(limbs.spheres[near.who[c, 0], 4]), int(limbs.spheres[near.who[c, 2], 4])
            d = limbs.shy[min(a, b), max(a, b)]
        gap = near.gap[c]
        share = d / (max(gap, 0.0) + d)
        slope, bend = -2.0 * share * share * share / d, 6.0 * share**4 / (d * d)
        value += share * share + min(gap, 0.0) * slope
        slope *= weight
        bend *= weight
        for k in range(n):
            total.gradient[k] += slope * near.gradient[c, k]
            for m in range(k + 1):
                total.matrix[k, m] += bend * near.gradient[c, k] * near.gradient[c, m]
    return value, weight * value


@lean
def _is_outdone(spheres: Array, who: NDArray[np.int64], gaps: Array, c: int, count: int) -> bool:
    """Whether another pair of the same link and the same thing is nearer than pair c."""
    link, kind, other = spheres[who[c, 0], 4], who[c, 1], who[c, 2]
    for o in range(count):
        if who[o, 1] != kind or spheres[who[o, 0], 4] != link or o == c:
            continue
        same = who[o, 2] == other if kind != 2 else spheres[who[o, 2], 4] == spheres[other, 4]
        if same and (gaps[o] < gaps[c] or (gaps[o] == gaps[c] and o < c)):
            return True
    return False


@lean
def weigh(limbs: Limbs, wish: Wish, place: Place, near: Near, q: Array, total: Sum) -> float:
    """The weighted sum at q (n,), where the limbs have been put and what is near has been found."""
    n, weights = q.shape[0], wish.weights
    quadratic, value = weights[7] != 0.0, 0.0
    for k in range(n):
        total.gradient[k] = 0.0
        for m in range(n):
            total.matrix[k, m] = 0.0
    for c in range(7):
        total.terms[c] = 0.0
    for t in range(wish.goals.shape[0]):
        tool_jacobian(limbs, place, t, total.J)
        total.errors[t, 0], total.errors[t, 1] = 0.0, 0.0
        if wish.goals[t, 25] != 0.0:
            _tool_residual(wish, place, t, total)
            share = wish.goals[t, 12]
            for c in range(2):
                length, part = _add_rows(total, 3 * c, share * weights[c], quadratic)
                total.errors[t, c] = length
                total.terms[c] = max(total.terms[c], length)
                value += part
        for c in range(3):
            total.residual[c] = place.tools[t, 9 + c] - wish.tools[t, c]
            for k in range(n):
                total.rows[c, k] = total.J[c, k]
        length, part = _add_rows(total, 0, weights[5], quadratic)
        total.terms[5] = max(total.terms[5], length)
        value += part
    for c in range(3):
        total.terms[2 + c], part = _add_joints(total, wish, q, c, weights[2 + c], quadratic)
        value += part
    total.terms[6], part = _add_collision(limbs, near, total, weights[6])
    value += part
    for k in range(n):
        for m in range(k):
            total.matrix[m, k] = total.matrix[k, m]
    return value
