"""Which nodes of a mechanism hang, by hinges of one direction and by what is rigid, on rotations that are known.

What a node hangs by is written as in certificates (docs/proofs.md, 12.5): a joint's index, then ties, then goals, then
joints again that hold it in the middle of their range.
"""

from __future__ import annotations

from collections import deque
from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from workcell.ik.mechanisms.problem import MechanismProblem
from workcell.ik.mechanisms.proofs.graph import Graph
from workcell.ik.mechanisms.proofs.hangs import ALONE, Hangs
from workcell.model.mechanism.mechanism import WORLD

LOCKED = 1e-5
"""Radians to either side that a joint that counts as locked may turn."""
_DEPARTURE = 1e-4
"""Frobenius norm by which a node that counts as planar may depart from that, locked joints among what it hangs by."""

By = NDArray[np.int64]
"""(links,) what every node hangs by."""


def rigid(problem: MechanismProblem, graph: Graph) -> list[tuple[int, int, int]]:
    """(what it hangs by, link, link) of everything that makes one rotation of two: welds and locked joints."""
    closures, first = problem.mechanism.closures, graph.joints + len(problem.mechanism.closures)
    welds = [(graph.joints + c, *tie.links) for c, tie in enumerate(closures) if tie.kind == "weld"]
    locked = [
        (first + len(problem.goals) + k, int(graph.parent[k]), k + 1)
        for k in range(graph.joints)
        if graph.kinds[k] in ("hinge", "ball") and graph.half[k] <= LOCKED
    ]
    return [(way, a, b) for way, a, b in welds + locked if graph.node[a] != graph.node[b]]


def ways_to_hang(problem: MechanismProblem, graph: Graph, *, reached: bool = True) -> list[By]:
    """What every node hangs by: on the nearest known one, on the world first, on the goals first."""
    goals = _goals(problem, graph) if reached else {}
    orders = [[[WORLD, *goals]]]
    if goals:
        orders += [[[WORLD], [*goals]], [[*goals], [WORLD]]]
    chosen: list[By] = []
    for order in orders:
        by = _spread(problem, graph, goals, order, reached=reached)
        if not any(np.array_equal(by, other) for other in chosen):
            chosen.append(by)
    return chosen


def hang_on(problem: MechanismProblem, graph: Graph, planar: Sequence[int]) -> By:
    """What every node hangs by where (links,) tells which known link it hangs on, -1 for none."""
    goals = _goals(problem, graph)
    on = {int(graph.node[link]): int(graph.node[known]) for link, known in enumerate(planar) if known >= 0}
    return _spread(problem, graph, goals, [[root] for root in (WORLD, *goals)], on)


def _goals(problem: MechanismProblem, graph: Graph) -> dict[int, int]:
    """Nodes whose rotation a goal gives, and the goal; what is rigid with the world needs none."""
    found: dict[int, int] = {}
    for g, goal in enumerate(problem.goals):
        if goal.rotation is not None:
            found.setdefault(int(graph.node[problem.mechanism.frame(goal.frame).link]), g)
    fixed, pairs = [WORLD], [(int(graph.node[a]), int(graph.node[b])) for _, a, b in rigid(problem, graph)]
    for node in fixed:
        fixed += [y for a, b in pairs for x, y in ((a, b), (b, a)) if x == node and y not in fixed]
    return {node: g for node, g in found.items() if node not in fixed}


def _spread(
    problem: MechanismProblem,
    graph: Graph,
    goals: dict[int, int],
    order: Sequence[Sequence[int]],
    on: dict[int, int] | None = None,
    *,
    reached: bool = True,
) -> By:
    """Outwards from groups of roots in turn, over what is rigid first; a goal's own node hangs by the goal."""
    first = graph.joints + len(problem.mechanism.closures)
    by = np.full(graph.joints + 1, ALONE)
    for node, g in goals.items():
        by[node] = first + g
    taken, ways = {WORLD, *goals}, _ways(problem, graph)
    hangs = Hangs(problem, graph, by, 0.0, reached)
    for roots in order:
        queue = deque((there, way, root) for root in roots for there, way in ways.get(root, []))
        # what is rigid before all hinges
        queue = deque(sorted(queue, key=lambda each: each[1] < graph.joints))
        while queue:
            there, way, root = queue.popleft()
            turns = way < graph.joints
            if there in taken or (on is not None and turns and on.get(there, ALONE) != root):
                continue
            hang = hangs.tried(there, way)
            if hang is None or hang.off > _DEPARTURE:
                hangs.tried(there, ALONE)
                continue
            taken.add(there)
            for beyond, over in ways.get(there, []):
                if over < graph.joints:
                    queue.append((beyond, over, root))
                else:
                    queue.appendleft((beyond, over, root))
    return by


def _ways(problem: MechanismProblem, graph: Graph) -> dict[int, list[tuple[int, int]]]:
    """For every node the nodes next to it, and over what."""
    hinges = [(k, int(graph.parent[k]), k + 1) for k in range(graph.joints) if graph.kinds[k] == "hinge"]
    ways: dict[int, list[tuple[int, int]]] = {}
    for way, a, b in [*rigid(problem, graph), *hinges]:
        one, two = int(graph.node[a]), int(graph.node[b])
        ways.setdefault(one, []).append((two, way))
        ways.setdefault(two, []).append((one, way))
    return ways
