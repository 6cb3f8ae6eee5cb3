"""The plain baseline for the closest configuration: the best of several descents, judged but for its poses."""

import numpy as np
import pytest

from tests.ik.arms import planar
from tests.ik.mechanisms.cases import four_bar
from workcell.ik.mechanisms.goals import FrameGoal
from workcell.ik.mechanisms.judge import judge_mechanism
from workcell.ik.mechanisms.nearest import pose_cost, without_poses
from workcell.ik.mechanisms.problem import MechanismProblem
from workcell.ik.multistart.closest import DEFAULT_STARTS, closest_multistart
from workcell.ik.problem import Budget
from workcell.model.mechanism.of_robot import of_robot
from workcell.pose import Pose


def test_it_finds_the_circle_that_an_arm_reaches():
    mechanism = of_robot(planar((0.5, 0.4)))
    problem = MechanismProblem(mechanism, (FrameGoal.at(next(iter(mechanism.frames)), [1.2, 1.6, 0.0]),))
    found = closest_multistart(problem, Budget(20.0))
    assert pose_cost(problem, found.q) == pytest.approx(1.1**2, abs=1e-6)
    assert found.stats["starts"] == DEFAULT_STARTS and np.isnan(found.bound)


def test_loops_hold_budgets_count_and_seeds_repeat():
    problem = MechanismProblem(four_bar(), (FrameGoal.posed("tip", Pose.from_xyz([1.0, 0.5, 0.0])),))
    found = closest_multistart(problem, Budget(20.0, iterations=3), 1)
    assert judge_mechanism(without_poses(problem), found.q).accepted and found.stats["starts"] == 3
    assert np.array_equal(found.q, closest_multistart(problem, Budget(20.0, iterations=3), 1).q)
    assert closest_multistart(problem, Budget(0.0)).q is None
