"""Downhill to the closest configuration about one: slopes by differences, optima, ties and limits kept."""

import numpy as np
import pytest
from scipy.optimize import minimize

from tests.ik.arms import planar, random_arm
from tests.ik.mechanisms.cases import four_bar, platform
from workcell.errors import InputError
from workcell.ik.mechanisms.goals import FrameGoal, InRegion
from workcell.ik.mechanisms.judge import judge_mechanism
from workcell.ik.mechanisms.nearest import _Descent, nearest_mechanism, pose_cost, without_poses
from workcell.ik.mechanisms.problem import MechanismProblem
from workcell.ik.mechanisms.sampling import random_configuration
from workcell.model.mechanism.of_robot import of_robot
from workcell.model.mechanism.placing import moved
from workcell.pose import Pose

FAR = Pose([1.5, 0.7, 1.2], [0.6, 0.0, 0.8, 0.0])


def frame_of(mechanism):
    return next(name for name in ("tip", "tool", *mechanism.frames) if name in mechanism.frames)


@pytest.mark.parametrize(
    "mechanism", [four_bar(), platform(), of_robot(random_arm(np.random.default_rng(1)))]
)
def test_slopes_are_those_of_differences(mechanism):
    problem = MechanismProblem(mechanism, (FrameGoal.posed(frame_of(mechanism), FAR),))
    q = random_configuration(mechanism, np.random.default_rng(0))
    slope = _Descent(problem, None)._here(q).slope
    for k, row in enumerate(np.eye(mechanism.dof)):
        ends = [pose_cost(problem, moved(mechanism, q, sign * 1e-6 * row)) for sign in (1, -1)]
        assert slope[k] == pytest.approx((ends[0] - ends[1]) / 2e-6, abs=1e-6)


@pytest.mark.parametrize("seed", range(6))
def test_it_ends_where_nothing_near_is_lower_and_a_plain_optimiser_goes_no_further(seed):
    rng = np.random.default_rng(seed)
    mechanism = of_robot(random_arm(rng, 5, sliding=seed % 2 == 1))
    problem = MechanismProblem(mechanism, (FrameGoal.posed(frame_of(mechanism), FAR),))
    start = random_configuration(mechanism, rng)
    found = nearest_mechanism(problem, start, steps=200)
    assert found.cost == pytest.approx(pose_cost(problem, found.q)) and found.cost <= pose_cost(
        problem, start
    )
    limits = [(joint.lower, joint.upper) for joint in mechanism.joints]
    beyond = minimize(lambda q: pose_cost(problem, q), found.q, method="L-BFGS-B", bounds=limits)
    assert beyond.fun >= found.cost * (1.0 - 1e-4)


@pytest.mark.parametrize("mechanism", [four_bar(), platform()])
def test_loops_stay_closed(mechanism):
    problem = MechanismProblem(mechanism, (FrameGoal.posed(frame_of(mechanism), FAR),), collisions=False)
    found = nearest_mechanism(problem, mechanism.home, steps=200)
    assert found.worst < 1e-7 and found.cost < pose_cost(problem, mechanism.home)
    assert judge_mechanism(without_poses(problem), found.q).accepted
    rng = np.random.default_rng(0)
    for _ in range(50):  # closed configurations about it are no closer
        near = moved(mechanism, found.q, rng.uniform(-1e-3, 1e-3, mechanism.dof))
        other = nearest_mechanism(problem, near, steps=0)
        assert other.worst > 1e-7 or other.cost >= found.cost - 1e-4


def test_a_region_holds_where_the_goal_is_beyond_it():
    mechanism = of_robot(planar((0.5, 0.4)))
    frame = frame_of(mechanism)
    region = InRegion.polytope(frame, np.array([[1.0, 0.0, 0.0]]), np.array([0.5]))
    problem = MechanismProblem(mechanism, (FrameGoal.at(frame, [2.0, 0.3, 0.0]),), (region,))
    found = nearest_mechanism(problem, [1.0, 0.5], steps=200)
    assert judge_mechanism(without_poses(problem), found.q).accepted
    assert found.cost == pytest.approx(1.5**2, abs=1e-3)


def test_without_goals_it_is_the_polish_and_numbers_that_are_none_are_refused():
    mechanism = four_bar()
    problem = MechanismProblem(mechanism)
    found = nearest_mechanism(problem, mechanism.home)
    assert found.cost == 0.0 and found.worst < 1e-7
    with pytest.raises(InputError):
        nearest_mechanism(problem, [np.nan] * mechanism.size)
    with pytest.raises(ValueError, match="read-only"):
        found.q[0] = 1.0
