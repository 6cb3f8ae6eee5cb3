"""The program over jerks: nearest to each joint's aim, off what is near the stop, out of the way of what moves."""

from __future__ import annotations

from workcell.jit import inlined, lean
from workcell.motion.live.kernels.braking import after
from workcell.motion.live.kernels.desk import Desk, Surroundings
from workcell.motion.live.kernels.limbs import Limbs, put
from workcell.motion.live.kernels.motion import MOST_GUARDS, NEAR, STOPPING, Motion
from workcell.motion.live.kernels.near import find_near, move_obstacles
from workcell.motion.live.kernels.program import add_row, invert
from workcell.motion.live.kernels.terms import Wish
from workcell.motion.live.kernels.windows import aim, end_of
from workcell.pose import Array

LOOK_OUT = 0.4
"""Metres of clearance to what moves within which a pair is a row."""
_YIELD = 2.5
"""Per second: what moves may close a gap by this share."""
_STIFF = 1e4
"""How much stiffer the shared slack of rows is than the stiffest direction of the sum."""
_FULL = 1.0 - 1e-6
"""Share of a limit that is all of it."""


@lean
def set_program(limbs: Limbs, motion: Motion, desk: Desk, period: float) -> bool:
    """The program over shares of jerk: nearest to each joint's aim in the sum's own matrix, within the windows."""
    n, program, H = motion.end.shape[0], desk.program, desk.total.matrix
    stiffest = 1e-9
    for k in range(n):
        stiffest = max(stiffest, H[k, k])
    for k in range(n):
        scale = limbs.rates[2, k] * period**3 / 6.0
        for m in range(n):
            desk.matrix[k, m] = scale * H[k, m] * limbs.rates[2, m] * period**3 / 6.0
        desk.matrix[k, k] += 1e-6 * stiffest * scale * scale
        desk.matrix[k, n], desk.matrix[n, k] = 0.0, 0.0
    desk.matrix[n, n] = _STIFF * stiffest
    if not invert(desk.matrix, program):
        return False
    program.used[0] = 0
    for k in range(n):
        share, most = 0.0, limbs.rates[1, k]
        motion.limited[k] = 0
        if motion.held[k] != STOPPING:
            share = aim(limbs, motion, k, period)
            reached = motion.now[2, k] + share * limbs.rates[2, k] * period
            motion.limited[k] = abs(share) > _FULL or abs(reached) > _FULL * most
        motion.aim[k], program.x[k] = share, share
        program.rows[add_row(program, motion.windows[0, k]), k] = 1.0
        program.rows[add_row(program, -motion.windows[1, k]), k] = -1.0
    program.x[n] = 0.0
    return True


@lean
def add_stop_rows(
    limbs: Limbs, around: Surroundings, motion: Motion, desk: Desk, wish: Wish, shares: Array, period: float
) -> None:
    """Rows that keep the stop after the step off what is near the stop before it, and tools off singularities.

    Stops are taken as they change around some shares (n,).
    """
    n, program, near = motion.end.shape[0], desk.program, desk.near
    keep = around.keep[0] + around.keep[1]
    for k in range(n):
        # into `slope` the end's rate by the share, into `then` the end itself
        step = 0.02
        low = end_of(limbs, motion, k, shares[k] - step, period)
        high = end_of(limbs, motion, k, shares[k] + step, period)
        desk.slope[k] = (high - low) / (2.0 * step)
        motion.then[k] = end_of(limbs, motion, k, shares[k], period)
    for c in range(near.used[0]):
        value, g = near.gap[c], near.gradient[c]
        for k in range(n):
            value += g[k] * (motion.then[k] - motion.end[k] - desk.slope[k] * shares[k])
        floor = keep if near.gap[c] >= keep else min(near.gap[c] + 2e-4, keep)
        row = program.rows[add_row(program, floor - value)]
        for k in range(n):
            row[k] = g[k] * desk.slope[k]
        row[n] = 1.0
    for t in range(wish.goals.shape[0]):
        if 2.0 * around.least[t] <= desk.ratio[t]:
            continue
        value = desk.ratio[t]
        ends = desk.vectors[4 + t]
        for k in range(n):
            value += ends[k] * (motion.then[k] - motion.now[0, k] - desk.slope[k] * shares[k])
        row = program.rows[add_row(program, min(around.least[t], desk.ratio[t]) - value)]
        for k in range(n):
            row[k] = ends[k] * desk.slope[k]
        row[n] = 0.02


@lean
def add_yield_rows(limbs: Limbs, around: Surroundings, motion: Motion, desk: Desk, period: float) -> None:
    """Rows that let what moves close a gap by a share of it a second, and no faster."""
    n, program, near = motion.end.shape[0], desk.program, desk.near
    move_obstacles(around.movers, period)
    for k in range(n):
        motion.then[k] = motion.stop[0, k]
    put(limbs, motion.then, desk.place)
    find_near(limbs, around.shapes, around.movers, around.skipped, desk.place, -1.0, LOOK_OUT, near)
    keep = around.keep[0] + 2.0 * around.keep[1]
    for c in range(near.used[0]):
        if near.who[c, 1] != 1:
            continue
        value = -near.rate[c] + _YIELD * (near.gap[c] - keep)
        for k in range(n):
            w = after(0.0, motion.now[1, k], motion.now[2, k], 0.0, period)[1]
            value += near.gradient[c, k] * (motion.stop[1, k] if motion.held[k] == STOPPING else w)
        row = program.rows[add_row(program, -value)]
        for k in range(n):
            if motion.held[k] != STOPPING:
                row[k] = near.gradient[c, k] * 0.5 * limbs.rates[2, k] * period * period
        row[n] = 1.0


@inlined
def note(motion: Motion, kind: int, first: int, second: int, third: int, value: float) -> None:
    """Write a guard down."""
    at = motion.used[0]
    guards = motion.guards[at]
    guards[0], guards[1], guards[2], guards[3] = kind, first, second, third
    motion.values[at] = value
    motion.used[0] = at + 1


@lean
def note_guards(motion: Motion, desk: Desk, rows: int) -> None:
    """Write down which rows of what is near shaped the program's step."""
    for i in range(desk.program.used[1]):
        c = desk.program.active[i] - rows
        if 0 <= c < desk.near.used[0] and motion.used[0] < MOST_GUARDS:
            who = desk.near.who[c]
            note(motion, NEAR, who[0], who[1], who[2], desk.near.gap[c])
