"""Marching along a step and the stop after it: shown to be clear by distances and bounds on how links move."""

from __future__ import annotations

import math

from workcell.jit import inlined, lean
from workcell.kernels.coupling import spread
from workcell.motion.live.kernels.braking import farthest, stop_time, stopping
from workcell.motion.live.kernels.desk import Desk, Surroundings
from workcell.motion.live.kernels.limbs import Limbs, put
from workcell.motion.live.kernels.motion import Motion
from workcell.motion.live.kernels.near import APART, Movers, link_gaps, move_obstacles
from workcell.pose import Array

_MOST_LOOKS = 32
"""Configurations at which distances are measured, at most."""


@lean
def drifts(limbs: Limbs, state: Array, t: float, length: float, motion: Motion) -> None:
    """Bounds on how far each joint moves between t and t + length seconds of the stop from a state, into drift (m,)."""
    for k in range(state.shape[1]):
        most, jerk = limbs.rates[1, k], limbs.rates[2, k]
        v, a = state[1, k], state[2, k]
        x0, v0, a0 = stopping(v, a, most, jerk, t)
        x1 = stopping(v, a, most, jerk, t + length)[0]
        # it may turn back once: there and back again
        back = min(farthest(v0, a0, most, jerk), farthest(-v0, -a0, most, jerk))
        motion.then[k] = abs(x1 - x0) + 2.0 * back
    for j in range(motion.drift.shape[0]):
        k = limbs.couple.variable[j]
        reach = abs(state[0, k]) + motion.then[k]
        motion.drift[j] = spread(limbs.couple, j, state[0, k], reach)[0] * motion.then[k]


@inlined
def _drift_of(levers: Array, drift: Array, a: int, b: int) -> float:
    """How far points of link b move relative to link a (0: to the world) while joints drift."""
    moved = 0.0
    for j in range(drift.shape[0]):
        moved += levers[a, b, j] * drift[j]
    return moved


@lean
def _fastest(movers: Movers) -> float:
    """A bound on the speed of any point of any mover, metres a second."""
    fastest, rows = 0.0, movers.rows
    for o in range(rows.shape[0]):
        m = movers.moves[o]
        away = math.sqrt((rows[o, 1] - m[6]) ** 2 + (rows[o, 2] - m[7]) ** 2 + (rows[o, 3] - m[8]) ** 2)
        turn = (away + rows[o, 16]) * math.sqrt(m[3] ** 2 + m[4] ** 2 + m[5] ** 2)
        fastest = max(fastest, math.sqrt(m[0] ** 2 + m[1] ** 2 + m[2] ** 2) + turn)
    return fastest


@lean
def _farthest_drift(limbs: Limbs, motion: Motion) -> float:
    """The largest motion of any link, in the world or relative to another, while joints drift."""
    most, links, levers, drift = 0.0, limbs.rows.shape[0], limbs.levers, motion.drift
    for b in range(1, links):
        for a in range(b):
            most = max(most, _drift_of(levers, drift, a, b))
    return most


@lean
def _outrun(limbs: Limbs, motion: Motion, gaps: Array, moved: float) -> tuple[float, float]:
    """Least gaps (as `link_gaps` has them) less how far links drift: to what stands and itself, to what moves.

    What moves does so by `moved` metres at most.
    """
    links, still, moving = limbs.rows.shape[0], 1e9, 1e9
    levers, drift = limbs.levers, motion.drift
    for b in range(1, links):
        own = _drift_of(levers, drift, 0, b)
        still = min(still, gaps[0, b] - own)
        moving = min(moving, gaps[b + 1, b] - own - moved)
        for a in range(b):
            if gaps[a + 1, b] < APART:
                still = min(still, gaps[a + 1, b] - _drift_of(levers, drift, a, b))
    return still, moving


@lean
def measure_at(
    limbs: Limbs, around: Surroundings, motion: Motion, desk: Desk, t: float, ceiling: float
) -> float:
    """Gaps at motion.then, t seconds from now, up to a ceiling, less what is to be kept; the smallest."""
    put(limbs, motion.then, desk.place)
    move_obstacles(around.movers, t)
    smallest = link_gaps(
        limbs, around.shapes, around.movers, around.skipped, desk.place, ceiling, desk.gaps, desk.near.close
    )
    for a in range(desk.gaps.shape[0]):
        for b in range(desk.gaps.shape[1]):
            desk.gaps[a, b] -= around.keep[0]
    return float(smallest - around.keep[0])


@lean
def _measure(
    limbs: Limbs, around: Surroundings, motion: Motion, desk: Desk, state: Array, t: float, period: float,
    ceiling: float,
) -> float:  # fmt: skip
    """Gaps t seconds into the stop from a state, up to a ceiling, less what is to be kept; the smallest.

    What moves is where it is after the period: that the arm gives way to it is the program's part (see `rows`).
    """
    for k in range(state.shape[1]):
        motion.then[k] = (
            state[0, k] + stopping(state[1, k], state[2, k], limbs.rates[1, k], limbs.rates[2, k], t)[0]
        )
    return measure_at(limbs, around, motion, desk, period, ceiling)


@lean
def drift_of_step(limbs: Limbs, motion: Motion, state: Array, period: float) -> None:
    """Bounds on how far each joint moves in the step from now to a state, into drift (m,)."""
    for k in range(state.shape[1]):
        v, w = motion.now[1, k], state[1, k]
        turned = period * (abs(v) + abs(w)) if v * w < 0.0 else 0.0
        motion.then[k] = abs(state[0, k] - motion.now[0, k]) + turned + limbs.rates[2, k] * period**3 / 6.0
    for j in range(motion.drift.shape[0]):
        k = limbs.couple.variable[j]
        steep = spread(limbs.couple, j, state[0, k], motion.then[k])[0]
        motion.drift[j] = steep * motion.then[k]


@lean
def _copy(one: Array, other: Array) -> None:
    """Write one array into another; a slice's assignment might make a third."""
    for a in range(one.shape[0]):
        for b in range(one.shape[1]):
            other[a, b] = one[a, b]


@lean
def _step_is_clear(
    limbs: Limbs, around: Surroundings, motion: Motion, desk: Desk, state: Array, period: float, ceiling: float
) -> tuple[bool, bool]:  # fmt: skip
    """Whether the step to a state, whose gaps have been measured, is clear of what stands, and of what moves.

    From there alone, or from both its ends.
    """
    drift_of_step(limbs, motion, state, period)
    moved = _fastest(around.movers) * period
    still, moving = _outrun(limbs, motion, desk.gaps, moved)
    if still > 0.0 and moving > 0.0:
        return True, True
    _copy(desk.gaps, desk.gaps_then)
    for k in range(state.shape[1]):
        motion.then[k] = motion.now[0, k]
    measure_at(limbs, around, motion, desk, 0.0, ceiling)
    for a in range(desk.gaps.shape[0]):
        for b in range(desk.gaps.shape[1]):
            desk.gaps[a, b] += desk.gaps_then[a, b]
    drift_of_step(limbs, motion, state, period)
    still, moving = _outrun(limbs, motion, desk.gaps, moved)
    _copy(desk.gaps_then, desk.gaps)
    motion.report[3] += 1.0
    return still > 0.0, moving > 0.0


@lean
def is_clear(
    limbs: Limbs, around: Surroundings, motion: Motion, desk: Desk, state: Array, period: float
) -> tuple[bool, bool]:
    """Whether the step to a state and the stop from there are shown to be clear of what stands, and of what moves.

    report[2] is the smallest gap seen, report[3] counts looks.
    """
    n, whole = state.shape[1], 0.0
    for k in range(n):
        whole = max(whole, stop_time(state[1, k], state[2, k], limbs.rates[1, k], limbs.rates[2, k]))
    motion.report[5] = whole
    drift_of_step(limbs, motion, state, period)
    ceiling = 0.01 + _farthest_drift(limbs, motion) + _fastest(around.movers) * period + around.keep[0]
    drifts(limbs, state, 0.0, whole, motion)
    ceiling += _farthest_drift(limbs, motion)
    motion.report[2] = _measure(limbs, around, motion, desk, state, 0.0, period, ceiling)
    motion.report[3] += 1.0
    still, moving = _step_is_clear(limbs, around, motion, desk, state, period, ceiling)
    t = 0.0
    while still and t < whole:
        length, shown, given = whole - t, False, False
        for _ in range(8):
            drifts(limbs, state, t, length, motion)
            spare, spare_moving = _outrun(limbs, motion, desk.gaps, 0.0)
            shown, given = spare > 0.0, spare_moving > 0.0
            if shown and (given or not moving):
                break
            length *= 0.6
        still, moving = still and shown, moving and given
        t += length
        if not still or t >= whole - 1e-9:
            break
        if motion.report[3] >= _MOST_LOOKS:
            return False, moving
        motion.report[3] += 1.0
        found = _measure(limbs, around, motion, desk, state, t, period, ceiling)
        motion.report[2] = min(motion.report[2], found)
    return still, still and moving
