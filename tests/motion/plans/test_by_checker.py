"""Joint-space planning: straight when clear, around the obstacle when not, proved, the same for a seed."""

import numpy as np
import pytest

from workcell.errors import InputError
from workcell.motion.plans.by_checker import connect, plan
from workcell.motion.plans.result import PlanSettings, PlanStatus

START, GOAL = np.array([-0.8, 0.0, 0.0]), np.array([0.8, 0.0, 0.0])


def test_a_clear_straight_line_is_taken(planar, planar_cover, ball):
    result = plan(planar, START, GOAL, ball([-3.0, 0, 0], 0.2), planar_cover)
    assert result.planned and len(result.path) == 2 and result.iterations == 0


def test_around_an_obstacle(planar, planar_cover, ball):
    truth = ball([1.0, 0.0, 0.0], 0.1)
    assert connect(planar, START, GOAL, truth, planar_cover).status is PlanStatus.NOT_FOUND
    result = plan(planar, START, GOAL, truth, planar_cover, seed=3)
    assert result.planned and result.proof.proved and result.iterations > 0
    assert np.array_equal(result.path.start, START) and np.array_equal(result.path.end, GOAL)
    assert truth.distances(result.path.at(np.linspace(0, len(result.path) - 1, 4000))).min() >= 0
    again = plan(planar, START, GOAL, truth, planar_cover, seed=3)
    assert np.array_equal(again.path.configurations, result.path.configurations)


def test_clearance_is_kept(planar, planar_cover, ball):
    truth = ball([1.0, 0.0, 0.0], 0.1)
    settings = PlanSettings(clearance=0.03)
    result = plan(planar, START, GOAL, truth, planar_cover, settings=settings, seed=1)
    assert result.planned and result.proof.margin >= 0.03
    assert truth.distances(result.path.at(np.linspace(0, len(result.path) - 1, 4000))).min() >= 0.03


def test_no_way_is_a_result(planar, planar_cover, ball):
    """The first link can't pass the ball, and its joint can't go round the other way."""
    settings = PlanSettings(iterations=60, attempts=1)
    result = plan(planar, START, GOAL, ball([0.3, 0.0, 0.0], 0.1), planar_cover, settings=settings)
    assert result.status is PlanStatus.NOT_FOUND and result.path is None
    assert "60 extensions" in result.detail and result.iterations == 60


def test_ends_in_collision_are_bad_input(planar, planar_cover, ball):
    with pytest.raises(InputError, match=r"q_b.*arm and ball overlap by \d+\.\d\d mm"):
        plan(planar, START, GOAL, ball(planar.fk(GOAL).position, 0.1), planar_cover)
    with pytest.raises(InputError, match="outside its joint limits"):
        plan(planar, [5.0, 0, 0], GOAL, ball([9, 0, 0], 0.1), planar_cover)
    with pytest.raises(InputError, match="positive"):
        PlanSettings(step=0.0)
