"""The configuration closest to goals out of reach: closed forms, bounds that nothing is below, what has to hold."""

from dataclasses import replace
from itertools import pairwise

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from tests.ik.arms import planar, random_arm
from tests.ik.mechanisms.cases import four_bar, platform
from workcell.ik.ikspark.mechanisms.blocks import linearise
from workcell.ik.ikspark.mechanisms.minimising.adaptive import Descent
from workcell.ik.ikspark.mechanisms.minimising.closest import closest_mechanism
from workcell.ik.ikspark.mechanisms.minimising.cost import CostProgram
from workcell.ik.ikspark.mechanisms.program import Program
from workcell.ik.ikspark.mechanisms.relaxation import Relaxation
from workcell.ik.mechanisms.check import check_cost
from workcell.ik.mechanisms.goals import FrameGoal, InRegion
from workcell.ik.mechanisms.judge import judge_mechanism
from workcell.ik.mechanisms.nearest import pose_cost, without_poses
from workcell.ik.mechanisms.problem import MechanismProblem, UserConstraint
from workcell.ik.mechanisms.sampling import random_configuration
from workcell.ik.problem import Budget
from workcell.model.mechanism.mechanism import Frame, Joint, Mechanism
from workcell.model.mechanism.of_robot import of_robot
from workcell.model.mechanism.placing import place
from workcell.pose import Pose

BUDGET = Budget(20.0, effort=1.0)
FORMS = ("quaternion", "rotation")


def arm(*lengths, limit=np.pi):
    return of_robot(planar(lengths or (0.5, 0.4), limit))


def tool(mechanism):
    return next(iter(mechanism.frames))


def slide(lower=-0.2, upper=0.3):
    joint = Joint("slide", "slide", 0, Pose.identity(), np.array([1.0, 0.0, 0.0]), lower, upper)
    return Mechanism(
        "slide", (joint,), ("world", "carriage"), frames={"tip": Frame("tip", 1, Pose.identity())}
    )


def holds(problem, found):
    """The cost of what was found, of which the judge accepts all but the poses, with a bound that holds."""
    assert found.q is not None, found.rejected
    measured = judge_mechanism(without_poses(problem), found.q)
    assert measured.accepted, measured.reasons
    cost = pose_cost(problem, found.q)
    assert 0.0 <= found.bound <= cost
    if found.bound_certificate is not None:
        assert check_cost(problem, found.bound_certificate) == found.bound
    return cost


@pytest.mark.parametrize("form", FORMS)
@pytest.mark.parametrize("goal", [(2.0, 0.0, 0.0), (-0.3, 1.4, 0.0), (0.9, -0.9, 0.5)])
def test_the_closest_point_is_on_the_circle_that_an_arm_reaches(form, goal):
    mechanism = arm()
    problem = MechanismProblem(mechanism, (FrameGoal.at(tool(mechanism), goal),))
    found = closest_mechanism(problem, BUDGET, form=form)
    away = float(np.hypot(*goal[:2])) - 0.9
    assert holds(problem, found) == pytest.approx(away**2 + goal[2] ** 2, abs=1e-6)
    assert found.bound == pytest.approx(away**2 + goal[2] ** 2, abs=1e-3)


def test_where_a_wanted_rotation_costs_more_than_it_is_worth_it_is_traded():
    # stretched out to the goal, turned by it: one joint, cost |p - g|^2 + 4 (1 - cos)
    mechanism = arm(1.0)
    goal = FrameGoal(tool(mechanism), np.array([0.0, 2.0, 0.0]), np.eye(3))
    problem = MechanismProblem(mechanism, (goal,))
    angles = np.linspace(-np.pi, np.pi, 200001)
    least = (np.cos(angles) ** 2 + (np.sin(angles) - 2.0) ** 2 + 4.0 * (1.0 - np.cos(angles))).min()
    assert holds(problem, closest_mechanism(problem, BUDGET)) == pytest.approx(least, abs=1e-8)


def test_a_slide_ends_at_its_limit():
    mechanism = slide()
    problem = MechanismProblem(mechanism, (FrameGoal.at("tip", [1.0, 0.4, 0.0]),))
    found = closest_mechanism(problem, BUDGET)
    assert holds(problem, found) == pytest.approx(0.7**2 + 0.4**2)
    assert found.q == pytest.approx([0.3])
    assert found.bound == pytest.approx(0.7**2 + 0.4**2, rel=1e-4)


def test_a_limit_keeps_an_arm_from_the_point_that_is_closest_without_it():
    mechanism = arm(1.0, limit=0.5)
    problem = MechanismProblem(mechanism, (FrameGoal.at(tool(mechanism), [0.0, 3.0, 0.0]),))
    found = closest_mechanism(problem, BUDGET)
    end = np.array([np.cos(0.5), np.sin(0.5) - 3.0])
    assert holds(problem, found) == pytest.approx(float(end @ end), abs=1e-8)
    assert found.q[0] == pytest.approx(0.5)


def test_a_goal_within_reach_costs_nothing():
    mechanism = arm(0.5, 0.4, 0.3)
    q = np.array([0.4, 0.9, -0.7])
    T = planar((0.5, 0.4, 0.3)).fk(q)
    problem = MechanismProblem(mechanism, (FrameGoal.posed(tool(mechanism), T),))
    found = closest_mechanism(problem, BUDGET)
    assert holds(problem, found) < 1e-10


@pytest.mark.parametrize("form", FORMS)
@pytest.mark.parametrize("mechanism", [four_bar(), platform()], ids=["four-bar", "platform"])
def test_loops_are_closed_at_the_answer(mechanism, form):
    frame = "tip" if "tip" in mechanism.frames else "tool"
    goal = FrameGoal.posed(frame, Pose.from_xyz([1.0, 0.5, 1.3]))
    problem = MechanismProblem(mechanism, (goal,), collisions=False)
    found = closest_mechanism(problem, BUDGET, form=form)
    assert holds(problem, found) > 0.1
    assert found.bound_certificate is not None
    assert judge_mechanism(problem, found.q).closure_error < 1e-9


@settings(max_examples=8, deadline=None)
@given(st.integers(0, 10**6), st.booleans())
def test_no_configuration_is_below_the_bound(seed, sliding):
    rng = np.random.default_rng(seed)
    mechanism = of_robot(random_arm(rng, 4, sliding))
    goal = FrameGoal.posed(tool(mechanism), Pose.from_xyz(rng.uniform(-3, 3, 3)))
    problem = MechanismProblem(mechanism, (goal,))
    found = closest_mechanism(problem, BUDGET, seed)
    if found.q is not None:
        holds(problem, found)
    for _ in range(200):
        assert pose_cost(problem, random_configuration(mechanism, rng)) >= found.bound


def descent_of(problem, form, **options):
    relaxation = Relaxation.of(problem, form, poses=False)
    program = CostProgram(relaxation)
    plain = Program(relaxation.lift.size, relaxation.rows)
    descent = Descent(relaxation.lift.blocks, program, plain, **options)
    return [*descent.run(program.closest().x)]


@pytest.mark.parametrize("form", FORMS)
@pytest.mark.parametrize("fixed", [None, 0.5])
def test_every_step_leaves_at_most_its_share_and_costs_grow(form, fixed):
    mechanism = of_robot(random_arm(np.random.default_rng(5), 6))
    problem = MechanismProblem(mechanism, (FrameGoal.posed(tool(mechanism), Pose.from_xyz([2.0, 2.0, 0.5])),))
    points = descent_of(problem, form, first=0.1, fixed=fixed)
    assert points[-1].rank_one and len(points) > 2
    for before, after in pairwise(points):  # Prop. 9
        assert after.left <= after.c * before.left + 1e-6
        assert after.cost >= points[0].cost - 1e-6
        assert fixed is None or after.c == fixed


def test_more_haste_costs_no_less():
    """A step that has to leave less has fewer points to choose the least cost from."""
    mechanism = of_robot(random_arm(np.random.default_rng(5), 6))
    problem = MechanismProblem(mechanism, (FrameGoal.posed(tool(mechanism), Pose.from_xyz([2.0, 2.0, 0.5])),))
    first = [descent_of(problem, "quaternion", first=0.1, fixed=c)[1].cost for c in (0.8, 0.5, 0.3)]
    assert first[0] <= first[1] + 1e-7 <= first[2] + 2e-7


def test_what_asks_for_too_much_is_eased_until_it_does_not():
    mechanism = of_robot(random_arm(np.random.default_rng(0), 6))
    problem = MechanismProblem(mechanism, (FrameGoal.posed(tool(mechanism), Pose.from_xyz([2.0, 2.0, 0.5])),))
    relaxation = Relaxation.of(problem, poses=False)
    points = descent_of(problem, "quaternion", first=0.02)
    eased = [point for point in points if point.asked]
    assert eased and points[-1].rank_one
    for point in eased:  # of Eq. 53's series
        p = np.log1p(-point.c) / np.log1p(-0.02)
        assert p == pytest.approx(round(p), abs=1e-6) and round(p) > 1
    assert linearise(relaxation.lift.blocks, points[-1].x)[0].max() < 1e-5


def test_directions_and_regions_hold_while_positions_are_the_cost():
    mechanism = of_robot(random_arm(np.random.default_rng(3), 6))
    frame = tool(mechanism)
    placed = place(mechanism, np.array(mechanism.home))
    at, R = mechanism.frame(frame), placed.R[mechanism.frame(frame).link]
    axis = R @ at.T_link_frame.rotation[:, 2]
    here = placed.point(at.link, at.T_link_frame.position)
    goal = FrameGoal.pointing(frame, axis, position=here + np.array([3.0, 1.0, 0.0]), within=0.3)
    below = InRegion.polytope(frame, np.array([[1.0, 0.0, 0.0]]), np.array([here[0] + 0.1]))
    problem = MechanismProblem(mechanism, (goal,), (below,))
    found = closest_mechanism(problem, BUDGET)
    holds(problem, found)
    assert judge_mechanism(problem, found.q).region_error <= 1e-6
    free = replace(problem, regions=(), goals=(FrameGoal.at(frame, goal.position),))
    assert closest_mechanism(free, BUDGET).bound <= found.bound + 1e-6


def test_a_users_constraint_holds_and_the_bound_rests_on_none():
    mechanism = arm()
    frame = tool(mechanism)
    own = UserConstraint("to the left", lambda e: [e.point(frame)[1] >= 0.5])
    problem = MechanismProblem(mechanism, (FrameGoal.at(frame, [2.0, 0.0, 0.0]),), constraints=(own,))
    found = closest_mechanism(problem, BUDGET)
    assert found.q is not None
    end = np.array([np.sqrt(0.81 - 0.25) - 2.0, 0.5])
    assert found.bound == pytest.approx(1.1**2, abs=1e-3)
    assert pose_cost(problem, found.q) >= float(end @ end) - 1e-5


def test_what_cannot_be_kept_at_all_is_proved_or_said():
    mechanism = arm()
    frame = tool(mechanism)
    away = InRegion.polytope(frame, np.array([[-1.0, 0.0, 0.0]]), np.array([-2.0]))
    problem = MechanismProblem(mechanism, (FrameGoal.at(frame, [2.0, 0.0, 0.0]),), (away,))
    found = closest_mechanism(problem, BUDGET)
    assert found.q is None and found.certificate is not None and found.rejected


def test_no_time_no_answer_and_the_same_seed_the_same_answer():
    mechanism = four_bar()
    problem = MechanismProblem(mechanism, (FrameGoal.posed("tip", Pose.from_xyz([1.0, 0.5, 1.3])),))
    assert closest_mechanism(problem, Budget(0.0)).q is None
    first, second = (closest_mechanism(problem, BUDGET, 4) for _ in range(2))
    assert np.array_equal(first.q, second.q) and first.bound == second.bound


def test_every_step_is_a_stage_with_its_gap_its_share_and_its_cost():
    mechanism = of_robot(random_arm(np.random.default_rng(5), 6))
    problem = MechanismProblem(mechanism, (FrameGoal.posed(tool(mechanism), Pose.from_xyz([2.0, 2.0, 0.5])),))
    found = closest_mechanism(problem, BUDGET)
    steps = [stage for stage in found.stages if stage.name == "rank reduction"]
    assert len(steps) == found.stats["steps"] > 0
    assert all({"c", "cost", "left"} <= set(stage.numbers) and stage.gap >= -1e-6 for stage in steps)
    assert found.stats["cost_relaxed"] <= found.stats["cost_rank_one"] + 1e-6
