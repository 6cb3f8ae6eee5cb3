"""What a frame of live inverse kinematics does before and after the guard: sums, histories, stops, gaps."""

from __future__ import annotations

from workcell.jit import kernel
from workcell.kernels.shapes import to_shape
from workcell.motion.live.kernels.braking import stop_time, stopping
from workcell.motion.live.kernels.limbs import Limbs, put
from workcell.motion.live.kernels.march import drift_of_step, drifts
from workcell.motion.live.kernels.motion import Motion
from workcell.motion.live.kernels.relax import Desk, Surroundings, condition
from workcell.motion.live.kernels.terms import Wish, weigh
from workcell.pose import Array


@kernel
def assess(limbs: Limbs, around: Surroundings, wish: Wish, desk: Desk, q: Array) -> float:
    """The weighted sum at q (n,); its terms and errors are in desk.total, each tool's conditioning in desk.ratio."""
    put(limbs, q, desk.place)
    desk.near.used[0] = 0
    for t in range(wish.goals.shape[0]):
        condition(limbs, around, desk, t)
    return weigh(limbs, wish, desk.place, desk.near, q, desk.total)


@kernel
def along_stop(limbs: Limbs, motion: Motion, period: float, q: Array, moved: Array) -> None:
    """Configurations q (c, n) at even times of the stop after the next state, the first at that state itself.

    And bounds (c, m) on how far joints move until the following one, in the first row from now on.
    """
    count, n, whole = q.shape[0], motion.end.shape[0], 0.0
    for k in range(n):
        whole = max(
            whole, stop_time(motion.next[1, k], motion.next[2, k], limbs.rates[1, k], limbs.rates[2, k])
        )
    for i in range(count):
        t = whole * i / count
        for k in range(n):
            x = stopping(motion.next[1, k], motion.next[2, k], limbs.rates[1, k], limbs.rates[2, k], t)[0]
            q[i, k] = motion.next[0, k] + x
        drifts(limbs, motion.next, t, whole / count, motion)
        moved[i] = motion.drift
    drift_of_step(limbs, motion, motion.next, period)
    moved[0] += motion.drift


@kernel
def commit(limbs: Limbs, around: Surroundings, wish: Wish, mine: Wish, desk: Desk, motion: Motion) -> None:
    """The next state becomes the present one; histories of the relaxed solution and of the arm's own go on.

    Terms, errors and conditioning of the arm are in `desk.total` and `desk.ratio` afterwards.
    """
    n = motion.end.shape[0]
    for k in range(n):
        motion.then[k] = motion.next[0, k]
    assess(limbs, around, mine, desk, motion.then)
    for t in range(wish.goals.shape[0]):
        for c in range(3):
            mine.tools[t, c] = desk.place.tools[t, 9 + c]
    for k in range(n):
        for which in range(2):
            past = wish.past if which == 0 else mine.past
            past[2, k], past[1, k] = past[1, k], past[0, k]
            past[0, k] = motion.wanted[0, k] if which == 0 else motion.next[0, k]
        for r in range(3):
            motion.now[r, k] = motion.next[r, k]
        motion.then[k] = motion.wanted[0, k]
    put(limbs, motion.then, desk.place)
    for t in range(wish.goals.shape[0]):
        for c in range(3):
            wish.tools[t, c] = desk.place.tools[t, 9 + c]


@kernel
def ratios(limbs: Limbs, around: Surroundings, desk: Desk, q: Array, out: Array) -> None:
    """Conditioning (b, k) of every tool at configurations (b, n)."""
    for b in range(q.shape[0]):
        put(limbs, q[b], desk.place)
        for t in range(out.shape[1]):
            out[b, t] = condition(limbs, around, desk, t)


@kernel
def gaps_at(limbs: Limbs, around: Surroundings, desk: Desk, q: Array, out: Array) -> None:
    """Gaps (s, k) of all spheres to all shapes at q (n,), whether they count or not."""
    put(limbs, q, desk.place)
    for i in range(out.shape[0]):
        x, y, z = desk.place.centres[i, 0], desk.place.centres[i, 1], desk.place.centres[i, 2]
        for j in range(out.shape[1]):
            out[i, j] = to_shape(around.shapes, j, x, y, z)[0] - limbs.spheres[i, 3]
