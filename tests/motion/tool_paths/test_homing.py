"""Steps of a convex planner that end in a known configuration, and say so where they come out in another."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from tests.ik.lifted_arms import seven_axis
from workcell.ik.problem import Budget, IKProblem
from workcell.ik.solve import solve
from workcell.motion.tool_paths.homing import follow_to
from workcell.motion.tool_paths.planners import steps_of
from workcell.motion.tool_paths.poses import line
from workcell.motion.tool_paths.result import FollowLimits, FollowStatus
from workcell.pose import Array, Pose

LIMITS = FollowLimits(max_step=0.2, max_link_rotation=0.28)
Q_FROM = np.array([0.2, 0.5, -0.3, 1.2, 0.3, 0.7, 0.1])


def elsewhere(q: Array, seed: int = 1) -> Array:
    """Another configuration (n,) with the tool at q's pose, in the same posture, some way along its self-motion."""
    robot = seven_axis()
    aim = q + np.array([0.4, 0, 0, 0, 0, 0, 0])
    found = solve(IKProblem(robot, robot.fk(q), q_reference=aim), "ikspark", Budget(20.0, effort=1.0), seed)
    return found.unwrap()


@pytest.mark.parametrize("planner", ["ikspark", "cidgik"])
def test_the_motion_ends_in_the_configuration_that_was_asked_for(planner: str) -> None:
    robot = seven_axis()
    away = robot.fk(Q_FROM) @ Pose.from_xyz([0.0, 0.0, -0.15])
    near = solve(IKProblem(robot, away, q_reference=Q_FROM), "ikspark", Budget(20.0, effort=1.0)).unwrap()
    q_to = elsewhere(near)
    assert np.abs(q_to - near).max() > 0.1
    template = IKProblem(robot, robot.fk(Q_FROM))
    steps = steps_of(planner, template, limits=LIMITS)
    result = follow_to(template, line(robot.fk(Q_FROM), away), Q_FROM, q_to, LIMITS, steps)
    assert result.followed and result.path is not None
    assert np.array_equal(result.path.end, q_to) and np.array_equal(result.path.configurations[0], Q_FROM)
    assert result.path.largest_step <= LIMITS.max_step
    assert result.path.largest_link_rotation <= 0.28
    assert result.answered.by == {planner: len(result.path) - 1}


def test_another_posture_is_said_to_be_one() -> None:
    robot = seven_axis()
    away = robot.fk(Q_FROM) @ Pose.from_xyz([0.0, 0.0, -0.05])
    template = IKProblem(robot, away)
    answers = [solve(template, "ikspark", Budget(20.0, effort=1.0), seed).unwrap() for seed in range(6)]
    q_to = max(answers, key=lambda q: float(np.abs(q - Q_FROM).max()))
    steps = steps_of("ikspark", template, limits=LIMITS)
    result = follow_to(template, line(robot.fk(Q_FROM), away), Q_FROM, q_to, LIMITS, steps)
    assert result.status is FollowStatus.STEP_TOO_LARGE and result.failure is not None
    assert "rad away from the configuration that it was to end in" in result.failure.detail


def test_solvers_head_for_the_configuration_that_is_named() -> None:
    robot = seven_axis()
    q_to = elsewhere(Q_FROM)
    problem = IKProblem(robot, robot.fk(Q_FROM), q_reference=Q_FROM, max_step=1.0)
    for solver in ("ikspark", "cidgik"):
        stays = solve(problem, solver).unwrap()
        goes = solve(replace(problem, q_towards=q_to), solver).unwrap()
        assert np.abs(stays - Q_FROM).max() < 1e-3
        assert np.abs(goes - q_to).max() < 1e-2
