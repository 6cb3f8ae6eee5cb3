"""Ever shorter paths: two trees that only hold what can be part of a path shorter than the best one known.

A node has a cost, the length of its branch. A sample comes with a budget of cost, drawn between the least that could
suffice there and the most that would still improve the best path; its parent is the nearest node from which it can be
reached within that budget. So searching the configurations and the costs together is RRT-Connect again, and repeating
it with every shorter path finds one as short as possible almost surely: Hauser and Zhou, "Asymptotically optimal
planning by feasible kinodynamic planning in a state-cost space", 2016, for the principle; Wilson, Thomason, Kingston,
Kavraki and Gammell, "AORRTC", 2025, for two trees and for parents that are looked for again. Samples are drawn where
they can help at all, from the ellipsoids of Gammell, Srinivasa and Barfoot, "Informed RRT*", 2014, one around each
goal.
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from workcell.jit import inner, kernel
from workcell.kernels.constants import HUGE
from workcell.kernels.random import RandomState, uniform
from workcell.motion.kernels.body import Body, Room, room
from workcell.motion.kernels.line import INTERVALS
from workcell.motion.kernels.straight import distance, line_is_clear
from workcell.motion.kernels.tree import (
    EDGES,
    FULL,
    ITERATIONS,
    JOINED,
    OPEN,
    tilt_upright,
    towards,
)
from workcell.pose import Array

_DRAWS = 100
"""Draws for one sample."""
_PARENTS = 4
"""Cheaper parents that are looked for, one after the other, at most."""


class Costs(NamedTuple):
    """Two trees, the start's (0) and the goals' (1), kept from one call to the next.

    Attributes:
        nodes: (2, m, n) configurations; the start, or the goals, come first.
        parents: (2, m) index of the node each was reached from; -1 for a root.
        cost: (2, m) length of the branch to each node, radians.
        roots, size: (2,) roots, and nodes in use.
        random: (1,) state of the random stream.
        tally: (3,) iterations, lines tried and configurations looked at.
    """

    nodes: Array
    parents: NDArray[np.int64]
    cost: Array
    roots: NDArray[np.int64]
    size: NDArray[np.int64]
    random: RandomState
    tally: NDArray[np.int64]


@inner
def _least(trees: Costs, side: int, q: Array) -> float:
    """Distance of q (n,) from the nearest root of a tree: no branch to q is shorter."""
    least = HUGE
    for i in range(trees.roots[side]):
        least = min(least, distance(trees.nodes[side, i], q))
    return least


@inner
def _affordable(trees: Costs, side: int, q: Array, budget: float) -> int:
    """The nearest node from which a straight line would reach q (n,) at a cost of at most `budget`; -1: none."""
    best, found = HUGE, -1
    nodes = trees.nodes
    for i in range(trees.size[side]):
        left = budget - trees.cost[side, i]
        if left < 0.0:
            continue
        square = 0.0
        for k in range(q.shape[0]):
            square += (nodes[side, i, k] - q[k]) ** 2
        if square < best and square <= left * left:
            best, found = square, i
    return found


@inner
def _add(trees: Costs, side: int, q: Array, parent: int) -> int:
    i = trees.size[side]
    for k in range(q.shape[0]):
        trees.nodes[side, i, k] = q[k]
    trees.parents[side, i] = parent
    trees.cost[side, i] = trees.cost[side, parent] + distance(trees.nodes[side, parent], q)
    trees.size[side] = i + 1
    return int(i)


@inner
def _ellipsoids(trees: Costs, bound: float, weights: Array) -> float:
    """Volumes, into weights (goals,), of the configurations on paths to each goal shorter than `bound`; their sum."""
    n, total = trees.nodes.shape[2], 0.0
    ball = math.pi ** (0.5 * n) / math.gamma(0.5 * n + 1.0)
    for i in range(weights.shape[0]):
        between = distance(trees.nodes[0, 0], trees.nodes[1, i])
        width = max(bound * bound - between * between, 0.0)
        weights[i] = ball * 0.5 * bound * (0.5 * math.sqrt(width)) ** (n - 1) if between < bound else 0.0
        total += weights[i]
    return total


@inner
def _in_ellipsoid(trees: Costs, goal: int, bound: float, q: Array) -> None:
    """A uniform draw into q (n,) from the configurations whose distances to start and goal sum to less than `bound`."""
    n, square = q.shape[0], 0.0
    for k in range(n):
        # Box and Muller's normal number
        q[k] = math.sqrt(-2.0 * math.log(1.0 - uniform(trees.random))) * math.cos(
            2.0 * math.pi * uniform(trees.random)
        )
        square += q[k] * q[k]
    scale = uniform(trees.random) ** (1.0 / n) / math.sqrt(max(square, 1e-300))
    start, end = trees.nodes[0, 0], trees.nodes[1, goal]
    between = distance(start, end)
    across = 0.5 * math.sqrt(max(bound * bound - between * between, 0.0))
    along = 0.0
    for k in range(n):
        q[k] *= scale
        along += q[k] * (end[k] - start[k]) / max(between, 1e-12)
    for k in range(n):
        stretch = (0.5 * bound - across) * along * (end[k] - start[k]) / max(between, 1e-12)
        q[k] = 0.5 * (start[k] + end[k]) + across * q[k] + stretch


@inner
def _draw(body: Body, trees: Costs, bound: float, weights: Array, total: float, q: Array, work: Room) -> bool:
    """A uniform draw from what can be part of a path shorter than `bound`, into q (n,); False where none was found."""
    n, box = q.shape[0], 1.0
    for k in range(n):
        box *= body.bounds[1, k] - body.bounds[0, k]
    for _ in range(_DRAWS):
        if total < box:
            pick, goal = total * uniform(trees.random), 0
            while goal < weights.shape[0] - 1 and pick >= weights[goal]:
                pick -= weights[goal]
                goal += 1
            _in_ellipsoid(trees, goal, bound, q)
        else:
            for k in range(n):
                q[k] = body.bounds[0, k] + (body.bounds[1, k] - body.bounds[0, k]) * uniform(trees.random)
        inside = True
        for k in range(n):
            inside = inside and body.bounds[0, k] <= q[k] <= body.bounds[1, k]
        if not inside:
            continue
        within, here = 0, distance(trees.nodes[0, 0], q)
        for i in range(weights.shape[0]):
            within += here + distance(trees.nodes[1, i], q) < bound
        # what lies in several ellipsoids is drawn more often, and kept less often
        if within == 0 or (total < box and within * uniform(trees.random) >= 1.0):
            continue
        if body.cone[6] > -2.0 and not tilt_upright(body, q, work):
            continue
        return True
    return False


@inner
def _cheaper_parents(body: Body, trees: Costs, side: int, node: int, work: Room) -> None:
    """Give a node other parents as long as random smaller budgets find some whose lines are proved."""
    q = trees.nodes[side, node]
    least = _least(trees, side, q)
    for _ in range(_PARENTS):
        budget = least + uniform(trees.random) * (trees.cost[side, node] - least)
        parent = _affordable(trees, side, q, budget)
        if parent < 0 or parent == trees.parents[side, node] or parent == node:
            return
        if not line_is_clear(body, trees.nodes[side, parent], q, trees.tally[EDGES:], work):
            return
        trees.parents[side, node] = parent
        trees.cost[side, node] = trees.cost[side, parent] + distance(trees.nodes[side, parent], q)


@inner
def _reach(
    body: Body, trees: Costs, side: int, target: Array, budget: float, length: float, q: Array, work: Room
) -> int:
    """Steps to `target` from the nearest node that can afford it; its new node, or -1 where the way is barred."""
    node = _affordable(trees, side, target, budget)
    while node >= 0 and trees.size[side] < trees.nodes.shape[1]:
        share = towards(body, trees.tally, trees.nodes[side, node], target, length, q, work)
        if share == 0.0:
            return -1
        node = _add(trees, side, q, node)
        if share < 1.0:
            return -1
        if distance(q, target) == 0.0:
            return node if trees.cost[side, node] < budget else -1
    return -1


@kernel
def improve(
    body: Body, trees: Costs, bound: float, length: float, iterations: int, meeting: NDArray[np.int64]
) -> int:
    """Grow both trees by up to `iterations` samples with steps of `length` rad, to a path shorter than `bound`.

    JOINED: `meeting` (2,) holds the node of each tree where they met. OPEN: call again to go on.
    """
    n, capacity = trees.nodes.shape[2], trees.nodes.shape[1]
    sample, q, weights = np.empty(n), np.empty(n), np.empty(trees.roots[1])
    work = room(body, INTERVALS)
    total = _ellipsoids(trees, bound, weights)
    for _ in range(iterations):
        if max(trees.size[0], trees.size[1]) >= capacity - 1:
            return FULL
        side = 0 if trees.size[0] <= trees.size[1] else 1
        trees.tally[ITERATIONS] += 1
        if total == 0.0 or not _draw(body, trees, bound, weights, total, sample, work):
            continue
        least, most = _least(trees, side, sample), bound - _least(trees, 1 - side, sample)
        node = _affordable(trees, side, sample, least + uniform(trees.random) * (most - least))
        if node < 0 or towards(body, trees.tally, trees.nodes[side, node], sample, length, q, work) == 0.0:
            continue
        new = _add(trees, side, q, node)
        _cheaper_parents(body, trees, side, new, work)
        for k in range(n):
            sample[k] = trees.nodes[side, new, k]
        met = _reach(body, trees, 1 - side, sample, bound - trees.cost[side, new], length, q, work)
        if met >= 0:
            meeting[side], meeting[1 - side] = new, met
            return JOINED
    return OPEN
