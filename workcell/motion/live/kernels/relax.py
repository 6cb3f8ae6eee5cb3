"""RelaxedIK's frame: the weighted sum made smaller from where the last frame's solution stands (section 4).

Each round takes the quadratic model of the sum within the joints' velocity limits (Eq. 8), the rows of all that is near
and those of tools near a singularity; what of the step makes the sum larger is given back by halves.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from workcell.jit import inner, kernel
from workcell.kernels.shapes import Shapes
from workcell.motion.live.kernels.conditioning import conditioning, conditioning_gradient
from workcell.motion.live.kernels.limbs import Limbs, Place, put, tool_jacobian
from workcell.motion.live.kernels.near import Movers, Near, find_near, move_obstacles
from workcell.motion.live.kernels.program import Program, add_row, invert, solve
from workcell.motion.live.kernels.terms import SHY, Sum, Wish, weigh
from workcell.pose import Array

_SLACK = 1e4
"""How much stiffer the shared slack of soft rows is than the stiffest direction of the sum."""
_SETTLED = 1e-7
"""Radians of a step below which a frame is settled."""


class Surroundings(NamedTuple):
    """What the limbs must keep off.

    Attributes:
        shapes: what stands; movers: what moves.
        skipped: (s, k) spheres and shapes that don't count.
        keep: (2,) metres to keep: of the margin that the caller asked for, and a little that rows keep on top.
        least: (k,) conditioning below which a tool counts as singular.
    """

    shapes: Shapes
    movers: Movers
    skipped: NDArray[np.bool_]
    keep: Array
    least: Array


class Desk(NamedTuple):
    """Scratch: places, sums, near pairs, programs, singular vectors (see `workcell.motion.live.packing`)."""

    place: Place
    total: Sum
    near: Near
    program: Program
    matrix: Array
    ratio: Array
    vectors: Array
    gram: Array
    eigenvectors: Array
    slope: Array
    trial: Array
    gaps: Array
    gaps_then: Array


@inner
def look(limbs: Limbs, around: Surroundings, desk: Desk, q: Array, margin: float) -> float:
    """Put the limbs at q and find what is nearer than `margin`; the smallest gap."""
    put(limbs, q, desk.place)
    return find_near(
        limbs, around.shapes, around.movers, around.skipped, desk.place, margin, margin, desk.near
    )


@inner
def condition(limbs: Limbs, around: Surroundings, desk: Desk, t: int) -> float:
    """The conditioning of tool t where the limbs have been put."""
    tool_jacobian(limbs, desk.place, t, desk.total.J)
    ratio = conditioning(desk.total.J, desk.gram, desk.eigenvectors, desk.vectors)
    desk.ratio[t] = ratio
    return ratio


@inner
def _add_near_rows(desk: Desk, around: Surroundings, n: int, part: float) -> None:
    """Rows over steps and slack: a step may use up `part` of what is left of a gap, and opens what is too narrow."""
    near, keep = desk.near, around.keep[0] + around.keep[1]
    for c in range(near.used[0]):
        spare = near.gap[c] - keep
        bound = -part * spare if spare > 0.0 else min(-spare, 0.02)
        row = add_row(desk.program, bound)
        for k in range(n):
            row[k] = near.gradient[c, k]
        row[n] = 1.0


@inner
def _add_singular_rows(limbs: Limbs, around: Surroundings, desk: Desk, wish: Wish, n: int) -> None:
    """Rows that keep tools at their conditioning's least, or let it grow where they are below."""
    for t in range(wish.goals.shape[0]):
        if around.least[t] <= 0.0:
            continue
        ratio = condition(limbs, around, desk, t)
        if ratio > 2.0 * around.least[t]:
            continue
        conditioning_gradient(limbs, desk.place, t, desk.total.J, desk.vectors, desk.slope)
        spare = ratio - around.least[t]
        row = add_row(desk.program, -0.5 * spare if spare > 0.0 else 0.0)
        for k in range(n):
            row[k] = desk.slope[k]
        row[n] = 0.02


@inner
def _step(
    limbs: Limbs, around: Surroundings, wish: Wish, desk: Desk, low: Array, high: Array, q: Array
) -> bool:  # fmt: skip
    """The quadratic model's step from q within [low, high], into the program's x (n + 1,)."""
    n, program, total = q.shape[0], desk.program, desk.total
    stiffest = 1e-9
    for k in range(n):
        stiffest = max(stiffest, total.matrix[k, k])
    for k in range(n):
        for m in range(n):
            desk.matrix[k, m] = total.matrix[k, m]
        desk.matrix[k, k] += 1e-9 * stiffest
        desk.matrix[k, n], desk.matrix[n, k] = 0.0, 0.0
    desk.matrix[n, n] = _SLACK * stiffest
    if not invert(desk.matrix, program):
        return False
    for k in range(n):
        step = 0.0
        for m in range(n):
            step -= program.inverse[k, m] * total.gradient[m]
        program.x[k] = step
    program.x[n], program.used[0] = 0.0, 0
    for k in range(n):
        add_row(program, low[k] - q[k])[k] = 1.0
        add_row(program, q[k] - high[k])[k] = -1.0
    _add_near_rows(desk, around, n, 0.5)
    _add_singular_rows(limbs, around, desk, wish, n)
    return solve(program, 1e-9)


@kernel
def relax(
    limbs: Limbs, around: Surroundings, wish: Wish, desk: Desk, low: Array, high: Array, q: Array, period: float,
    rounds: int,
) -> float:  # fmt: skip
    """Up to `rounds` rounds from q (n,), changed; returns the length of the last step, 0 where it is settled.

    Movers are looked at where they will be after the period.
    """
    n = q.shape[0]
    for k in range(n):
        q[k] = min(max(q[k], low[k]), high[k])
    move_obstacles(around.movers, period)
    look(limbs, around, desk, q, SHY)
    value = weigh(limbs, wish, desk.place, desk.near, q, desk.total)
    length = 0.0
    for _ in range(rounds):
        if not _step(limbs, around, wish, desk, low, high, q):
            return 0.0
        length = 0.0
        for k in range(n):
            length = max(length, abs(desk.program.x[k]))
        for k in range(n):
            desk.slope[k] = desk.program.x[k]
        slack, share, better = desk.program.x[n], 1.0, False
        for _half in range(4):
            for k in range(n):
                desk.trial[k] = min(max(q[k] + share * desk.slope[k], low[k]), high[k])
            look(limbs, around, desk, desk.trial, SHY)
            trial = weigh(limbs, wish, desk.place, desk.near, desk.trial, desk.total)
            # a step that rows asked for may make the sum larger
            if trial <= value + 1e-12 * abs(value) or slack > 1e-6 or (share == 1.0 and _pushed(desk, n)):
                better = True
                break
            share *= 0.5
        if not better:
            look(limbs, around, desk, q, SHY)
            weigh(limbs, wish, desk.place, desk.near, q, desk.total)
            return 0.0
        value = trial
        for k in range(n):
            q[k] = desk.trial[k]
        if length < _SETTLED:
            return 0.0
    return length


@inner
def _pushed(desk: Desk, n: int) -> bool:
    """Whether a row that is no bound of a joint shaped the step."""
    pushed = False
    for i in range(desk.program.used[1]):
        pushed = pushed or desk.program.active[i] >= 2 * n
    return pushed
