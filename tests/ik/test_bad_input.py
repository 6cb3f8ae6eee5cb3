"""Queries that make no sense, or hardly any: a clear refusal or a clear result, from every sampling entry."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from tests.ik.arms import beads, box, planar, random_arm, seven
from workcell.errors import InputError, ModelError
from workcell.ik.diverse.solutions import solutions
from workcell.ik.hjcd.batch import polish_seeds, solve_batch, solve_two_phase
from workcell.ik.judge.verify import verify
from workcell.ik.problem import Budget, IKProblem, Tolerances
from workcell.ik.result import Status
from workcell.ik.solve import solve
from workcell.pose import Pose

WHERE = [0.4, 0.7, 0.3, -1.1, 0.2, 0.8, 0.1]


@pytest.mark.parametrize(
    ("position", "quat", "words"),
    [
        ([np.nan, 0, 0], [1, 0, 0, 0], "position is not finite"),
        ([0, np.inf, 0], [1, 0, 0, 0], "position is not finite"),
        ([0, 0, 0], [np.nan, 0, 0, 0], "quat_wxyz is not finite"),
        ([0, 0, 0], [0, 0, 0, 0], "has length 0"),
        ([0, 0], [1, 0, 0, 0], "position must be 3 numbers"),
    ],
)
def test_targets_that_are_no_poses(position, quat, words):
    with pytest.raises(InputError, match=words):
        IKProblem(seven(), Pose(position, quat))


def test_matrices_that_are_no_rotations():
    for R in (2 * np.eye(3), np.diag([1.0, 1.0, -1.0]), np.ones((3, 3))):
        T = np.eye(4)
        T[:3, :3] = R
        with pytest.raises(InputError, match="the matrix is not a rotation"):
            Pose.from_matrix(T)


@pytest.mark.parametrize("row", [[0, 0, 0, 2, 0, 0, 0], [0, 0, np.nan, 1, 0, 0, 0], [0, 0, 0, 1]])
def test_rows_of_targets_are_checked(row):
    with pytest.raises(InputError, match="target"):
        solve_batch(seven(), [row])


def test_configurations_to_start_from_are_checked():
    robot = seven()
    target = robot.fk(np.array(WHERE))
    with pytest.raises(InputError, match="first"):
        solve_batch(robot, [target], first=[[0.0] * 6])
    with pytest.raises(InputError, match="2 configurations for 1 targets"):
        solve_batch(robot, [target], first=np.zeros((2, 7)))
    with pytest.raises(InputError, match="finite"):
        polish_seeds(robot, target, [[np.inf] * 7])
    with pytest.raises(InputError, match="uniform or halton"):
        solve_two_phase(robot, target, 4, sampling="sobol")
    with pytest.raises(InputError, match="empty"):
        solve_two_phase(robot, target, 0)


def test_limits_that_exclude_everything():
    robot = seven()
    with pytest.raises(ModelError, match="limits of joint 'j3'"):
        replace(robot, lower=np.where(np.arange(7) == 2, 3.0, robot.lower))
    with pytest.raises(ModelError, match="limits of joint 'j1'"):
        replace(robot, upper=np.where(np.arange(7) == 0, np.nan, robot.upper))


def test_limits_that_leave_one_configuration():
    robot = seven()
    q = np.array(WHERE)
    frozen = replace(robot, lower=q, upper=q)
    result = solve(IKProblem(frozen, robot.fk(q)), budget=Budget(1.0))
    assert result.solved
    np.testing.assert_array_equal(result.q, q)
    elsewhere = solve(IKProblem(frozen, robot.fk(q + 0.3)), "hjcd", budget=Budget(0.05))
    assert elsewhere.status is Status.NOT_FOUND


@pytest.mark.parametrize("dof", [1, 2, 3])
def test_chains_of_few_joints(dof):
    robot = planar((0.3,) * dof)
    q = np.full(dof, 0.4)
    problem = IKProblem(robot, robot.fk(q), (box("far", (3.0, 0, 0), (0.1, 0.1, 0.1)),), beads(robot))
    assert solve(problem, budget=Budget(1.0)).solved
    assert solve_batch(robot, [robot.fk(q)]).residual[0] < 1e-8
    assert len(solutions(problem, 2, Budget(0.1))) >= 1
    off_plane = solve(IKProblem(robot, Pose.from_xyz([0.3, 0, 0.2])), "hjcd", Budget(0.05))
    assert off_plane.status is Status.NOT_FOUND
    assert off_plane.rejected


def test_links_without_length():
    robot = seven()
    flat = replace(robot, joint_xyz=np.zeros((7, 3)))
    q = np.array(WHERE)
    problem = IKProblem(flat, flat.fk(q), (box("far", (3.0, 0, 0), (0.1, 0.1, 0.1)),), beads(flat))
    result = solve(problem, budget=Budget(1.0))
    assert result.solved
    assert verify(problem, result.q).accepted
    away = solve(IKProblem(flat, Pose.from_xyz([1.0, 0, 0])), budget=Budget(1.0))
    assert away.status is Status.UNREACHABLE


def test_a_start_outside_the_limits_is_brought_inside():
    robot = seven()
    q = np.array(WHERE)
    problem = IKProblem(robot, robot.fk(q), q_reference=np.full(7, 40.0))
    result = solve(problem, "hjcd", Budget(1.0))
    assert result.solved
    assert robot.within_limits(result.q)
    assert solve_batch(robot, [robot.fk(q)], first=[np.full(7, -9.0)]).residual[0] < 1e-8
    with pytest.raises(InputError, match="finite"):
        IKProblem(robot, robot.fk(q), q_reference=np.full(7, np.nan))


@pytest.mark.parametrize("solver", ["auto", "hjcd", "multistart", "branch"])
def test_a_budget_of_zero_finds_nothing(solver):
    robot = seven()
    result = solve(IKProblem(robot, robot.fk(np.array(WHERE))), solver, Budget(0.0))
    assert result.status is Status.NOT_FOUND
    with pytest.raises(InputError, match="budget"):
        Budget(-1.0)


@pytest.mark.parametrize("dof", [6, 12, 18, 24])
def test_long_chains_with_sliding_joints(dof):
    rng = np.random.default_rng(dof)
    robot = random_arm(rng, dof, sliding=True)
    robot = replace(
        robot,
        lower=np.where(robot.prismatic, -0.2, robot.lower),
        upper=np.where(robot.prismatic, 0.2, robot.upper),
    )
    targets = [robot.fk(q) for q in robot.random_configuration(rng, 10)]
    solution = solve_batch(robot, targets, seed=1)
    assert solution.residual.max() < 1e-8
    assert robot.within_limits(solution.q).all()
    q = robot.random_configuration(rng)
    tip = robot.fk(q).position
    problem = IKProblem(
        robot,
        robot.fk(q),
        (box("near", tuple(tip + np.array([0.2, 0, 0])), (0.05, 0.05, 0.05)),),
        beads(robot, 0.02),
        tolerances=Tolerances(safety_margin=0.001),
    )
    result = solve(problem, "hjcd", Budget(2.0))
    assert result.solved
    assert result.clearance.distance >= 0.001
