"""Starts and goals that can't be one: what is wrong, a way out that is near and was looked at, limits of zero."""

from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from tests.ik import arms
from workcell.errors import InputError
from workcell.geometry.types import Piece
from workcell.ik.problem import Budget, IKProblem
from workcell.motion.body import BodyClearance, Upright, pack_body
from workcell.motion.plans.compiled import Effort, search
from workcell.motion.plans.ends import checked_end, nearest_free
from workcell.motion.plans.optimise import optimise
from workcell.motion.plans.result import PlanSettings
from workcell.motion.plans.to_pose import plan_to_pose
from workcell.motion.timing.phase_plane import rest_to_rest
from workcell.pose import Pose

HALF, RADIUS = 0.3, 0.05


@pytest.fixture(scope="module")
def gantry():
    """A ball on two sliding joints, and the clearance of a square in the middle."""
    robot, cover = arms.gantry(RADIUS)
    square = Piece("square", "box", Pose.identity(), [HALF, HALF, 1.0])
    return robot, BodyClearance(pack_body(robot, cover, (square,)), cover, (square,))


@settings(max_examples=30, deadline=None)
@given(st.floats(-0.34, 0.34), st.floats(-0.34, 0.34))
def test_the_nearest_free_configuration_is_nearly_the_nearest_there_is(gantry, x, y):
    robot, clearance = gantry
    q = np.array([x, y])
    depth = -clearance(q).distance
    if depth <= 0:
        return
    free = nearest_free(robot, q, lambda p: clearance(p).distance)
    moved = np.abs(free - q).max()
    assert clearance(free).distance >= 1e-3 and robot.within_limits(free)
    # no way out is shorter than the depth, and none needs more than the one square to the nearest side
    assert (depth + 1e-3) / np.sqrt(2) <= moved <= 1.1 * (HALF + RADIUS + 1e-3 - np.abs(q).max()) + 1e-3


def test_the_message_names_pair_depth_and_way_out(gantry):
    robot, clearance = gantry
    with pytest.raises(InputError, match=r"start.*sphere 0.*square overlap by 100\.00 mm") as caught:
        checked_end(robot, [0.25, 0.0], clearance, "start")
    listed = str(caught.value).split(": [")[1].split("]")[0]
    free = np.array([float(value) for value in listed.split(",")])
    assert clearance(free).distance > 0.5e-3
    assert f"{np.abs(free - [0.25, 0.0]).max():.3f} rad away" in str(caught.value)


def test_the_way_out_keeps_limits_and_the_tool_upright(planar, planar_cover, ball):
    truth = ball([0.8, 0.0, 0.0], 0.15)
    # the tool's x axis may point along the world's x, within half a radian
    upright = Upright(0.5, tool_axis=(1, 0, 0), direction=(1, 0, 0))
    with pytest.raises(InputError, match="a free configuration") as caught:
        checked_end(planar, np.zeros(3), truth, "q_start", upright=upright)
    listed = str(caught.value).split(": [")[1].split("]")[0]
    free = np.array([float(value) for value in listed.split(",")])
    assert truth(free).distance > 0 and abs(free.sum()) <= 0.5 + 1e-3
    narrow = replace(planar, lower=np.full(3, -0.01), upper=np.full(3, 0.01))
    with pytest.raises(InputError, match="none was found near by"):
        checked_end(narrow, np.zeros(3), truth, "q_start")


@pytest.mark.parametrize("bad", [np.nan, np.inf])
def test_starts_that_are_no_numbers(planar, planar_cover, bad):
    problem = IKProblem(planar, planar.fk([0.5, 0.2, 0.1]), (), planar_cover)
    with pytest.raises(InputError, match="finite"):
        plan_to_pose(problem, [0.0, bad, 0.0])


def test_a_joint_without_range_stands_still(planar, planar_cover):
    """Its limits are equal: the others go round the ball, and a start elsewhere is outside the limits."""
    stuck = replace(
        planar, lower=np.array([-3.0, -3.0, 0.2]), upper=np.array([3.0, 3.0, 0.2]), home=np.zeros(3)
    )
    ball = Piece("ball", "sphere", Pose.from_xyz([1.0, 0.0, 0.0]), [0.1])
    body = pack_body(stuck, planar_cover, (ball,))
    start, goal = np.array([-0.8, 0.0, 0.2]), np.array([0.8, 0.0, 0.2])
    found = search(body, start, [goal], Effort(iterations=5000))
    effort = Effort(optimise_s=np.inf, optimise_iterations=200)
    better = optimise(body, start, [goal], found.path, 0, effort)
    for path in (found.path, better.paths[-1]):
        assert np.all(path[:, 2] == 0.2)
    problem = IKProblem(stuck, stuck.fk(goal), (ball,), planar_cover)
    assert plan_to_pose(problem, start, budget=Budget(2.0)).solved
    with pytest.raises(InputError, match="outside its joint limits"):
        plan_to_pose(problem, [-0.8, 0.0, 0.0])


def test_limits_that_allow_no_motion():
    corners = np.array([[0.0, 0.0], [1.0, 0.0]])
    for velocity, acceleration in (([0.0, 1.0], [1.0, 1.0]), ([1.0, 1.0], [1.0, np.nan])):
        with pytest.raises(InputError, match="allow no motion"):
            rest_to_rest(corners, np.array(velocity), np.array(acceleration))


@pytest.mark.parametrize(
    ("wrong", "words"),
    [
        ({"step": np.nan}, "step, resolution, iterations and attempts of a planner must be positive"),
        ({"step": np.inf}, "step, resolution, iterations and attempts of a planner must be positive"),
        ({"resolution": 0.0}, "step, resolution, iterations and attempts of a planner must be positive"),
        ({"iterations": 0}, "step, resolution, iterations and attempts of a planner must be positive"),
        ({"attempts": 0}, "step, resolution, iterations and attempts of a planner must be positive"),
        ({"shortcuts": -1}, "-1 shortcuts can't be tried"),
        ({"clearance": np.nan}, "a clearance of nan m .* can't be kept"),
        ({"spare": -1.0}, "with -1.0 m to spare can't be kept"),
        ({"optimise_s": np.nan}, "nan s .* can't be spent on shorter paths"),
        ({"optimise_s": -1.0}, "-1.0 s .* can't be spent on shorter paths"),
        ({"optimise_iterations": -1}, "-1 samples can't be spent on shorter paths"),
    ],
)
def test_settings_that_make_no_sense(wrong, words):
    with pytest.raises(InputError, match=words):
        PlanSettings(**wrong)
