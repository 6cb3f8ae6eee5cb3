"""The judge of queries to trees: at one with the robot's own kinematics, and each refusal has its reason."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from tests.ik.arms import random_arm
from workcell.ik.judge.exact import ExactKinematics
from workcell.ik.trees.judge import judge_query
from workcell.ik.trees.query import Balls, Goal, Plane, Points, Query, Workspace
from workcell.model.robot import Robot, Tool
from workcell.pose import Pose, rotation_vector


def tree(seed: int, n: int = 9, sliding: bool = False) -> Robot:
    """A random tree: each joint hangs on any link before it; two tools on different links."""
    rng = np.random.default_rng(seed)
    arm = random_arm(rng, n, sliding)
    parents = np.array([rng.integers(0, k + 1) for k in range(n)])
    tip = arm.tool().T_link_tool
    tools = {"one": Tool("one", n, tip), "two": Tool("two", n - 2, tip @ Pose.from_xyz([0.1, 0.0, 0.05]))}
    return replace(arm, parents=parents, tools=tools, default_tool="one")


@pytest.mark.parametrize("sliding", [False, True])
def test_its_kinematics_are_those_of_the_robot(sliding: bool) -> None:
    for seed in range(10):
        robot = tree(seed, sliding=sliding)
        q = robot.random_configuration(np.random.default_rng(seed))
        rotation, position = ExactKinematics(robot).links(q)
        T = robot.link_transforms(q)
        assert np.allclose(rotation, T[:, :3, :3], atol=1e-12) and np.allclose(
            position, T[:, :3, 3], atol=1e-12
        )


def goals_at(robot: Robot, q: np.ndarray) -> tuple[Goal, Goal]:
    """The pose of one tool and the direction of the other's y axis, as they are at q."""
    one, two = robot.fk(q, "one"), robot.fk(q, "two")
    return Goal.posed("one", one), Goal.pointing("two", two.position, two.rotation[:, 1], (0.0, 1.0, 0.0))


def test_its_errors_are_those_of_the_robot_s_tools() -> None:
    for seed in range(10):
        robot, rng = tree(seed), np.random.default_rng(seed)
        q, other = robot.random_configuration(rng), robot.random_configuration(rng)
        one, two = goals_at(robot, q)
        there = robot.fk(other, "one")
        verdict = judge_query(Query(robot, (one,)), other)
        assert verdict.position_error == pytest.approx(
            np.linalg.norm(there.position - one.position), abs=1e-12
        )
        turn = np.linalg.norm(rotation_vector(one.directions.T @ there.rotation.T))
        assert verdict.rotation_error == pytest.approx(turn, abs=1e-9)
        points = robot.fk(other, "two").rotation[:, 1]
        angle = np.arccos(np.clip(points @ two.directions[0], -1.0, 1.0))
        assert judge_query(Query(robot, (two,)), other).rotation_error == pytest.approx(angle, abs=1e-6)
        at = Goal.at("two", robot.fk(q, "two").position)
        assert judge_query(Query(robot, (at,)), other).rotation_error == 0.0


def test_what_reaches_all_goals_is_accepted_and_what_misses_one_is_not() -> None:
    robot = tree(3)
    q = 0.9 * robot.random_configuration(np.random.default_rng(3))
    query = Query(robot, goals_at(robot, q))
    verdict = judge_query(query, q)
    assert verdict.accepted and verdict.position_error < 1e-12 and verdict.rotation_error < 1e-12
    for joint in set(robot.path_to(robot.tool("one").link)):
        moved = q.copy()
        moved[joint] += 0.01
        assert not judge_query(query, moved).accepted


def test_what_is_no_configuration_is_refused() -> None:
    robot = tree(4)
    query = Query(robot, goals_at(robot, robot.home))
    for wrong in (robot.home[:-1], np.full(robot.dof, np.nan), ["a"], np.zeros((2, robot.dof))):
        verdict = judge_query(query, wrong)
        assert not verdict.accepted and len(verdict.reasons) == 1


def test_limits_and_every_rule_of_the_workspace_are_kept() -> None:
    robot = tree(5)
    q = robot.random_configuration(np.random.default_rng(5))
    goals, points = goals_at(robot, q), Points.joints(robot)
    y = robot.link_transforms(q)[1:, :3, 3]
    tight = replace(robot, upper=np.minimum(robot.upper, q - 0.01), home=np.minimum(robot.home, q - 0.01))
    assert "outside its limits" in judge_query(Query(tight, goals), q).reasons[0]
    none = Balls.none()
    far = [[100.0, 0.0, 0.0]]
    broken = {
        "obstacle 0": Workspace(points, Balls([y[-1] + [0.05, 0.0, 0.0]], [0.1])),
        "containing sphere 0": Workspace(
            points, none, Balls([y[0]], [np.linalg.norm(y - y[0], axis=1).max() - 0.01])
        ),
        "plane 0": Workspace(points, planes=(Plane(np.array([0.0, 0.0, 1.0]), y[:, 2].min() + 0.01),)),
        "points 0, 8": Workspace(
            Points(points.link, points.local, np.full(robot.dof, 0.51 * np.linalg.norm(y[0] - y[8]))),
            apart=((0, 8),),
        ),
    }
    for rule, workspace in broken.items():
        (reason,) = judge_query(Query(robot, goals, workspace), q).reasons
        assert rule in reason and "broken" in reason
    kept = Workspace(
        points,
        Balls(far, [1.0]),
        Balls([y[0]], [10.0]),
        (Plane(np.array([0.0, 0.0, 1.0]), -50.0),),
        ((0, 8),),
    )
    assert judge_query(Query(robot, goals, kept), q).accepted
