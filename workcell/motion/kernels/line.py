"""Proof that a straight line in joint space is clear: from the middle out, as far as each configuration vouches."""

from __future__ import annotations

from typing import NamedTuple

from workcell.jit import inner, kernel
from workcell.kernels.chain import forward
from workcell.kernels.coupling import follow
from workcell.motion.kernels.body import Body, Room, accelerations, lead, room, stand, twists
from workcell.motion.kernels.steps import safe_steps
from workcell.pose import Array

PROVED, BLOCKED, TIGHT, SPENT = 0, 1, 2, 3
"""Clear all along; not clear at some parameter; too near the floor there for a proof; more work than allowed."""
INTERVALS = 256
"""Open intervals of one line."""
WHOLE = 1.0 - 1e-12
"""Share of an interval that counts as all of it."""


class Verdict(NamedTuple):
    """What became of a proof.

    Attributes:
        code: `PROVED`, `BLOCKED`, `TIGHT` or `SPENT`.
        at: parameter in [0, 1] where it ended; of the smallest clearance met, when proved.
        level: lower bound on the clearance all along; of no meaning unless proved.
        gap, first, second: the smallest clearance that was met, and its pair, as in `Steps`.
        looks: configurations looked at.
    """

    code: int
    at: float
    level: float
    gap: float
    first: int
    second: int
    looks: int


@inner
def _begin(body: Body, a: Array, b: Array, work: Room) -> float:
    """Rates from a to b (n,), and what bounds them all along, into `work`; how far that is, all variables added up."""
    n, total = a.shape[0], 0.0
    if body.couple.variable.shape[0] == 0:
        for k in range(n):
            work.rate[k] = b[k] - a[k]
            work.speed[k] = abs(work.rate[k])
            work.push[k] = 0.0
            total += work.speed[k]
        return total
    for k in range(n):
        way = b[k] - a[k]
        work.lead[0, k], work.lead[1, k], work.lead[2, k] = 0.5 * (a[k] + b[k]), way, abs(way)
        work.lead[3, k], work.lead[4, k] = 0.0, 0.5 * abs(way)
        total += abs(way)
    follow(body.couple, work.lead[0], work.q, work.slope)
    lead(body, work)
    return total


@inner
def _stand_on(body: Body, a: Array, t: float, work: Room) -> None:
    """Frames and rates a share t of the way from a (n,) on, where joints follow; what `_begin` bounded stays."""
    for k in range(a.shape[0]):
        work.lead[0, k] = a[k] + t * work.lead[1, k]
    stand(body, work.lead[0], work)
    for k in range(work.q.shape[0]):
        work.rate[k] = work.slope[k] * work.lead[1, body.couple.variable[k]]


@inner
def prove_line(
    body: Body, a: Array, b: Array, keep: float, level: float, finest: float, most: int, work: Room
) -> Verdict:
    """Prove the line from a to b (n,), ends included.

    Args:
        keep, level: as in `safe_steps`.
        finest: radians (of all joints together) below which a step ends the proof.
        most: configurations to look at.
    """
    total, coupled = _begin(body, a, b, work), body.couple.variable.shape[0] > 0
    twisting = accelerations(body, work.speed, work.push, work.A)
    smallest = finest / max(total, finest)
    gap, first, second, place = 1e3, -1, -1, 0.5
    work.queue[0, 0], work.queue[0, 1] = 0.0, 1.0
    head, tail, looks, size = 0, 1, 0, work.queue.shape[0]
    while head < tail:
        begin, end = work.queue[head % size, 0], work.queue[head % size, 1]
        head += 1
        t, half = 0.5 * (begin + end), 0.5 * (end - begin)
        if coupled:
            _stand_on(body, a, t, work)
        else:
            for k in range(a.shape[0]):
                work.q[k] = a[k] + t * work.rate[k]
            forward(body.frames, work.q, work.T)
        twists(body.frames, work.T, work.rate, work.W)
        steps = safe_steps(body, work.T, work.W, work.A, twisting, half, keep, level)
        looks += 1
        if steps.gap < gap:
            gap, first, second, place = steps.gap, steps.first, steps.second, t
        if steps.forward < 0.0:
            return Verdict(BLOCKED, t, -1e3, gap, first, second, looks)
        level = steps.level
        short = min(steps.forward, steps.backward)
        if short >= half * WHOLE:
            continue
        if short < smallest:
            return Verdict(TIGHT, t, -1e3, gap, first, second, looks)
        if looks >= most or tail - head + 2 > size:
            return Verdict(SPENT, t, -1e3, gap, first, second, looks)
        if steps.backward < half * WHOLE:
            work.queue[tail % size, 0], work.queue[tail % size, 1] = begin, t - steps.backward
            tail += 1
        if steps.forward < half * WHOLE:
            work.queue[tail % size, 0], work.queue[tail % size, 1] = t + steps.forward, end
            tail += 1
    return Verdict(PROVED, place, level, gap, first, second, looks)


@kernel
def prove_lines(body: Body, points: Array, keep: float, finest: float, most: int, out: Array) -> int:
    """Prove the lines between neighbouring rows of points (k, n), until one fails.

    Into out (7,): the last verdict, with `at` as a path parameter and the smallest of levels and gaps.
    """
    level, looks = 1e3, 0
    work = room(body, 16 * INTERVALS)
    gap, place, first, second = 1e3, 0.0, -1, -1
    code = PROVED
    for i in range(points.shape[0] - 1):
        verdict = prove_line(body, points[i], points[i + 1], keep, level, finest, most - looks, work)
        code = verdict.code
        looks += verdict.looks
        if verdict.gap < gap or code != PROVED:
            gap, place, first, second = verdict.gap, i + verdict.at, verdict.first, verdict.second
        level = verdict.level
        if code != PROVED:
            place = i + verdict.at
            break
    out[0], out[1], out[2], out[3] = float(code), place, level, gap
    out[4], out[5], out[6] = float(first), float(second), float(looks)
    return code


@kernel
def gaps(body: Body, q: Array, limit: float, out: Array) -> None:
    """For configurations q (k, n) into out (k, 3): the smallest clearance, and its pair as in `Steps`.

    Pairs farther apart than `limit` metres may be passed over; 1000 m where all are.

    The body has a floor below any clearance, and no cone.
    """
    work = room(body, 1)
    for i in range(q.shape[0]):
        stand(body, q[i], work)
        steps = safe_steps(body, work.T, work.W, work.A, 0.0, 0.0, 1.0, limit)
        out[i, 0], out[i, 1], out[i, 2] = steps.gap, float(steps.first), float(steps.second)
