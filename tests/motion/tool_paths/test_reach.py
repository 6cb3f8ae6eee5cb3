"""Reaching along one of several ways, directly or by a detour, the tool upright where that is asked for."""

import numpy as np
import pytest

from workcell.errors import InputError
from workcell.ik.result import Status
from workcell.model.scene import Scene
from workcell.motion.body import Upright
from workcell.motion.tool_paths.follow import FollowLimits, line
from workcell.motion.tool_paths.reach import reach
from workcell.pose import Pose
from workcell.world.planning_world import PlanningWorld

LIMITS = FollowLimits(max_step=0.2, clearance=0.002)
TRANSFER = FollowLimits(max_step=0.2, clearance=0.002, deviation_m=0.01, deviation_rad=0.05)


@pytest.fixture(scope="module")
def world():
    return PlanningWorld.of(Scene.load("circle_trace", robot="iiwa14"))


@pytest.fixture(scope="module")
def mouth(world):
    """A tool pose 10 cm from where the robot stands, turned by half a radian about the tool's axis."""
    here = world.robot.robot.fk(world.robot.start)
    return Pose.from_xyz([0.0, 0.1, 0.05]) @ here @ Pose(np.zeros(3), [np.cos(0.25), 0, 0, np.sin(0.25)])


def inward(mouth):
    return line(mouth, mouth @ Pose.from_xyz([0, 0, 0.04]))


def tilts(world, path, upright):
    return [
        upright.tilt(world.robot.robot, q) for q in path.at(np.linspace(0, len(path) - 1, 20 * len(path)))
    ]


def test_the_first_way_that_needs_no_detour_is_taken(world, mouth):
    far = inward(Pose.from_xyz([2.0, 0, 0]) @ mouth)
    found = reach(world, world.robot.start, [far, inward(mouth)], limits=LIMITS)
    assert found.path is not None and found.how == "followed from the start" and found.ik is None
    assert np.array_equal(found.path.start, world.robot.start)
    goal = inward(mouth)[-1]
    assert max(world.robot.robot.fk(found.path.end).error_to(goal)) < 1e-3
    assert len(found.failures) == 1 and "at pose" in found.failures[0]


def test_a_half_turn_that_the_wrist_cannot_make_is_reached_by_a_detour_with_the_tool_upright(world, mouth):
    robot, start = world.robot.robot, np.array(world.robot.start)
    start[-1] = robot.upper[-1] - 0.05
    here = robot.fk(start)
    upright = Upright(0.3, direction=here.rotation[:, 2])
    turned = Pose.from_xyz([0, 0.1, 0.05]) @ here @ Pose(np.zeros(3), [np.cos(0.5), 0, 0, np.sin(0.5)])
    found = reach(world, start, [inward(turned)], limits=TRANSFER, upright=upright, solver="auto")
    assert found.path is not None and found.how.startswith("by way of") and found.failures
    assert max(robot.fk(found.path.end).error_to(inward(turned)[-1])) < 1e-3
    assert max(tilts(world, found.path, upright)) <= upright.angle + 1e-6
    assert all(world.clearance(q).distance >= 0.002 for q in found.path.configurations)


def test_a_way_that_tilts_the_tool_too_far_is_refused_in_words(world, mouth):
    here = world.robot.robot.fk(world.robot.start)
    tilted = mouth @ Pose(np.zeros(3), [np.cos(0.2), np.sin(0.2), 0, 0])
    upright = Upright(0.1, direction=here.rotation[:, 2])
    found = reach(
        world, world.robot.start, [inward(tilted)], limits=LIMITS, upright=upright, solver="auto", tries=1
    )
    assert found.path is None and len(found.failures) == 2
    assert all("the tool would tilt by 0.4" in words and "may by 0.1" in words for words in found.failures)


def test_one_goal_out_of_reach_is_no_proof_about_the_others(world, mouth):
    here = world.robot.robot.fk(world.robot.start)
    tilted = mouth @ Pose(np.zeros(3), [np.cos(0.2), np.sin(0.2), 0, 0])
    ways = [inward(tilted), inward(Pose.from_xyz([4.0, 0, 0]) @ mouth)]
    options = {"limits": LIMITS, "solver": "auto", "tries": 1}
    upright = Upright(0.1, direction=here.rotation[:, 2])
    both = reach(world, world.robot.start, ways, upright=upright, **options)
    assert both.path is None and both.ik is not None and both.ik.solved
    far = reach(world, world.robot.start, ways[1:], **options)
    assert far.path is None and far.ik is not None and far.ik.status is Status.UNREACHABLE


def test_no_way_at_all_is_bad_input(world):
    with pytest.raises(InputError, match="no way to choose from"):
        reach(world, world.robot.start, [], limits=LIMITS)
