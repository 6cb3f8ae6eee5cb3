"""The search among obstacles: restarts, near misses slid clear, self-motion curves walked.

It has one entry, called in chunks.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from workcell.ik.hjcd.kernels.free import restart
from workcell.ik.hjcd.kernels.newton import polish
from workcell.ik.hjcd.kernels.slide import slide
from workcell.ik.hjcd.kernels.trace import Walked, accept, remember, walk, was_walked
from workcell.jit import inner, kernel
from workcell.kernels.chain import Arm, forward
from workcell.kernels.constants import HUGE
from workcell.kernels.contacts import Contacts, collect, room
from workcell.kernels.pose_error import read_target
from workcell.kernels.random import uniform
from workcell.kernels.structures import Work, World, scratch
from workcell.pose import Array

FOUND, SPENT, EXHAUSTED = 1, 0, -1
"""A clear configuration; the chunk is over; every restart of a long series led to where we had been."""
DEEPEST = 0.06
"""Metres of penetration from which sliding is tried."""
SLIDES = 18
"""Iterations of sliding."""
PATIENCE = 4
"""Poses in collision before curves are walked."""
WIDTH = 0.03
"""Radians within which a configuration counts as on a curve."""
KNOWN = 300
"""Restarts in a row that lead to known curves before the search counts as exhausted."""
APART = 0.05
"""Radians along a curve from a configuration that was refused to the next that is offered."""
MISSES = 8
"""Near misses kept."""
RESTARTS, POSES, SLID, CURVES, REPEATS, ARC, STARTED, BEST = range(8)
"""Places in `Memory.counts`: restarts, poses reached, slides and walks, restarts in a row without a new curve, arc to
go on from on the present curve (negative: none), rows of `first` used, smallest squared residual."""


class Memory(NamedTuple):
    """What a search keeps from one chunk to the next.

    Attributes:
        random: (1,) state of the random stream.
        counts: (8,) see `RESTARTS` and its neighbours.
        walked: points of curves, as `trace.Walked` (points and count).
        walked_count: (1,).
        curve: (n,) where the present curve was entered.
        held: (n,) 1 for joints that stand still on it.
        misses: (MISSES, n + 3) gap, sphere, obstacle (or minus one less another sphere), configuration; the smallest
            penetration first.
    """

    random: NDArray[np.uint64]
    counts: Array
    walked: Array
    walked_count: Array
    curve: Array
    held: Array
    misses: Array


@inner
def note_miss(memory: Memory, world: World, q: Array, contacts: Contacts) -> None:
    """Keep q (n,) among the near misses, with the worst pair of its contacts."""
    worst = 0
    for c in range(1, int(contacts.used[0])):
        if contacts.rows[c, 0] < contacts.rows[worst, 0]:
            worst = c
    gap, n, place = contacts.rows[worst, 0], q.shape[0], MISSES - 1
    if gap <= memory.misses[place, 0]:
        return
    while place > 0 and memory.misses[place - 1, 0] < gap:
        for k in range(n + 3):
            memory.misses[place, k] = memory.misses[place - 1, k]
        place -= 1
    other = int(contacts.rows[worst, 9])
    memory.misses[place, 0] = gap
    memory.misses[place, 1] = world.spheres[int(contacts.rows[worst, 8]), 4]
    memory.misses[place, 2] = float(other) if other >= 0 else -1.0 - world.spheres[-1 - other, 4]
    for k in range(n):
        memory.misses[place, 3 + k] = q[k]


@inner
def _improve(
    arm: Arm, target: Array, world: World, enough: float, gap: float, q: Array, out: Array,
    memory: Memory, work: Work, contacts: Contacts, twist: Array,
) -> bool:  # fmt: skip
    """From a pose in collision at q (n,), by `gap` metres: slide clear, or walk its curve. True with `out` clear."""
    n = q.shape[0]
    counts, walked = memory.counts, Walked(memory.walked, memory.walked_count)
    if n > 6 and gap > -DEEPEST:
        counts[SLID] += 1
        for k in range(n):
            out[k] = q[k]
        if slide(arm, target, world, SLIDES, 1e-5, out, work, contacts) >= 0.0:
            for k in range(n):
                memory.curve[k] = out[k]
            if accept(arm, target, world, enough, memory.curve, out, work, contacts) >= 0.0:
                return True
    if counts[POSES] < PATIENCE:
        return False
    if n <= 7 and was_walked(arm, walked, q, WIDTH):
        counts[REPEATS] += 1
        return False
    counts[REPEATS] = 0
    if n < 7:
        for k in range(n):
            work.step[k] = 0.0
        remember(walked, q, work.step, 0.0)
        return False
    counts[CURVES] += 1
    _hold_at_random(memory, q)
    arc = walk(arm, target, world, enough, 0.0, memory.held, q, out, walked, work, contacts, twist)
    counts[ARC] = arc + APART if arc >= 0 else -1.0
    return arc >= 0


@inner
def _hold_at_random(memory: Memory, q: Array) -> None:
    """Enter a curve at q (n,): hold all but seven joints."""
    n, left = q.shape[0], q.shape[0] - 7
    for k in range(n):
        memory.curve[k] = q[k]
        memory.held[k] = 1.0 if uniform(memory.random) * (n - k) < left else 0.0
        if memory.held[k] != 0.0:
            left -= 1


@kernel
def search(
    arm: Arm, world: World, pose: Array, first: Array, accuracy: float, enough: float, restarts: int,
    memory: Memory, out: Array,
) -> int:  # fmt: skip
    """Up to `restarts` restarts for a clear configuration that reaches pose (7,), into out (n,).

    Rows of first (k, n) are tried before random seeds. Poses are polished to a residual of `accuracy` metres; those
    that stall below `enough` count too (targets at a singularity). Returns FOUND, SPENT or EXHAUSTED; called again
    with the same memory it goes on, after FOUND past the configuration that was found.
    """
    n = out.shape[0]
    work, contacts, twist = scratch(n), room(), np.empty((n + 1, 6))
    target, moves, q = np.empty(12), np.empty(4), np.empty(n)
    counts = memory.counts
    read_target(pose, target)
    if counts[ARC] >= 0:
        for k in range(n):
            q[k] = memory.curve[k]
        walked = Walked(memory.walked, memory.walked_count)
        arc = walk(
            arm, target, world, enough, counts[ARC], memory.held, q, out, walked, work, contacts, twist
        )
        counts[ARC] = arc + APART if arc >= 0 else -1.0
        if arc >= 0:
            return FOUND
    for _restart in range(restarts):
        counts[RESTARTS] += 1
        if counts[STARTED] < first.shape[0]:
            for k in range(n):
                q[k] = first[int(counts[STARTED]), k]
            counts[STARTED] += 1
            reached = polish(arm, target, accuracy, q, work)
        else:
            reached = restart(arm, target, accuracy, memory.random, q, moves, work)
        counts[BEST] = min(counts[BEST], reached)
        if reached > enough * enough:
            continue
        counts[POSES] += 1
        forward(arm.frames, q, work.T)
        gap = collect(world, work.T, world.required, -HUGE, contacts)
        if gap >= world.required:
            for k in range(n):
                out[k] = q[k]
            return FOUND
        note_miss(memory, world, q, contacts)
        if _improve(arm, target, world, enough, gap - world.required, q, out, memory, work, contacts, twist):
            return FOUND
        if counts[REPEATS] >= KNOWN and n <= 7:
            return EXHAUSTED
    return SPENT
