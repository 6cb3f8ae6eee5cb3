"""Closed forms of two families of arms, and what they say about proofs by branch and bound."""

import dataclasses
import functools

import numpy as np
import pytest

from tests.ik.branch.spherical_arm import spherical_arm, unwrapped
from tests.ik.branch.test_solver import BUDGET, arm, ur_like
from workcell.bench.reference.closed_forms import parallel_arm
from workcell.errors import InputError
from workcell.geometry.types import Piece, SphereCover
from workcell.ik.branch.checker.check import check_branch
from workcell.ik.branch.solver import solve_branch
from workcell.ik.judge.verify import Verifier
from workcell.ik.problem import IKProblem
from workcell.model.robot import Robot
from workcell.model.scene import robot_scene
from workcell.pose import Array, Pose


@functools.cache
def real_arm(name: str) -> Robot:
    """A robot of the assets, its base at the world's origin."""
    return robot_scene(name).robot().robot.chain()


def solutions(robot: Robot, problem: IKProblem) -> Array:
    """All configurations of a UR-like arm; of a spherical one, those on a fine grid of its third joint."""
    if robot.dof == 6:
        found = [parallel_arm(robot, problem.target)]
    else:
        grid = np.linspace(robot.lower[2], robot.upper[2], 61)
        found = [spherical_arm(robot, problem.target, third) for third in grid]
    return np.concatenate([unwrapped(q, robot) for q in np.concatenate(found)] or [np.zeros((0, robot.dof))])


@pytest.mark.parametrize("name", ["ur10", "iiwa14"])
def test_closed_forms_hold_the_configuration_that_made_the_pose(name: str) -> None:
    rng, robot = np.random.default_rng(3), real_arm(name)
    for _ in range(15):
        q = rng.uniform(-2.9, 2.9, size=robot.dof)
        target = robot.fk(q)
        found = parallel_arm(robot, target) if robot.dof == 6 else spherical_arm(robot, target, q[2])
        assert 1 <= len(found) <= 8
        for each in found:
            away, turned = robot.fk(each).error_to(target)
            assert away < 1e-6
            assert turned < 1e-6
        assert np.abs((found - q + np.pi) % (2 * np.pi) - np.pi).max(axis=1).min() < 1e-5


def test_closed_forms_refuse_other_arms() -> None:
    with pytest.raises(InputError, match="not an arm with six joints"):
        parallel_arm(arm(), arm().fk(np.zeros(7)))
    with pytest.raises(InputError, match="not an arm with seven joints"):
        spherical_arm(ur_like(), ur_like().fk(np.zeros(6)), 0.0)


def cut(problem: IKProblem, most: int) -> IKProblem:
    """The problem with a ball on the middle of the arm of every configuration that is found."""
    cover = problem.cover
    assert cover is not None
    for k in range(most):
        q = solve_branch(problem, BUDGET).q
        if q is None:
            break
        centre = cover.centres_world(problem.robot.link_transforms(q))[k % len(cover)]
        ball = Piece(f"ball{k}", "sphere", Pose.from_xyz(centre), np.array([0.08]))
        problem = dataclasses.replace(problem, obstacles=(*problem.obstacles, ball))
    return problem


@pytest.mark.parametrize("name", ["ur10", "iiwa14"])
def test_proofs_agree_with_closed_forms(name: str) -> None:
    """Where a proof says that every configuration collides or breaks a limit, each of the closed form does."""
    rng, robot = np.random.default_rng(8), real_arm(name)
    cover = SphereCover(
        np.array([2, 3, 4]), np.array([[0.0, 0.0, 0.1], [0.0, 0.0, 0.1], [0.0, 0.0, 0.0]]), np.full(3, 0.06)
    )
    proved = 0
    for _ in range(3):
        target = robot.fk(rng.uniform(0.5 * robot.lower, 0.5 * robot.upper))
        problem = cut(IKProblem(robot, target, (), cover), most=25)
        candidate = solve_branch(problem, BUDGET)
        judge = Verifier(problem)
        accepted = any(judge(each).accepted for each in solutions(problem.robot, problem))
        assert candidate.q is not None or not accepted
        if candidate.certificate is not None:
            assert check_branch(problem, candidate.certificate) is None
            proved += 1
    assert proved >= 1
