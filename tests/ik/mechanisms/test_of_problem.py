"""A serial robot's problem as one about its mechanism: the same configurations are answers."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from tests.coupled_arms import coupled_arm
from tests.ik.arms import random_arm
from tests.ik.test_coupled import arm
from workcell.geometry.types import Piece, SphereCover
from workcell.ik.judge.verify import verify
from workcell.ik.mechanisms.judge import judge_mechanism
from workcell.ik.mechanisms.of_problem import mechanism_problem
from workcell.ik.problem import IKProblem, Tolerances
from workcell.model.mechanism.of_robot import variables_of
from workcell.pose import Pose


@pytest.mark.parametrize("goal", ["pose", "position", "axis"])
@pytest.mark.parametrize("coupled", [False, True])
def test_both_judges_say_the_same(goal, coupled, tmp_path):
    rng = np.random.default_rng(1)
    for seed in range(4):
        robot = (
            arm(tmp_path, coupled_arm(seed, joints=6, followers=2, bent=bool(seed % 2))[0])
            if coupled
            else random_arm(np.random.default_rng(seed), n=5, sliding=True)
        )
        q = robot.random_configuration(rng)
        cover = SphereCover(np.array([0, 1, 3]), 0.05 * rng.normal(size=(3, 3)), np.full(3, 0.04))
        centres = cover.centres_world(robot.link_transforms(q))
        ball = Piece("ball", "sphere", Pose.from_xyz(centres[2] + [0.0, 0.0, 0.1]), np.array([0.05]))
        problem = IKProblem(
            robot,
            robot.fk(q),
            (ball,),
            cover,
            goal=goal,
            tolerances=Tolerances(1e-3, 1e-2),
            q_reference=q,
            max_step=0.05,
            max_link_rotation=0.2,
            self_collision=np.array([[0, 2]]),
        )
        question = mechanism_problem(problem)
        said = []
        for size in (0.0, 1e-4, 3e-4, 1e-3, 3e-3, 1e-2, 0.04, 0.06, 0.2):
            other = np.clip(q + size * rng.normal(size=robot.dof), robot.lower, robot.upper)
            one, two = verify(problem, other), judge_mechanism(question, robot.joint_values(other))
            # followers leave their own bounds only where variables do
            assert one.accepted == two.accepted, (one.reasons, two.reasons)
            assert one.position_error == pytest.approx(two.position_error, abs=1e-12)
            assert one.rotation_error == pytest.approx(two.rotation_error, abs=1e-9)
            assert one.clearance.distance == pytest.approx(two.clearance.distance, abs=1e-12)
            said.append(one.accepted)
            assert np.allclose(variables_of(robot, robot.joint_values(other)), other)
        assert said[0] and not said[-1]


def test_spheres_of_a_base_stand_in_the_world():
    robot = random_arm(np.random.default_rng(2), n=3, sliding=True)
    cover = SphereCover(np.array([0]), np.array([[0.1, 0.2, 0.3]]), np.array([0.05]))
    problem = IKProblem(robot, robot.fk(robot.home), cover=cover)
    placed = mechanism_problem(problem).cover
    assert np.allclose(placed.centre[0], robot.T_world_base.apply(cover.centre[0]))


def test_one_problem_has_one_translation():
    robot = random_arm(np.random.default_rng(2), n=3)
    problem = IKProblem(robot, robot.fk(robot.home))
    assert mechanism_problem(problem) is mechanism_problem(problem)
    other = replace(problem, goal="position")
    assert mechanism_problem(other) is not mechanism_problem(problem)
    assert mechanism_problem(other).mechanism is mechanism_problem(problem).mechanism
