"""CIDGIK's Algorithm 1 as the paper runs it: one start, ten cone programs at most."""

from __future__ import annotations

import numpy as np
import pytest

from workcell.bench.ik.cidgik import one_start_row
from workcell.bench.reference.cidgik_problems import (
    POINT_RADIUS,
    bench_arm,
    environment,
    joint_points,
    random_problems,
)
from workcell.bench.reference.one_start import ITERATIONS, LOW_RANK, run_one_start
from workcell.ik.cidgik.instance import Instance
from workcell.ik.problem import IKProblem


def _problems(robot: str, surroundings: str, n: int) -> list[IKProblem]:
    arm = bench_arm(robot)
    return random_problems(arm, joint_points(arm), *environment(surroundings), n, seed=3)


@pytest.mark.parametrize("surroundings", ["free", "icosahedron"])
def test_ten_cone_programs_at_most_and_no_other_start(
    surroundings: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    objectives: list[np.ndarray] = []
    solve = Instance.solve

    def counted(self: Instance, C: np.ndarray) -> object:
        objectives.append(C)
        return solve(self, C)

    monkeypatch.setattr(Instance, "solve", counted)
    monkeypatch.setattr(Instance, "random_objective", None)
    for problem in _problems("ur10", surroundings, 25):
        objectives.clear()
        run = run_one_start(problem)
        assert 1 <= len(objectives) == len(run.gaps) <= ITERATIONS
        # C = I over the points, then Problem 5's: projections onto the points' smallest directions
        assert not np.allclose(objectives[0], objectives[-1]) or len(objectives) == 1


@pytest.mark.parametrize("surroundings", ["free", "cube"])
def test_the_excess_rank_never_grows(surroundings: str) -> None:
    # h(Z') <= <C, Z'> <= <C, Z> = h(Z) for the C of Problem 5 at Z and the Z' of Problem 4 at C
    for problem in _problems("ur10", surroundings, 25):
        gaps = np.array(run_one_start(problem).gaps)
        assert np.all(np.diff(gaps) < 1e-4)


def test_points_of_low_rank_are_configurations_that_keep_clear() -> None:
    reached = 0
    for problem in _problems("ur10", "octahedron", 30):
        run = run_one_start(problem)
        if run.q is None or run.gaps[-1] > LOW_RANK:
            continue
        reached += 1
        assert problem.cover is not None
        position, rotation = problem.robot.fk(run.q).error_to(problem.target)
        assert position < 1e-2 and rotation < 1e-2
        points = problem.cover.centres_world(problem.robot.link_transforms(run.q))
        for piece in problem.obstacles:
            distance = np.linalg.norm(points - piece.pose.position, axis=1)
            assert distance.min() > piece.size[0] + POINT_RADIUS - 1e-2
    assert reached >= 10


def test_the_row_counts_what_the_paper_counts() -> None:
    row = one_start_row("kuka/cube/one start (paper)", _problems("kuka", "cube", 12), 0.992)
    assert row["success_paper_tolerance"] >= row["success"] and row["success_paper_tolerance"] > 0.9
    assert row["sdps_mean"] <= ITERATIONS and row["paper"] == 0.992


def test_fewer_iterations_can_be_asked_for() -> None:
    for problem in _problems("ur10", "free", 5):
        assert len(run_one_start(problem, 1).gaps) == 1
