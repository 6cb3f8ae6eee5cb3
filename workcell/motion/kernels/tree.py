"""RRT-Connect (Kuffner and LaValle, 2000) from one start to any of many goals, with edges proved when added.

An edge ends before the first of a few samples that touches something. The smaller tree grows, so that a tree that is
walled in gets the samples that it takes to come out. Nodes that keep failing draw samples from near by only (dynamic
domains: Yershova, Jaillet, Simeon, LaValle, 2005, with the adaptive radius of Jaillet et al., 2005).
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from workcell.jit import inner, kernel
from workcell.kernels.constants import HUGE
from workcell.kernels.coupling import gather
from workcell.kernels.random import RandomState, uniform
from workcell.motion.kernels.body import Body, Room, room, stand
from workcell.motion.kernels.line import INTERVALS, PROVED, prove_line
from workcell.motion.kernels.touch import free_samples
from workcell.pose import Array

JOINED, OPEN, FULL = 1, 0, -1
"""The trees met; the iterations are over; there is no room for more nodes."""
FINEST, MOST = 1e-4, 400
"""Radians below which an edge counts as too tight, and configurations of one edge that are looked at."""
_ADAPT = 0.05
"""Relative change of a node's radius at each success or failure."""
_NEAR, _LEAST = 4.0, 1.0
"""Radius of a node's domain after its first failure, and the least it may shrink to, in steps."""
SAMPLES = 4
"""Samples of a whole step that are looked at before it is proved."""
ITERATIONS, EDGES, LOOKS = 0, 1, 2
"""Places in `Trees.tally`."""


class Trees(NamedTuple):
    """Two trees, the start's (0) and the goals' (1), kept from one call to the next.

    Attributes:
        nodes: (2, m, n) configurations.
        parents: (2, m) index of the node each was reached from; -1 for a root.
        radius: (2, m) of each node's domain, in radians; inf before its first failure.
        size: (2,) nodes in use.
        random: (1,) state of the random stream.
        tally: (3,) iterations, edges tried and configurations looked at.
    """

    nodes: Array
    parents: NDArray[np.int64]
    radius: Array
    size: NDArray[np.int64]
    random: RandomState
    tally: NDArray[np.int64]


@inner
def _nearest(trees: Trees, side: int, q: Array) -> tuple[int, float]:
    """The node nearest to q (n,), and its distance."""
    best, found = HUGE, 0
    nodes = trees.nodes
    for i in range(trees.size[side]):
        square = 0.0
        for k in range(q.shape[0]):
            square += (nodes[side, i, k] - q[k]) ** 2
        if square < best:
            best, found = square, i
    return found, math.sqrt(best)


@inner
def _add(trees: Trees, side: int, q: Array, parent: int) -> int:
    i = trees.size[side]
    for k in range(q.shape[0]):
        trees.nodes[side, i, k] = q[k]
    trees.parents[side, i] = parent
    trees.radius[side, i] = np.inf
    trees.size[side] = i + 1
    return int(i)


@inner
def tilt_upright(body: Body, q: Array, work: Room) -> bool:
    """Move q (n,) the short way until the tool's axis lies in its cone; False where that fails.

    Newton's method on the cosine along its gradient, aimed a little inside the cone.
    """
    n, m, cone = q.shape[0], work.T.shape[0] - 2, body.cone
    coupled = body.couple.variable.shape[0] > 0
    wanted = cone[6] + 0.02 * (1.0 - cone[6])
    for _ in range(30):
        stand(body, q, work)
        T = work.T
        x = T[m + 1, 0] * cone[0] + T[m + 1, 1] * cone[1] + T[m + 1, 2] * cone[2]
        y = T[m + 1, 3] * cone[0] + T[m + 1, 4] * cone[1] + T[m + 1, 5] * cone[2]
        z = T[m + 1, 6] * cone[0] + T[m + 1, 7] * cone[1] + T[m + 1, 8] * cone[2]
        missing = wanted - (x * cone[3] + y * cone[4] + z * cone[5])
        if missing <= 0.0:
            return True
        # d cosine / dq_k = axis_k . (tool axis x direction)
        cx, cy, cz = y * cone[5] - z * cone[4], z * cone[3] - x * cone[5], x * cone[4] - y * cone[3]
        square = 0.0
        for k in range(m):
            work.push[k] = 0.0
            if body.frames[k + 1, 12] == 0.0:
                work.push[k] = T[k + 1, 2] * cx + T[k + 1, 5] * cy + T[k + 1, 8] * cz
        if coupled:
            gather(body.couple, work.slope, work.push, work.lead[3])
        else:
            for k in range(n):
                work.lead[3, k] = work.push[k]
        for k in range(n):
            square += work.lead[3, k] * work.lead[3, k]
        if square < 1e-10:
            return False
        share = min((missing + 1e-6) / square, 0.5 / math.sqrt(square))
        for k in range(n):
            q[k] = min(max(q[k] + share * work.lead[3, k], body.bounds[0, k]), body.bounds[1, k])
    return False


@inner
def towards(
    body: Body, tally: NDArray[np.int64], here: Array, target: Array, length: float, q: Array, work: Room
) -> float:
    """Into q (n,) a configuration at most `length` from `here` towards `target`, as far as samples of the way allow.

    Returns the share of the step that was made, if the way is proved; 1: all of it; 0: no step.
    """
    n, square = q.shape[0], 0.0
    for k in range(n):
        square += (target[k] - here[k]) ** 2
    distance = math.sqrt(square)
    share = min(1.0, length / max(distance, 1e-12))
    for k in range(n):
        q[k] = target[k] if share == 1.0 else here[k] + share * (target[k] - here[k])
    if body.cone[6] > -2.0 and share < 1.0:
        if not tilt_upright(body, q, work):
            return 0.0
        left = 0.0
        for k in range(n):
            left += (target[k] - q[k]) ** 2
        if math.sqrt(left) > distance - 0.1 * length:
            return 0.0
    tally[EDGES] += 1
    samples = max(math.ceil(SAMPLES * share * distance / length), 1)
    free = free_samples(body, here, q, samples, work)
    tally[LOOKS] += min(free + 1, samples)
    if free == 0:
        return 0.0
    if free < samples:
        for k in range(n):
            q[k] = here[k] + free / samples * (q[k] - here[k])
    verdict = prove_line(body, here, q, 0.0, body.floor, FINEST, MOST, work)
    tally[LOOKS] += verdict.looks
    return free / samples if verdict.code == PROVED else 0.0


@inner
def _draw(body: Body, trees: Trees, q: Array, work: Room) -> bool:
    """A random configuration within the limits (and with the tool in its cone), into q (n,)."""
    for k in range(q.shape[0]):
        q[k] = body.bounds[0, k] + (body.bounds[1, k] - body.bounds[0, k]) * uniform(trees.random)
    return body.cone[6] <= -2.0 or tilt_upright(body, q, work)


@inner
def _reach(body: Body, trees: Trees, side: int, target: Array, length: float, q: Array, work: Room) -> int:
    """Steps from the nearest node to `target`; its new node, or -1 where the way is barred."""
    node, _ = _nearest(trees, side, target)
    while trees.size[side] < trees.nodes.shape[1]:
        share = towards(body, trees.tally, trees.nodes[side, node], target, length, q, work)
        if share == 0.0:
            return -1
        node = _add(trees, side, q, node)
        if share < 1.0:
            return -1
        square = 0.0
        for k in range(q.shape[0]):
            square += (target[k] - q[k]) ** 2
        if square == 0.0:
            return node
    return -1


@kernel
def grow(body: Body, trees: Trees, length: float, iterations: int, meeting: NDArray[np.int64]) -> int:
    """Grow both trees by up to `iterations` samples with steps of `length` radians.

    JOINED: `meeting` (2,) holds the node of each tree where they met. OPEN: call again to go on.
    """
    n, capacity = trees.nodes.shape[2], trees.nodes.shape[1]
    sample, q = np.empty(n), np.empty(n)
    work = room(body, INTERVALS)
    for _ in range(iterations):
        if max(trees.size[0], trees.size[1]) >= capacity - 1:
            return FULL
        side = 0 if trees.size[0] <= trees.size[1] else 1
        trees.tally[ITERATIONS] += 1
        if not _draw(body, trees, sample, work):
            continue
        node, distance = _nearest(trees, side, sample)
        if distance > trees.radius[side, node]:
            continue
        if towards(body, trees.tally, trees.nodes[side, node], sample, length, q, work) == 0.0:
            radius = trees.radius[side, node]
            trees.radius[side, node] = (
                _NEAR * length if radius == np.inf else max(radius * (1.0 - _ADAPT), _LEAST * length)
            )
            continue
        trees.radius[side, node] *= 1.0 + _ADAPT
        new = _add(trees, side, q, node)
        for k in range(n):
            sample[k] = trees.nodes[side, new, k]
        met = _reach(body, trees, 1 - side, sample, length, q, work)
        if met >= 0:
            meeting[side], meeting[1 - side] = new, met
            return JOINED
    return OPEN
