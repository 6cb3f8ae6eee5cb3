"""Same problem, same seed, same answer: whatever the clock does, and in how many processes it is asked."""

from __future__ import annotations

import json
from dataclasses import replace

import numpy as np
import pytest

from tests.ik.arms import planar, seven
from workcell import clock
from workcell.bench.ik.repeat import DOORS, busy_clock, differing
from workcell.bench.reference.generate import generate
from workcell.bench.reference.planting import random_chain
from workcell.errors import InputError
from workcell.geometry.types import Piece, SphereCover
from workcell.ik.explain.why_not import explain
from workcell.ik.problem import Budget, IKProblem
from workcell.ik.registry import auto_turns
from workcell.ik.solve import solve
from workcell.pose import Pose
from workcell.sets.problems import ProblemSet
from workcell.sets.solving import solve_set


def stopped_clock(monkeypatch):
    monkeypatch.setattr(clock, "cpu_seconds", lambda: 0.0)


def beads(robot):
    """A sphere at the end of each link."""
    links = np.arange(1, robot.dof + 1)
    return SphereCover(links, np.zeros((robot.dof, 3)), np.full(robot.dof, 0.03), kind="given")


def problems(robot, kind, n=3, seed=0):
    return generate(robot, beads(robot), kind, n, seed).problems


@pytest.mark.parametrize("kind", ["free", "random", "unreachable"])
@pytest.mark.parametrize("n", [6, 7])
def test_a_jumping_clock_changes_no_answer(n, kind):
    robot = random_chain(np.random.default_rng(n), n)
    assert differing(problems(robot, kind), DOORS["auto"][0], 3) == []


def test_a_stopped_clock_changes_no_answer(monkeypatch):
    named = problems(seven(), "random")
    budget = Budget(1e6, effort=0.3)
    plain = [solve(item.problem, budget=budget, seed=5) for item in named]
    stopped_clock(monkeypatch)
    for item, before in zip(named, plain, strict=True):
        now = solve(item.problem, budget=budget, seed=5)
        assert now.status is before.status and now.solver == before.solver and now.rejected == before.rejected
        assert (now.q is None) == (before.q is None) and (now.q is None or np.array_equal(now.q, before.q))


def walled_in():
    """A reachable pose in the midst of a ball: only what is counted can end the search for it, and no short proof."""
    robot = planar((0.4, 0.3, 0.2))
    cover = SphereCover(np.array([1, 2, 3]), np.zeros((3, 3)), np.full(3, 0.02))
    target = robot.fk(np.array([0.3, 0.5, 0.4]))
    return IKProblem(robot, target, (Piece("ball", "sphere", target, np.array([0.2])),), cover)


@pytest.mark.parametrize("solver", ["hjcd", "multistart"])
def test_effort_ends_a_hopeless_search_at_the_same_place(solver, monkeypatch):
    counts = []
    for _ in range(2):
        result = solve(walled_in(), solver, Budget(1e6, effort=0.02), seed=1)
        assert not result.solved and result.stats["timed_out"] == 0.0
        counts.append({key: value for key, value in result.stats.items() if not key.endswith("_s")})
        stopped_clock(monkeypatch)
    assert counts[0] == counts[1]


def test_seconds_end_a_query_and_say_so():
    result = solve(walled_in(), "multistart", Budget(0.02), seed=1)
    assert not result.solved and result.stats["timed_out"] == 1.0


@pytest.mark.parametrize("effort", [-1.0, float("nan")])
def test_an_effort_is_not_negative(effort):
    with pytest.raises(InputError, match="effort"):
        Budget(1.0, effort=effort)
    assert Budget(2.0, effort=1.0).shared(4) == Budget(0.5, effort=0.25)


def test_no_turn_is_timed():
    """Whose turn is next follows from the table alone: every turn but the last has its counted end."""
    for dof in (6, 7, 9):
        *turns, last = auto_turns(dof, "pose")
        assert all(np.isfinite(turn.effort) for turn in turns) and last.effort == np.inf


def test_threads_find_the_same_every_time():
    robot = random_chain(np.random.default_rng(4), 7)
    named = problems(robot, "random", n=2, seed=1)
    for item in named:
        budget = Budget(1e6, threads=3, effort=0.2)
        first, again = (solve(item.problem, "branch", budget) for _ in range(2))
        assert first.status is again.status
        assert first.stats["branch.nodes"] == again.stats["branch.nodes"]
        assert first.q is None or np.array_equal(first.q, again.q)


def test_explanations_are_the_same_by_any_clock():
    problem = walled_in()
    result = solve(problem, budget=Budget(1e6, effort=0.5))
    plain = explain(problem, result, budget=Budget(1e6))
    with busy_clock(1):
        busy = explain(problem, result, budget=Budget(1e6))
    assert plain.sentence == busy.sentence and plain.causes == busy.causes and plain.steps == busy.steps


def test_one_process_and_two_give_the_same_answers(tmp_path):
    robot = seven()
    made = generate(robot, beads(robot), "random", 4, seed=2)
    other = generate(robot, beads(robot), "unreachable", 2, seed=2)
    named = (*made.problems, *(replace(item, id=f"no {item.id}") for item in other.problems))
    lines = []
    for jobs in (1, 2):
        out = tmp_path / f"{jobs}.jsonl"
        solve_set(ProblemSet("mixed", robot, made.cover, named), jobs=jobs, seed=4, out=out)
        answers = [json.loads(line) for line in out.read_text().splitlines()]
        lines.append([{k: v for k, v in a.items() if k not in ("time_s", "cpu_s")} for a in answers])
    assert lines[0] == lines[1]


def test_what_was_asked_before_changes_nothing():
    """In another order, with what searches and cone programs keep from one problem to the next."""
    named = problems(seven(), "random", n=3, seed=7)
    for solver in ("auto", "ikspark", "cidgik"):
        budget = Budget(1e6, effort=0.1)
        one_way = {item.id: solve(item.problem, solver, budget, seed=2).q for item in named}
        for item in reversed(named):
            q = solve(item.problem, solver, budget, seed=2).q
            assert (q is None) == (one_way[item.id] is None)
            assert q is None or np.array_equal(q, one_way[item.id]), (solver, item.id)


def test_a_target_out_of_reach_ends_by_its_proof_before_any_clock():
    result = solve(IKProblem(seven(), Pose.from_xyz([5.0, 0.0, 0.0])), budget=Budget(1e-9))
    assert result.status.is_proof
