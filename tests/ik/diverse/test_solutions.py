"""Diverse solutions: every one is a solution, they differ, and they cover the arm's postures."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from tests.ik.arms import beads, box, hugged, planar, random_arm, seven
from workcell.errors import InputError
from workcell.ik.diverse.posture import Posture, posture
from workcell.ik.diverse.solutions import DISTINCT, solutions
from workcell.ik.judge.verify import verify
from workcell.ik.problem import Budget, Clearance, IKProblem
from workcell.ik.result import Status
from workcell.pose import Pose

BUDGET = Budget(5.0)


def spherical_arm():
    """Shoulder, elbow and wrist without offsets: roll-pitch-roll, pitch, roll-pitch-roll."""
    robot = seven()
    straight = np.array(
        [[0, 0, 0.3], [0, 0, 0], [0, 0, 0.4], [0, 0, 0], [0, 0, 0.35], [0, 0, 0], [0, 0, 0.0]]
    )
    return replace(robot, joint_xyz=straight)


def test_solutions_are_solutions_and_differ():
    robot = seven()
    problem = hugged(robot, beads(robot, 0.02), np.random.default_rng(2), 6)
    found = solutions(problem, 8, BUDGET, seed=1)
    assert len(found) == 8
    assert all(result.status is Status.SOLVED and verify(problem, result.q).accepted for result in found)
    q = np.stack([result.q for result in found])
    apart = np.abs(q[:, None] - q[None]).max(-1) + np.eye(8) * 9
    assert apart.min() >= DISTINCT
    assert all(result.stats["nearest_other"] >= DISTINCT for result in found)
    again = solutions(problem, 8, BUDGET, seed=1)
    assert all(np.array_equal(a.q, b.q) for a, b in zip(found, again, strict=True))


def test_every_posture_of_an_arm_without_offsets_is_found():
    # Without obstacles and at wide limits all eight combinations of shoulder, elbow and wrist reach a target.
    robot = spherical_arm()
    robot = replace(robot, lower=np.full(7, -3.1), upper=np.full(7, 3.1))
    q = np.array([0.3, 0.6, -0.4, 1.2, 0.5, 0.8, 0.2])
    found = solutions(IKProblem(robot, robot.fk(q)), 8, BUDGET)
    assert len({posture(robot, result.q) for result in found}) == 8
    assert {tuple(result.stats[name] for name in Posture._fields) for result in found} == {
        posture(robot, result.q) for result in found
    }


@settings(max_examples=15, deadline=None)
@given(st.integers(0, 10**6))
def test_signs_of_an_arm_without_offsets_are_those_of_its_angles(seed):
    robot = spherical_arm()
    q = np.random.default_rng(seed).uniform(-2.5, 2.5, 7)
    signs = np.sign([q[1], q[3], q[5]])
    flipped = posture(robot, q * np.array([1, -1, 1, 1, 1, 1, 1]))
    assert np.abs(posture(robot, q)).min() == 1
    assert flipped.shoulder == -posture(robot, q).shoulder
    reference = posture(robot, np.abs(q))
    assert np.array_equal(np.array(posture(robot, q)) * signs, reference)


def test_postures_of_small_and_sliding_arms():
    assert posture(planar(), [0.1, 0.2]) == (0, 0, 0)
    sliding = random_arm(np.random.default_rng(3), 6, sliding=True)
    assert len(posture(sliding, np.zeros(6))) == 3
    with pytest.raises(InputError, match="joint values"):
        posture(planar(), [0.1])


def test_an_arm_with_one_solution_and_one_with_none():
    robot = planar((0.5, 0.4))
    problem = IKProblem(robot, robot.fk(np.array([0.3, 0.9])))
    # position and orientation together leave one branch of the two
    assert len(solutions(problem, 4, Budget(0.1))) == 1
    assert solutions(IKProblem(robot, Pose.from_xyz([3, 0, 0])), 2, Budget(0.05)) == ()
    assert solutions(problem, 2, Budget(0.0)) == ()
    with pytest.raises(InputError, match="at least 1"):
        solutions(problem, 0)


def test_the_problems_checker_is_asked_about_every_solution():
    robot = seven()
    target = robot.fk(np.array([0.4, 0.7, 0.3, -1.1, 0.2, 0.8, 0.1]))
    wall = (box("far", (5.0, 0.0, 0.0), (0.1, 0.1, 0.1)),)
    problem = IKProblem(
        robot, target, wall, beads(robot), checker=lambda q: Clearance(float(q[3]), ("a", "b"))
    )
    found = solutions(problem, 4, BUDGET)
    assert len(found) == 4
    assert all(result.q[3] >= 0 for result in found)
