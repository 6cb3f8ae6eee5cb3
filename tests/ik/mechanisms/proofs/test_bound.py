"""The bound is never below F at a configuration that answers the question, whatever the multipliers."""

from dataclasses import replace

import numpy as np
import pytest

from tests.ik.mechanisms.planted import planted
from tests.ik.mechanisms.proofs.rows import at, random_multipliers
from workcell.ik.ikspark.mechanisms.hanging import ways_to_hang
from workcell.ik.mechanisms.check import asked_for, cost_bound, margin
from workcell.ik.mechanisms.proofs.bound import upper_bound
from workcell.ik.mechanisms.proofs.graph import Graph
from workcell.ik.mechanisms.proofs.hangs import ALONE, Hangs
from workcell.ik.mechanisms.proofs.sums import Sum
from workcell.model.mechanism.placing import place

SEEDS = range(50)


def alone(problem):
    return np.full(problem.mechanism.link_count, ALONE)


@pytest.mark.parametrize("seed", SEEDS)
def test_no_bound_is_below_what_rows_are_at_an_answer(seed):
    problem, q = planted(seed)
    rng, covered = np.random.default_rng(seed), asked_for(problem)
    graph = Graph.of(problem, covered)
    for by in [alone(problem), *ways_to_hang(problem, graph)]:
        for share in (0.2, 0.6, 1.0):
            m = random_multipliers(problem, rng, share)
            hangs = Hangs(problem, graph, by, float(covered[2]))
            m.chords[:] = [
                abs(rng.normal()) * (joint.kind == "hinge" and is_held(graph, hangs, k))
                for k, joint in enumerate(problem.mechanism.joints)
            ]
            value = at(problem, graph, m, q, covered)
            assert value >= -1e-12
            bound = upper_bound(graph, m, Sum(problem, graph, m, covered), hangs, covered)
            assert bound >= value - 1e-9
            assert margin(problem, m, by, covered) <= 0.0


def is_held(graph, hangs, k):
    """Whether the half-space of a hinge's limits has a place."""
    parent = int(graph.parent[k])
    own = [hangs.of(int(graph.node[link])) for link in (parent, k + 1)]
    return any(hang is not None and hang.joint == k for hang in own) or any(
        hangs.fixed(link) is not None for link in (parent, k + 1)
    )


@pytest.mark.parametrize("seed", SEEDS)
def test_without_tolerances_and_slides_in_their_place_the_sum_is_that_of_the_rows(seed):
    problem, q = planted(seed)
    graph, nothing = Graph.of(problem, np.zeros(4)), np.zeros(4)
    m = random_multipliers(problem, np.random.default_rng(seed))
    total, placed = Sum(problem, graph, m, nothing), place(problem.mechanism, q)
    value = total.constant + float(np.sum(total.N * placed.R))
    for k, joint in enumerate(problem.mechanism.joints):
        first = problem.mechanism.value_slices[k].start
        if joint.kind == "slide":
            value += q[first] * float(total.m[k] @ placed.R[k + 1] @ joint.axis)
        if joint.kind == "free":
            value += float(total.o[k] @ q[first : first + 3])
    assert value == pytest.approx(at(problem, graph, m, q, nothing), abs=1e-11)


@pytest.mark.parametrize("seed", SEEDS)
def test_reach_holds_every_link(seed):
    problem, q = planted(seed)
    placed = place(problem.mechanism, q)
    graph = Graph.of(problem, asked_for(problem))
    assert np.all(np.linalg.norm(placed.p, axis=1) <= graph.reach)
    for k, joint in enumerate(problem.mechanism.joints):
        if joint.kind == "slide":
            value = q[problem.mechanism.value_slices[k].start]
            assert graph.ends[k, 0] <= value <= graph.ends[k, 1]


@pytest.mark.parametrize("seed", range(30))
def test_no_bound_on_the_cost_is_above_the_cost(seed):
    problem, q = planted(seed, worst=0.0)
    rng, covered = np.random.default_rng(seed), asked_for(problem)
    # the same configuration, asked for somewhere else
    goals = tuple(
        goal if goal.position is None else replace(goal, position=goal.position + 0.3 * rng.normal(size=3))
        for goal in problem.goals
    )
    problem = replace(problem, goals=goals)
    placed, cost = place(problem.mechanism, q), 0.0
    for goal in goals:
        frame = problem.mechanism.frame(goal.frame)
        if goal.position is not None:
            p = placed.point(frame.link, frame.T_link_frame.position)
            cost += float(np.sum((p - goal.position) ** 2))
        if goal.rotation is not None:
            R = placed.R[frame.link] @ frame.T_link_frame.rotation
            cost += float(np.sum((R - goal.rotation) ** 2))
    near = float(np.sqrt(cost))
    graph = Graph.of(problem, covered, near=near)
    for by in [alone(problem), *ways_to_hang(problem, graph, reached=False)]:
        for share in (0.2, 1.0):
            m = random_multipliers(problem, rng, share)
            for scale in (1e-3, 1e-1, 1.0):
                scaled = type(m)(**{name: scale * part for name, part in m.parts().items()})
                assert cost_bound(problem, scaled, by, covered, near) <= cost


@pytest.mark.parametrize("seed", range(25))
def test_nodes_may_hang_by_whatever_holds_them(seed):
    problem, q = planted(seed)
    rng, covered = np.random.default_rng(seed), asked_for(problem)
    graph, placed = Graph.of(problem, covered), place(problem.mechanism, q)
    n, c, g = graph.joints, len(problem.mechanism.closures), len(problem.goals)
    held = 0
    for _ in range(12):
        by = np.where(rng.uniform(size=n + 1) < 0.2, ALONE, rng.integers(0, 2 * n + c + g, n + 1))
        hangs = Hangs(problem, graph, by, float(covered[2]))
        for node in np.unique(graph.node).tolist():
            try:
                hang = hangs.of(node)
            except ValueError:
                by[node] = ALONE
                hangs = Hangs(problem, graph, by, float(covered[2]))
                continue
            if hang is None:
                continue
            # the node is where it is said to be, for one angle at least
            held += 1
            root = np.eye(3)
            if hang.goal >= 0:
                frame = problem.mechanism.frame(problem.goals[hang.goal].frame)
                link = int(graph.node[frame.link])
                root = placed.R[link]
            least = farthest(hang, root.T @ placed.R[node] @ hang.C.T)
            assert least <= hang.off + 1e-9
        m = random_multipliers(problem, rng, 0.7)
        try:
            bound = upper_bound(graph, m, Sum(problem, graph, m, covered), hangs, covered)
        except ValueError:
            continue
        assert bound >= at(problem, graph, m, q, covered) - 1e-9
    assert held > 0


def farthest(hang, turned):
    """Frobenius norm between a rotation and the nearest one about the axis (or none)."""
    if hang.axis is None:
        return float(np.linalg.norm(turned - np.eye(3)))
    d = hang.axis
    skew = np.array([[0.0, -d[2], d[1]], [d[2], 0.0, -d[0]], [-d[1], d[0], 0.0]])
    along = float(d @ turned @ d)
    angle = np.arctan2(float(np.sum(turned * skew)), float(np.trace(turned)) - along)
    nearest = np.eye(3) + np.sin(angle) * skew + (1.0 - np.cos(angle)) * skew @ skew
    return float(np.linalg.norm(turned - nearest))
