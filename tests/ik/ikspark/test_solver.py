"""IKSPARK finds configurations by convex optimisation alone, keeps bounds, avoids obstacles, hides no failure."""

from __future__ import annotations

import functools
from dataclasses import replace

import numpy as np
import pytest

from tests.ik import reaching
from tests.ik.arms import beads, box
from tests.ik.lifted_arms import X, Y, Z, arm, parallel_elbow, scara, seven_axis, skew_arm
from workcell.errors import InputError
from workcell.ik.ikspark.solver import solve_ikspark
from workcell.ik.judge.verify import verify
from workcell.ik.problem import Budget, IKProblem
from workcell.ik.shared.polish import polish
from workcell.model.robot import Robot
from workcell.pose import Pose

BUDGET = Budget(10.0)


assert_reached = functools.partial(reaching.assert_reached, solve_ikspark)


@pytest.mark.parametrize(
    "robot",
    [seven_axis(), parallel_elbow(), *(skew_arm(n + 20, n) for n in (4, 5, 6, 7, 10))],
    ids=lambda robot: f"{robot.name}{robot.dof}",
)
def test_reachable_poses(robot: Robot) -> None:
    rng = np.random.default_rng(5)
    for _ in range(3):
        problem = IKProblem(robot, robot.fk(robot.random_configuration(rng)))
        assert_reached(problem)


@pytest.mark.parametrize(
    "robot", [skew_arm(31, 1), skew_arm(32, 2), skew_arm(33, 3), scara()], ids=lambda r: f"{r.dof}"
)
def test_short_chains(robot: Robot) -> None:
    rng = np.random.default_rng(6)
    for _ in range(3):
        problem = IKProblem(robot, robot.fk(robot.random_configuration(rng)))
        assert_reached(problem)


def test_a_long_chain() -> None:
    robot = skew_arm(3, 20)
    assert_reached(IKProblem(robot, robot.fk(robot.random_configuration(np.random.default_rng(0)))))


def test_the_base_may_stand_anywhere() -> None:
    base = Pose(np.array([2.0, -1.0, 0.3]), np.array([0.5, -0.5, 0.5, 0.5]))
    robot = replace(seven_axis(), T_world_base=base)
    assert_reached(IKProblem(robot, robot.fk(robot.random_configuration(np.random.default_rng(1)))))


def test_same_seed_same_answer_whatever_was_solved_before() -> None:
    robot, rng = seven_axis(), np.random.default_rng(9)
    problem, other = (IKProblem(robot, robot.fk(robot.random_configuration(rng))) for _ in range(2))
    first = assert_reached(problem, seed=4)
    assert_reached(other, seed=1)
    assert np.array_equal(first, assert_reached(problem, seed=4))


def test_answers_are_unwrapped_into_the_limits() -> None:
    robot = replace(seven_axis(), lower=np.full(7, 1.0), upper=np.full(7, 7.0))
    q = robot.random_configuration(np.random.default_rng(2))
    found = assert_reached(IKProblem(robot, robot.fk(q)))
    assert np.all((found >= 1.0) & (found <= 7.0))


def test_next_to_a_reference_within_a_step() -> None:
    robot, rng = seven_axis(), np.random.default_rng(3)
    for _ in range(5):
        reference = rng.uniform(-2.0, 2.0, 7)
        target = robot.fk(reference + rng.uniform(-0.05, 0.05, 7))
        problem = IKProblem(robot, target, q_reference=reference, max_step=0.08, max_link_rotation=0.5)
        assert np.abs(assert_reached(problem) - reference).max() <= 0.08 + 1e-9
    assert solve_ikspark(problem, BUDGET, 0).stats["sdps"] <= 4


def test_a_reference_outside_the_limits_is_a_result() -> None:
    robot = seven_axis(1.0)
    problem = IKProblem(robot, robot.fk(np.zeros(7)), q_reference=np.full(7, 2.0), max_step=0.1)
    candidate = solve_ikspark(problem, BUDGET, 0)
    assert candidate.q is None and "outside the joint limits" in candidate.rejected[0]


def test_around_obstacles() -> None:
    robot, rng = seven_axis(), np.random.default_rng(8)
    cover = beads(robot, 0.06)
    solved = 0
    while solved < 4:
        q = robot.random_configuration(rng)
        boxes = tuple(
            box(f"box{i}", tuple(rng.uniform([-0.8, -0.8, -0.3], [0.8, 0.8, 1.3])), (0.1, 0.12, 0.15))
            for i in range(6)
        )
        problem = IKProblem(robot, robot.fk(q), obstacles=boxes, cover=cover)
        if not verify(problem, q).accepted:
            continue
        assert_reached(problem, seed=solved)
        solved += 1


def test_local_search_from_iterates_is_an_option() -> None:
    robot = parallel_elbow()
    rng = np.random.default_rng(12)
    for seed in range(3):
        problem = IKProblem(robot, robot.fk(robot.random_configuration(rng)))
        assert_reached(problem, seed, local=True)


def test_no_budget_no_answer() -> None:
    robot = seven_axis()
    candidate = solve_ikspark(IKProblem(robot, robot.fk(np.zeros(7))), Budget(0.0), 0)
    assert candidate.q is None and candidate.certificate is None and candidate.error is None


def test_refusals() -> None:
    robot = seven_axis()
    sliding = replace(robot, prismatic=np.arange(7) == 2)
    with pytest.raises(InputError, match="'j2' is prismatic"):
        solve_ikspark(IKProblem(sliding, Pose.from_xyz([0.3, 0, 0.5])), BUDGET, 0, local=True)
    with pytest.raises(InputError, match="q_reference"):
        solve_ikspark(IKProblem(robot, robot.fk(np.zeros(7)), max_link_rotation=0.2), BUDGET, 0)


def test_polish_converges_quadratically_and_respects_limits() -> None:
    robot, rng = seven_axis(1.5), np.random.default_rng(7)
    for _ in range(10):
        q = robot.random_configuration(rng)
        problem = IKProblem(robot, robot.fk(q))
        near = polish(problem, q + rng.uniform(-1e-3, 1e-3, 7))
        assert near.position_error < 1e-9 and near.rotation_error < 1e-9 and near.moved < 0.02
        far = polish(problem, robot.random_configuration(rng), steps=60)
        assert np.all(robot.within_limits(far.q))
        error = robot.fk(far.q).error_to(problem.target)
        assert error == pytest.approx((far.position_error, far.rotation_error), abs=1e-8)


def test_polish_leaves_a_limit_when_it_must() -> None:
    robot = arm([Z, Y, X, Y, Z, Y], [[0, 0, 0.2]] * 6, [-1.0] * 6, [1.0] * 6)
    q = np.array([1.0, 0.7, -0.8, 0.9, -0.5, -0.6])
    polished = polish(IKProblem(robot, robot.fk(q)), np.clip(q + 0.02, -1, 1))
    assert polished.position_error < 1e-9 and np.all(np.abs(polished.q) <= 1.0)
