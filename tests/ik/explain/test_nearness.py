"""What is said to be out of reach is: no configuration is nearer than the bound, in metres or in turns."""

from dataclasses import replace

import numpy as np
import pytest

from tests.coupled_arms import coupled_arm
from tests.ik.arms import box, planar, random_arm
from tests.ik.test_coupled import arm
from workcell.ik.explain.closest import closest_pose
from workcell.ik.explain.nearness import Nearness, nearness
from workcell.ik.explain.why_not import explain
from workcell.ik.problem import IKProblem, Tolerances
from workcell.ik.solve import solve
from workcell.pose import Pose

ARM = planar()


def errors(problem, q):
    """Metres and radians from the target, and the sum of squared errors."""
    pose, target = problem.robot.fk(q), problem.target
    apart, turned = pose.position - target.position, pose.rotation - target.rotation
    angle = 2.0 * np.arcsin(min(np.sqrt(np.sum(turned**2) / 8.0), 1.0))
    return np.linalg.norm(apart), angle, apart @ apart + np.sum(turned**2)


def test_out_of_reach_by_what_the_arm_is_too_short() -> None:
    problem = IKProblem(ARM, Pose.from_xyz([2.0, 0.0, 0.0]))
    found = closest_pose(problem)
    assert found is not None
    assert found.bound.position == pytest.approx(1.1, abs=1e-5)
    assert found.bound.position <= found.position_error
    assert found.bound.cost <= errors(problem, found.q)[2]
    assert found.sentence.endswith("away; none is closer than 1099.9 mm (proved)")


def test_a_turn_that_no_configuration_makes_is_told_as_one() -> None:
    problem = IKProblem(ARM, Pose([0.3, 0.2, 0.0], [0.0, 1.0, 0.0, 0.0]))  # an arm in the plane, upside down
    found = closest_pose(problem)
    assert found is not None and found.bound.position == 0.0
    assert np.pi / 2 < found.bound.rotation < np.pi
    assert "at the target's position none is turned by less than" in found.sentence


@pytest.mark.parametrize("seed", range(6))
def test_no_configuration_is_nearer(seed: int) -> None:
    rng = np.random.default_rng(seed)
    robot = random_arm(rng, 5, sliding=seed % 2 == 1)
    target = Pose(robot.fk(robot.home).position + rng.normal(size=3), [0.6, 0.8, 0.0, 0.0])
    problem = IKProblem(robot, target)
    bound = nearness(problem)
    for q in robot.random_configuration(rng, 500):
        apart, _, cost = errors(problem, q)
        assert apart >= bound.position - 1e-9 and cost >= bound.cost - 1e-9


def test_limits_count_and_rotations_only_where_they_are_asked_for() -> None:
    target = ARM.fk(np.array([1.5, 0.4]))
    tight = replace(ARM, lower=np.array([-1.0, -2.0]), upper=np.array([1.0, 2.0]))
    assert nearness(IKProblem(ARM, target)) == Nearness()
    assert nearness(IKProblem(tight, target)).position > 0.1
    turned = IKProblem(ARM, Pose(target.position, [0.0, 1.0, 0.0, 0.0]), goal="position")
    assert nearness(turned) == Nearness()


def test_what_is_within_reach_or_nearly_so_is_not_told() -> None:
    tolerances = Tolerances()
    assert Nearness().words(tolerances) == ""
    assert Nearness(position=0.9 * tolerances.position).words(tolerances) == ""
    assert "12.3 mm" in Nearness(position=0.01239, cost=0.2).words(tolerances)
    assert "90.0 degrees" in Nearness(cost=8.0 * np.sin(np.pi / 4) ** 2 + 1e-9).words(tolerances)
    blocked = IKProblem(ARM, ARM.fk(np.array([0.4, 0.7])))
    found = closest_pose(blocked)
    assert found is not None and found.proved == "" and "proved" not in found.sentence


def test_robots_whose_joints_follow_others_have_a_bound_too(tmp_path) -> None:  # type: ignore[no-untyped-def]
    robot = arm(tmp_path, coupled_arm(3, joints=6, followers=1)[0])
    problem = IKProblem(robot, Pose.from_xyz([9.0, 0.0, 0.0]))
    bound = nearness(problem)
    assert bound.position > 1.0
    for q in robot.random_configuration(np.random.default_rng(0), 200):
        assert errors(problem, q)[0] >= bound.position


def test_an_explanation_has_it_in_words_and_numbers() -> None:
    wall = box("wall", (-3.0, 0.0, 0.0), (0.1, 0.1, 0.1))
    problem = IKProblem(ARM, Pose.from_xyz([2.0, 0.0, 0.0]), (wall,))
    why = explain(problem, solve(problem))
    assert "none is closer than 1099.9 mm (proved)" in why.sentence
    closest = why.to_json()["closest"]
    assert closest["none_closer_than_m"] == pytest.approx(1.1, abs=1e-5)
    assert closest["no_cost_below"] == pytest.approx(1.21, abs=1e-4)
    assert closest["proved"] in why.sentence
