"""Solvers say what they did, stage by stage, and an observer hears of every query."""

from __future__ import annotations

import time

import numpy as np
import pytest

from tests.ik.arms import beads
from tests.ik.lifted_arms import seven_axis
from workcell.geometry.free_space.cuboids import holds_spheres
from workcell.geometry.types import FreeSpace
from workcell.ik.ikspark.instance import instance_of
from workcell.ik.ikspark.lift import goal_vector
from workcell.ik.ikspark.obstacles.cuboids import whole_set
from workcell.ik.ikspark.rank import ascend
from workcell.ik.observing import observed
from workcell.ik.problem import Budget, IKProblem
from workcell.ik.result import IKResult
from workcell.ik.solve import solve
from workcell.ik.stages import KEPT, StageLog
from workcell.model.loading.load import load_robot
from workcell.pose import Pose


@pytest.fixture(scope="module")
def problem() -> IKProblem:
    robot = load_robot("ur10")
    q = np.array([0.3, -1.1, 1.2, 0.4, 0.9, -0.2])
    return IKProblem(robot, robot.fk(q))


@pytest.mark.parametrize("solver", ["ikspark", "cidgik"])
def test_a_convex_solver_tells_its_relaxations_down_to_the_verdict(problem: IKProblem, solver: str) -> None:
    result = solve(problem, solver=solver, budget=Budget(20.0))
    assert result.solved
    names = [stage.name for stage in result.stages]
    assert {stage.solver for stage in result.stages} == {solver}
    assert names[-1] == "verify"
    assert result.stages[-1].note == "accepted"
    solves = [stage for stage in result.stages if stage.name in ("relaxation", "rank reduction")]
    assert len(solves) == result.stats[f"{solver}.sdps"]
    assert names.count("relaxation") == result.stats[f"{solver}.restarts"]
    snapped = next(stage for stage in result.stages if stage.name.startswith("snap"))
    assert snapped.gap == solves[-1].gap < 1e-5
    assert solves[0].gap >= solves[-1].gap
    spent = sum(stage.cpu_s for stage in result.stages)
    assert spent == pytest.approx(result.stats["cpu_s"], abs=2e-3)


def test_the_portfolio_tells_each_turn_and_the_check_of_a_proof(problem: IKProblem) -> None:
    solved = solve(problem)
    assert [stage.name for stage in solved.stages][-2:] == ["sampling", "verify"]
    assert solved.stages[-2].numbers["restarts"] >= 1
    assert "restarts" in solved.stages[-2].words
    far = IKProblem(problem.robot, Pose.from_xyz([9.0, 0.0, 0.0]))
    refused = solve(far)
    assert [(stage.name, stage.note) for stage in refused.stages][-1] == ("check of the proof", "it holds")
    empty = solve(far, solver="ikspark")
    assert [stage.name for stage in empty.stages][-2:] == ["proof", "check of the proof"]
    assert "empty" in next(stage for stage in empty.stages if stage.name == "relaxation").note


def test_the_innermost_observer_hears_of_each_query(problem: IKProblem) -> None:
    outer: list[IKResult] = []
    inner: list[tuple[IKProblem, IKResult]] = []
    with observed(lambda _, result: outer.append(result)):
        first = solve(problem)
        with observed(lambda asked, result: inner.append((asked, result))):
            second = solve(problem, seed=1)
        third = solve(problem)
    solve(problem)
    assert outer == [first, third]
    assert len(inner) == 1
    assert inner[0][0] is problem
    assert inner[0][1] is second


def test_a_log_keeps_the_first_and_the_last_stages_and_adds_up_those_between() -> None:
    began = time.process_time()
    log = StageLog()
    for k in range(2 * KEPT + 50):
        log.add("relaxation", gap=1.0 / (k + 1), note=f"restart {k}")
    stages = log.stages
    assert len(stages) == 2 * KEPT + 1
    assert stages[KEPT].numbers == {"stages": 50}
    assert [stages[KEPT - 1].note, stages[KEPT + 1].note] == [f"restart {KEPT - 1}", f"restart {KEPT + 50}"]
    assert stages[-1].gap == 1.0 / (2 * KEPT + 50)
    assert 0 < sum(stage.cpu_s for stage in stages) <= time.process_time() - began


@pytest.mark.parametrize("seed", range(3))
def test_the_cuboids_that_ikspark_assigns_hold_the_spheres(seed: int) -> None:
    """Cuboids around a known configuration, and an ascent that begins there: each sphere is in the one it says."""
    robot, rng = seven_axis(), np.random.default_rng(seed)
    q = rng.uniform(-1.2, 1.2, robot.dof)
    cover = beads(robot, 0.04)
    middle = cover.centres_world(robot.link_transforms(q))[::2]
    space = FreeSpace(middle - 0.3, middle + 0.3)
    problem = IKProblem(robot, robot.fk(q), cover=cover, free_space=space)
    with instance_of(problem) as instance:
        cuboids = whole_set(instance, problem, space)
        assert cuboids is not None
        last = list(ascend(cuboids, instance.lift.lift(q)))[-1]
        assert last.rank_one
        assigned = np.array([cuboids.best()[j] for j in range(np.count_nonzero(cover.link > 0))])
        found = instance.lift.angles(last.x, goal_vector(problem.T_base_tool))
    held = holds_spheres(space, cover.centres_world(robot.link_transforms(found)), cover.radius - 1e-3)
    moving = np.flatnonzero(cover.link > 0)
    assert held[moving, assigned].all()
