"""Dual multipliers of a mechanism's relaxation as certificates: the solver's rows translated into the checker's.

Whatever reaches all goals makes every row of the relaxation zero, not negative, or a point of its cone. So does, for
multipliers in the dual cone, their sum F. A solver that has substituted some rows (rotations that goals and welds
give, axes of planar links) has no multipliers of theirs; the checker needs none of what is known, and those of welds
follow from the others. Nothing here needs to be exact: the checker bounds whatever it is given.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace

import numpy as np

from workcell.ik.certificate import Certificate
from workcell.ik.ikspark.mechanisms.hanging import By, hang_on, rigid, ways_to_hang
from workcell.ik.mechanisms.check import (
    COST_KIND,
    KIND,
    SCOPE,
    asked_for,
    check_cost,
    cost_bound,
    margin,
)
from workcell.ik.mechanisms.hashing import mechanism_hash
from workcell.ik.mechanisms.problem import MechanismProblem
from workcell.ik.mechanisms.proofs.graph import Graph, unsuited
from workcell.ik.mechanisms.proofs.hangs import Hangs
from workcell.ik.mechanisms.proofs.multipliers import Multipliers, misplaced
from workcell.ik.mechanisms.proofs.sums import Sum
from workcell.ik.mechanisms.proofs.words import nothing_is_closer, nothing_reaches
from workcell.pose import Array

Duals = Mapping[tuple[str, int], Array]
"""Multipliers of rows by family and index: axis, limit, chord, ball, closure, weld, position, rotation, ..."""


def certify_empty(
    problem: MechanismProblem, multipliers: Duals, planar: Sequence[int] | None = None
) -> Certificate | None:
    """A certificate of kind `mechanism/1` from multipliers, or None if they are too weak.

    Args:
        problem: the question.
        multipliers: z_i by (family, index), so that `sum z_i . f_i >= 0` wherever rows `f_i = 0`, `f_i >= 0` and
            `(t, v)` with |v| <= t hold: free of equalities, not negative of inequalities, (t, v) with |v| <= t of
            cones. Families that are missing count as zero, families that no proof rests on (user, sum) are left out.
        planar: (links,) for each link the known link (0, or one whose rotation a goal gives) that it hangs on by
            hinges of one direction in the solver's model, -1 for none; None: what is found here, from either side.
    """
    covered = asked_for(problem)
    if unsuited(problem, covered) is not None:
        return None
    m = _multipliers(problem, multipliers).scaled()
    if m is None:
        return None
    graph = Graph.of(problem, covered)
    choices = [hang_on(problem, graph, planar)] if planar is not None else []
    tried = [
        (margin(problem, completed, by, covered), completed, by)
        for by in [*choices, *ways_to_hang(problem, graph)]
        for completed in [_completed(problem, graph, m, by, covered)]
    ]
    found, best, by = max(tried, key=lambda each: each[0])
    if not found > 0.0 or misplaced(problem, best) is not None:
        return None
    words = nothing_reaches(problem, covered)
    return Certificate(
        KIND, SCOPE, words, found, mechanism_hash(problem), _data(best.scaled() or best, by, covered)
    )


def certify_cost(problem: MechanismProblem, g: Array, multipliers: Duals) -> tuple[float, Certificate] | None:
    """A lower bound on the squared pose error with its certificate of kind `mechanism_cost/1`; None if it is none.

    With e the errors of all goals' positions and rotations, `|e|^2 >= 2 <g, e> - |g|^2`, and 2 <g, e> is bounded from
    below over all that the other rows allow.

    Args:
        problem: the question.
        g: (goals, 12) about the errors at the closest point: of the rotation (9, row by row), then of the position (3).
        multipliers: of all other rows, as in `certify_empty`, of the minimum of |e|^2 over them: at it
            `2 <g, e> - sum z_i . f_i` is least too.
    """
    covered, near = asked_for(problem), float(np.linalg.norm(g))
    if unsuited(problem, covered, near=near) is not None:
        return None
    posed = np.array([goal.position is not None for goal in problem.goals], dtype=bool)
    turned = np.array([goal.rotation is not None for goal in problem.goals], dtype=bool)
    errors = np.asarray(g, dtype=float).reshape(len(problem.goals), 12)
    poses = Multipliers.none(problem)
    poses.positions[:] = -2.0 * errors[:, 9:] * posed[:, None]
    poses.rotations[:] = -2.0 * errors[:, :9].reshape(-1, 3, 3) * turned[:, None, None]
    graph = Graph.of(problem, covered, near=near)
    others = _multipliers(problem, multipliers)
    choices = [
        (poses, others),
        (_above(poses, _SMALL), _above(others, _SMALL)),
        (_above(poses, _SMALL), None),
    ]
    tried = [
        _longest(problem, _completed(problem, graph, m, by, covered, reached=False), by, covered, near)
        for asked, held in choices
        for m in [replace(held or asked, positions=asked.positions, rotations=asked.rotations)]
        for by in ways_to_hang(problem, graph, reached=False)
    ]
    found, best, by = max(tried, key=lambda each: each[0])
    bound = min(found, near * near) * (1.0 - 1e-9)
    if not bound > 0.0:
        return None
    words = nothing_is_closer(problem, covered, bound)
    certificate = Certificate(
        COST_KIND, SCOPE, words, bound, mechanism_hash(problem), _data(best, by, covered)
    )
    return (bound, certificate) if check_cost(problem, certificate) is not None else None


def _longest(
    problem: MechanismProblem, m: Multipliers, by: By, covered: Array, near: float
) -> tuple[float, Multipliers, By]:
    """The best bound by multiples of given multipliers: with U of F, t times them prove `-t^2 |g|^2 - t U`."""
    squared = 0.25 * float(np.sum(m.positions**2) + np.sum(m.rotations**2))
    bound = cost_bound(problem, m, by, covered, near)
    if not (squared > 0.0 and np.isfinite(bound) and bound + squared > 0.0):
        return bound, m, by
    t = 0.5 * (bound + squared) / squared
    longer = Multipliers(**{name: t * part for name, part in m.parts().items()})
    return max(
        (bound, m, by), (cost_bound(problem, longer, by, covered, near), longer, by), key=lambda each: each[0]
    )


def _data(m: Multipliers, by: By, covered: Array) -> dict[str, Array]:
    return {**m.parts(), "hangs": by.astype(float), "tolerances": covered}


_FIELDS = {
    "axis": "axes",
    "limit": "limits",
    "chord": "chords",
    "ball": "turns",
    "closure": "closures",
    "weld": "welds",
    "position": "positions",
    "rotation": "rotations",
    "direction": "directions",
    "cone": "cones",
    "ball step": "steps",
    "turn": "links",
    "free turn": "links",
}
"""The array of each family of rows."""
_TRACE = 1e-13
"""Part of the largest multiplier below which one is none."""
_SMALL = 1e-6
"""Part of it below which one may be an inaccuracy of the solver's."""
_CONES = ("limit", "ball", "ball step")
_BELOW_ZERO = ("chord", "cone", "turn", "free turn")


def _multipliers(problem: MechanismProblem, duals: Duals) -> Multipliers:
    """The checker's arrays; what is outside of the dual cone is cut off."""
    m = Multipliers.none(problem)
    for (family, index), values in duals.items():
        z = np.asarray(values, dtype=float).ravel()
        if family in ("region", "region equal"):
            first = sum(len(region.b) for region in problem.regions[:index])
            equal = problem.regions[index].equal == (family == "region equal")
            m.regions[first + np.flatnonzero(equal)] = z if family == "region equal" else np.maximum(z, 0.0)
        elif family in _FIELDS:
            array = getattr(m, _FIELDS[family])
            z = z[1:] if family in _CONES else z
            z = np.maximum(z, 0.0) if family in _BELOW_ZERO else z
            # the rotation of a floating body is that of the link it moves
            array[index + (family == "free turn")] += z.reshape(array.shape[1:])
    return _above(m, _TRACE)


def _above(m: Multipliers, part: float) -> Multipliers:
    """Without those below a part of the largest, which what nothing bounds would make infinite."""
    least = part * max(float(np.abs(each).max(initial=0.0)) for each in m.parts().values())
    return Multipliers(
        **{name: np.where(np.abs(each) > least, each, 0.0) for name, each in m.parts().items()}
    )


def _completed(
    problem: MechanismProblem, graph: Graph, m: Multipliers, by: By, covered: Array, *, reached: bool = True
) -> Multipliers:
    """Multipliers for a choice of what nodes hang by: none of rotations that are known, and welds pass on the rest.

    A multiplier of a weld (or of a locked joint) that leaves nothing of one of its nodes is never worse than another:
    the largest `<N + N', R>` is no larger than that of N and that of N' together.
    """
    joints, ties = graph.joints, len(problem.mechanism.closures)
    first = joints + ties + len(problem.goals)
    rotations, welds, turns = (np.array(part) for part in (m.rotations, m.welds, m.turns))
    rotations[[b - joints - ties for b in by.tolist() if joints + ties <= b < first]] = 0.0
    passed_on = _rigid_and_turning(problem, graph, by, reached)
    welds[[way - joints for way, _ in passed_on if way < first]] = 0.0
    m = replace(
        m, rotations=rotations, welds=welds, turns=turns, chords=_held(problem, graph, m, by, reached)
    )
    for way, last in passed_on:
        total = Sum(problem, graph, replace(m, welds=welds, turns=turns), covered, reached=reached)
        N = np.zeros((3, 3))
        for link in np.flatnonzero(graph.node == last):
            N += total.N[link] @ graph.inner[link].T
        if way < first:
            closure = problem.mechanism.closures[way - joints]
            side = int(graph.node[closure.links[1]] == last)
            W = N @ graph.inner[closure.links[side]] @ closure.frames[side].rotation
            welds[way - joints] = W if side else -W
        elif last == (k := way - first) + 1:
            turns[k] += N
        else:
            turns[k] -= N @ graph.inner[graph.parent[k]] @ graph.rest[k]
    return replace(m, welds=welds, turns=turns)


def _held(problem: MechanismProblem, graph: Graph, m: Multipliers, by: By, reached: bool) -> Array:
    """Half-spaces of joints' limits, of those that a node hangs by or that are next to a known rotation."""
    hangs, kept = Hangs(problem, graph, by, 0.0, reached), np.zeros_like(m.chords)
    for k in np.flatnonzero(m.chords > 0.0).tolist():
        parent = int(graph.parent[k])
        nodes = int(graph.node[parent]), k + 1
        if any((hang := hangs.of(node)) is not None and hang.joint == k for node in nodes) or any(
            hangs.fixed(link) is not None for link in (parent, k + 1)
        ):
            kept[k] = m.chords[k]
    return kept


def _rigid_and_turning(
    problem: MechanismProblem, graph: Graph, by: By, reached: bool
) -> list[tuple[int, int]]:
    """What makes one rotation of several nodes that are not known: (what, node that passes on), leaves first."""
    hangs, edges = Hangs(problem, graph, by, 0.0, reached), rigid(problem, graph)
    turning = [node for node in np.unique(graph.node).tolist() if hangs.fixed(node) is None]
    # what hangs by a hinge has a half-space of its limits, and keeps all
    starts = sorted(turning, key=lambda node: not 0 <= by[node] < graph.joints)
    seen: set[int] = set()
    passed: list[tuple[int, int]] = []
    for start in starts:
        frontier = [] if start in seen else [start]
        seen.add(start)
        for node in frontier:
            for way, *links in edges:
                a, b = (int(graph.node[link]) for link in links)
                for here, there in ((a, b), (b, a)):
                    if here == node and there not in seen and there in turning:
                        seen.add(there)
                        frontier.append(there)
                        passed.append((way, there))
    return passed[::-1]
