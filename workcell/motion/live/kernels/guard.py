"""The step that is carried out: towards the relaxed solution, within limits, and the arm can stop after it.

A joint may move by any constant jerk of the period after which it can still come to rest within its limits. Among
these moves a quadratic program takes the nearest to the relaxed solution whose stop keeps off what is near; then the
step, and the whole stop after it, is marched along and shown to be clear by distances and by bounds on how far links
move. What is not shown is mixed with the stop of the step before, which was, until it is.
"""

from __future__ import annotations

import math

from workcell.jit import kernel, lean
from workcell.motion.live.kernels.braking import stop_time
from workcell.motion.live.kernels.conditioning import conditioning_gradient
from workcell.motion.live.kernels.desk import Desk, Surroundings, condition
from workcell.motion.live.kernels.frame import Frame
from workcell.motion.live.kernels.limbs import Limbs, put
from workcell.motion.live.kernels.march import is_clear, measure_at
from workcell.motion.live.kernels.motion import Motion
from workcell.motion.live.kernels.near import find_near, move_obstacles
from workcell.motion.live.kernels.program import solve
from workcell.motion.live.kernels.rows import add_stop_rows, add_yield_rows, note_guards, set_program
from workcell.motion.live.kernels.terms import Wish
from workcell.motion.live.kernels.windows import open_windows, state_after

_LOOK_AHEAD = 0.06
"""Metres of clearance at the stop within which a pair is a row."""


@kernel
def guard(frame: Frame, period: float) -> None:
    """The next state, into motion.next, from motion.now and motion.wanted; `desk.total.matrix` as `relax` left it.

    Where nothing is wanted (nan), the arm is to stop.
    """
    _guard(frame.limbs, frame.around, frame.wish, frame.desk, frame.motion, period)


@lean
def _guard(
    limbs: Limbs, around: Surroundings, wish: Wish, desk: Desk, motion: Motion, period: float
) -> None:  # fmt: skip
    """See `guard`."""
    n = motion.end.shape[0]
    open_windows(limbs, motion, period)
    if math.isnan(motion.wanted[0, 0]):
        for k in range(n):
            motion.wanted[0, k], motion.wanted[1, k] = motion.end[k], 0.0
        motion.used[0] = 0
    for c in range(5):
        motion.report[c] = 0.0
    solved = _solve(limbs, around, wish, desk, motion, period)
    state_after(limbs, motion, desk.trial, period, motion.best)
    share = 1.0 if solved else 0.0
    best, best_share = -1e9, 0.0
    worst, worst_share = -1e9, 0.0
    for turn in range(4):
        if turn == 3:
            share = 0.0
        _blend(motion, share)
        motion.report[3] = 0.0
        still, moving = is_clear(limbs, around, motion, desk, motion.next, period)
        if moving:
            motion.report[0], motion.report[1] = share, 1.0
            return
        if still and motion.report[2] > best:
            best, best_share = motion.report[2], share
        if motion.report[2] > worst:
            worst, worst_share = motion.report[2], share
        if share == 0.0:
            break
        share *= 0.4
    # Nothing is shown to be clear of what moves: the step that leaves most room, of those that are clear of all else.
    # Not even of that: what was shown before stands, unless a contact that is there already makes it the worse choice.
    if best == -1e9:
        for k in range(n):
            motion.then[k] = motion.now[0, k]
        touching = not measure_at(limbs, around, motion, desk, 0.0, 0.02) > 0.0
        best, best_share = worst, worst_share if touching else 0.0
    _blend(motion, best_share)
    motion.report[0], motion.report[1], motion.report[2] = best_share, 0.0, best


@lean
def _blend(motion: Motion, share: float) -> None:
    """The next state: a share of the best one, the rest of it stopping."""
    for k in range(motion.end.shape[0]):
        for r in range(3):
            motion.next[r, k] = share * motion.best[r, k] + (1.0 - share) * motion.stop[r, k]


@lean
def _solve(
    limbs: Limbs, around: Surroundings, wish: Wish, desk: Desk, motion: Motion, period: float
) -> bool:  # fmt: skip
    """The program's shares of jerk, into desk.trial; False, and none, where it has no solution."""
    n, solved = motion.end.shape[0], False
    _find_singular(limbs, around, wish, desk, motion)
    if set_program(limbs, motion, desk, period):
        if around.movers.rows.shape[0] > 0:
            add_yield_rows(limbs, around, motion, desk, period)
        _find_near_stop(limbs, around, desk, motion)
        for k in range(n):
            desk.trial[k] = motion.aim[k]
        fixed = desk.program.used[0]
        for turn in range(2):
            desk.program.used[0] = fixed
            add_stop_rows(limbs, around, motion, desk, wish, desk.trial, period)
            if turn > 0:
                for k in range(n):
                    desk.program.x[k] = motion.aim[k]
                desk.program.x[n] = 0.0
            solved = solve(desk.program, 1e-8)
            if not solved:
                break
            for k in range(n):
                desk.trial[k] = min(max(desk.program.x[k], motion.windows[0, k]), motion.windows[1, k])
            if desk.program.used[0] == fixed:
                break
        note_guards(motion, desk, fixed)
        motion.report[4] = desk.program.x[n]
    if not solved:
        for k in range(n):
            desk.trial[k] = 0.0
    return solved


@lean
def _find_singular(limbs: Limbs, around: Surroundings, wish: Wish, desk: Desk, motion: Motion) -> None:
    """Gradients of the conditioning of tools that are near a singularity, into desk.vectors."""
    there = False
    for t in range(wish.goals.shape[0]):
        if 2.0 * around.least[t] <= desk.ratio[t]:
            continue
        if not there:
            for k in range(motion.end.shape[0]):
                motion.then[k] = motion.now[0, k]
            put(limbs, motion.then, desk.place)
            there = True
        condition(limbs, around, desk, t)
        conditioning_gradient(limbs, desk.place, t, desk.total.J, desk.vectors, desk.slope)
        for k in range(motion.end.shape[0]):
            desk.vectors[4 + t, k] = desk.slope[k]


@lean
def _find_near_stop(limbs: Limbs, around: Surroundings, desk: Desk, motion: Motion) -> None:
    """What is near the end of the stop from now."""
    whole = 0.0
    for k in range(motion.end.shape[0]):
        v, a = motion.now[1, k], motion.now[2, k]
        whole = max(whole, stop_time(v, a, limbs.rates[1, k], limbs.rates[2, k]))
        motion.then[k] = motion.end[k]
    put(limbs, motion.then, desk.place)
    move_obstacles(around.movers, whole)
    shapes, movers, skipped = around.shapes, around.movers, around.skipped
    find_near(limbs, shapes, movers, skipped, desk.place, _LOOK_AHEAD, _LOOK_AHEAD, desk.near)
