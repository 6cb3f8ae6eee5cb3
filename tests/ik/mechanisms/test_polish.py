"""A configuration near an answer becomes one, to rounding; limits are kept, and what is redundant is no trouble."""

from dataclasses import replace

import mujoco
import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from tests.coupled_arms import coupled_arm
from tests.ik.mechanisms.cases import four_bar, frame_at, platform
from tests.model.loops.linkages import linked_gripper
from tests.model.mechanism.trees import compiled, random_tree
from workcell.errors import InputError
from workcell.ik.mechanisms.goals import FrameGoal, InRegion
from workcell.ik.mechanisms.judge import judge_mechanism
from workcell.ik.mechanisms.polish import polish_mechanism, residuals_of
from workcell.ik.mechanisms.problem import MechanismProblem
from workcell.ik.mechanisms.sampling import random_configuration, reach_of
from workcell.model.mechanism.from_model import mechanism_of
from workcell.model.mechanism.mechanism import Closure, JointSum
from workcell.model.mechanism.placing import moved
from workcell.pose import Pose

EXACT = 1e-12


def near(mechanism, q, rng, size=0.1):
    return moved(mechanism, q, rng.uniform(-size, size, mechanism.dof))


@pytest.mark.parametrize("seed", range(5))
def test_a_platform_is_brought_to_a_pose(seed):
    rng, mechanism = np.random.default_rng(seed), platform()
    R, p = frame_at(mechanism, "tool", mechanism.home)
    goal = FrameGoal("tool", p + rng.uniform(-0.03, 0.03, 3), R)
    problem = MechanismProblem(mechanism, (goal,))
    found = polish_mechanism(problem, near(mechanism, mechanism.home, rng))
    assert found.worst < EXACT and found.moved < 0.5
    verdict = judge_mechanism(problem, found.q)
    assert verdict.closure_error < EXACT and verdict.position_error < EXACT and verdict.accepted


def test_a_random_start_closes_the_loop_although_two_rows_of_three_say_the_same():
    mechanism, rng = four_bar(), np.random.default_rng(0)
    problem, closed = MechanismProblem(mechanism, collisions=False), 0
    for _ in range(20):
        found = polish_mechanism(problem, random_configuration(mechanism, rng))
        assert judge_mechanism(problem, found.q).accepted == (found.worst < 1e-6)
        closed += found.worst < 1e-9
    assert closed > 12  # others end at a limit of the crank


def test_a_tie_said_twice_is_no_trouble():
    mechanism = four_bar()
    twice = replace(mechanism, closures=(*mechanism.closures, *mechanism.closures))
    found = polish_mechanism(
        MechanismProblem(twice), near(mechanism, mechanism.home, np.random.default_rng(1))
    )
    assert found.worst < EXACT


def test_limits_are_kept_and_held_where_they_must_be():
    mechanism = platform()
    R, p = frame_at(mechanism, "tool", mechanism.home)
    at = mechanism.value_slices[mechanism.joint("slide0")].start
    for height in (0.1, 0.5):
        problem = MechanismProblem(mechanism, (FrameGoal("tool", p + np.array([0, 0, height]), R),))
        found = polish_mechanism(problem, mechanism.home)
        assert -0.2 <= found.q[at] <= 0.2
        assert (found.worst < EXACT) == (height == 0.1)
    assert found.q[at] == 0.2  # as near as the legs get


def test_a_step_bound_narrows_the_limits():
    mechanism = platform()
    R, p = frame_at(mechanism, "tool", mechanism.home)
    goal = FrameGoal("tool", p + np.array([0, 0, 0.05]), R)
    for step in (0.02, 0.2):
        problem = MechanismProblem(mechanism, (goal,), q_reference=mechanism.home, max_step=step)
        found = polish_mechanism(problem, mechanism.home)
        assert found.moved <= step + 1e-6 or found.worst > EXACT
        assert judge_mechanism(problem, found.q).accepted == (step == 0.2)
    problem = MechanismProblem(mechanism, (goal,), q_reference=mechanism.home, max_link_rotation=1e-3)
    assert polish_mechanism(problem, mechanism.home).worst > 1e-3


def test_parts_of_poses_cones_and_regions():
    rng, mechanism = np.random.default_rng(3), platform()
    tilt = np.array([0.2, 0.0, np.sqrt(0.96)])
    point = np.array([0.05, 0.0, 0.0])
    goals = (FrameGoal.pointing("tool", [0, 0, 1.0], tilt, within=0.15),)
    _, p = frame_at(mechanism, "tool", mechanism.home)
    regions = (
        InRegion.plane("tool", [0, 1.0, 0], p[1] + 0.02, point),
        InRegion.polytope(
            "tool", np.array([[0, 0, -1.0], [0, 0, 1.0]]), np.array([-p[2] - 0.03, p[2] + 0.05])
        ),
    )
    problem = MechanismProblem(mechanism, goals, regions)
    found = polish_mechanism(problem, near(mechanism, mechanism.home, rng, 0.03))
    assert found.worst < EXACT and judge_mechanism(problem, found.q).accepted
    exactly = MechanismProblem(mechanism, (replace(goals[0], within=0.0),), regions)
    found = polish_mechanism(exactly, mechanism.home)
    assert found.worst < EXACT and judge_mechanism(exactly, found.q).accepted


def test_what_holds_already_stays_bit_by_bit():
    mechanism = platform()
    found = polish_mechanism(MechanismProblem(mechanism), mechanism.home)
    assert found.moved < EXACT and found.steps <= 2


@pytest.mark.parametrize("seed", range(4))
def test_joints_that_follow(seed):
    text, following = coupled_arm(seed, bent=True)
    mechanism, rng = mechanism_of(compiled(text)), np.random.default_rng(seed)
    assert len(mechanism.followers) == len(following)
    there = random_configuration(mechanism, rng)
    there = polish_mechanism(MechanismProblem(mechanism, collisions=False), there).q
    R, p = frame_at(mechanism, "tool", there)
    problem = MechanismProblem(mechanism, (FrameGoal("tool", p, R),), collisions=False)
    found = polish_mechanism(problem, near(mechanism, there, rng, 0.02))
    assert found.worst < EXACT and judge_mechanism(problem, found.q).accepted


def test_a_gripper_s_linkage_closes_with_its_tendon():
    mechanism = mechanism_of(compiled(linked_gripper(np.random.default_rng(0))))
    rng = np.random.default_rng(0)
    problem = MechanismProblem(mechanism, collisions=False)
    found = polish_mechanism(problem, near(mechanism, mechanism.home, rng, 0.2))
    assert found.worst < EXACT and judge_mechanism(problem, found.q).closure_error < EXACT


def test_balls_and_sums_keep_their_limits():
    mechanism = platform()
    tight = tuple(replace(j, upper=0.05) if j.kind == "ball" else j for j in mechanism.joints)
    at = mechanism.joint("slide0"), mechanism.joint("slide1")
    total = JointSum("legs", at, np.ones(2), -0.1, 0.02)
    mechanism = replace(mechanism, joints=tight, sums=(total,))
    _, p = frame_at(mechanism, "tool", mechanism.home)
    problem = MechanismProblem(mechanism, (FrameGoal("tool", p + np.array([0.0, 0, 0.015])),))
    found = polish_mechanism(problem, near(mechanism, mechanism.home, np.random.default_rng(0), 0.1))
    assert found.worst < EXACT and judge_mechanism(problem, found.q).accepted


def test_further_rows_are_kept_with_the_rest():
    mechanism = four_bar()

    def more(rows):
        return rows.placed.q[:1] - 0.3, np.eye(1, mechanism.dof)

    found = polish_mechanism(MechanismProblem(mechanism), mechanism.home, more=more)
    assert found.worst < EXACT and found.q[0] == pytest.approx(0.3, abs=EXACT)


def test_no_configuration_is_refused():
    with pytest.raises(InputError, match="3 finite numbers"):
        polish_mechanism(MechanismProblem(four_bar()), [0.0, np.nan, 0.0])


@settings(max_examples=25, deadline=None)
@given(st.integers(0, 10**6))
def test_slopes_are_derivatives_of_the_rows(seed):
    rng = np.random.default_rng(seed)
    model = compiled(random_tree(rng, bodies=5))
    mechanism = mechanism_of(model, moving=[model.joint(j).name for j in range(model.njnt)])
    q = random_configuration(mechanism, rng)
    R, p = frame_at(mechanism, "s3", q)  # rotation rows are exact derivatives where they are zero
    axis = rng.normal(size=3)
    aside = np.cross(R @ axis, rng.normal(size=3))
    goals = (
        FrameGoal("s3", p + rng.normal(size=3), R),
        FrameGoal.pointing("s2", [0, 0, 1.0], axis / np.linalg.norm(axis)),
        FrameGoal.pointing("s4", aside / np.linalg.norm(aside), within=0.01),
    )
    regions = (InRegion.polytope("s2", rng.normal(size=(4, 3)), -50.0 * np.ones(4), rng.normal(size=3)),)
    residuals = residuals_of(MechanismProblem(mechanism, goals, regions))
    rows = residuals.at(q)
    for column in range(mechanism.dof):
        step = 1e-6 * np.eye(mechanism.dof)[column]
        ahead, back = (residuals.at(moved(mechanism, q, s)) for s in (step, -step))
        if len(ahead.value) == len(back.value) == len(rows.value):
            np.testing.assert_allclose((ahead.value - back.value) / 2e-6, rows.slope[:, column], atol=1e-4)


def test_random_configurations_are_within_limits_and_anywhere():
    rng = np.random.default_rng(0)
    mechanism = platform()
    tight = tuple(replace(j, upper=0.4) if j.name == "ball0" else j for j in mechanism.joints)
    problem = MechanismProblem(replace(mechanism, joints=tight))
    seen = np.array([random_configuration(problem.mechanism, rng) for _ in range(200)])
    for q in seen[:20]:
        assert judge_mechanism(problem, q).limit_error == 0.0
    slide = seen[:, mechanism.value_slices[mechanism.joint("slide0")].start]
    assert slide.min() < -0.18 and slide.max() > 0.18
    free = seen[:, mechanism.value_slices[-1]]
    assert np.ptp(free[:, 2]) > reach_of(mechanism)
    assert np.abs(free[:, 3:].mean(axis=0)).max() < 0.2


def test_a_random_configuration_has_followers_where_they_belong():
    text, _ = coupled_arm(1)
    mechanism, rng = mechanism_of(compiled(text)), np.random.default_rng(0)
    q = random_configuration(mechanism, rng)
    assert judge_mechanism(MechanismProblem(mechanism, collisions=False), q).limit_error == 0.0


def test_a_grasp_of_a_floating_body_closes_from_afar():
    text = """<mujoco><worldbody><body name="a"><joint name="j" axis="0 0 1"/><geom size=".01"/>
      <body name="b" pos="1 0 0"><joint name="k" axis="0 1 0"/><geom size=".01"/></body></body>
      <body name="cup" pos="3 3 3"><freejoint name="f"/><geom size=".01"/></body></worldbody></mujoco>"""
    mechanism = mechanism_of(mujoco.MjModel.from_xml_string(text), moving=["j", "k", "f"])
    grasp = Closure("grasp", "weld", (2, 3), (Pose.from_xyz([0.1, 0, 0]), Pose.identity()))
    mechanism = replace(mechanism, closures=(grasp,))
    goal = FrameGoal.at("cup", [0.0, 1.0, -0.1])
    problem = MechanismProblem(mechanism, (goal,), collisions=False)
    found = polish_mechanism(problem, random_configuration(mechanism, np.random.default_rng(0)), steps=100)
    assert found.worst < EXACT and judge_mechanism(problem, found.q).accepted
