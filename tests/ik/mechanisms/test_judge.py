"""The judge accepts what is an answer, and says of everything else what is wrong with it."""

from dataclasses import replace

import mujoco
import numpy as np
import pytest

from tests.ik.arms import random_arm
from tests.ik.mechanisms.cases import four_bar, frame_at, platform
from workcell.errors import UnknownNameError
from workcell.geometry.types import Piece, SphereCover
from workcell.ik.judge.verify import verify
from workcell.ik.mechanisms.goals import FrameGoal, InRegion
from workcell.ik.mechanisms.judge import judge_mechanism
from workcell.ik.mechanisms.problem import MechanismProblem, MechanismTolerances, UserConstraint
from workcell.ik.problem import IKProblem
from workcell.model.mechanism.from_model import mechanism_of
from workcell.model.mechanism.mechanism import JointSum
from workcell.model.mechanism.of_robot import of_robot
from workcell.pose import Pose


def rotated(R, angle, axis=(1.0, 0.0, 0.0)):
    quat = np.concatenate([[np.cos(0.5 * angle)], np.sin(0.5 * angle) * np.array(axis)])
    return Pose(np.zeros(3), quat).rotation @ R


def test_the_assembly_is_an_answer_and_a_moved_crank_is_none():
    mechanism = four_bar()
    problem = MechanismProblem(mechanism)
    found = judge_mechanism(problem, mechanism.home)
    assert found.accepted and found.closure_error < 1e-12 and found.looked_at > 0
    found = judge_mechanism(problem, mechanism.home + np.array([0.1, 0, 0]))
    assert found.closure_error > 1e-3
    assert found.reasons[0].startswith("connect 'pin' (coupler, rocker) is missed by 0.0")


@pytest.mark.parametrize(
    ("q", "reason"),
    [
        ("abc", "not a list of numbers"),
        ([[1.0, 2.0]], "takes 3 finite numbers"),
        ([1.0, 2.0], "takes 3 finite numbers"),
        ([np.nan, 0.0, 0.0], "takes 3 finite numbers"),
        ([np.inf, 0.0, 0.0], "takes 3 finite numbers"),
        ([0.0, -1e300, 0.0], "numbers beyond 1e+06 metres and radians"),
        (None, "takes 3 finite numbers"),
        ([[1.0], [2.0, 3.0]], "not a list of numbers"),
        (object(), "not a list of numbers"),
    ],
)
def test_what_is_no_configuration_is_refused(q, reason):
    found = judge_mechanism(MechanismProblem(four_bar()), q)
    assert not found.accepted and reason in found.reasons[0] and np.isnan(found.closure_error)


def test_a_quaternion_that_is_none_is_refused():
    mechanism = platform()
    q = np.array(mechanism.home)
    q[:4] = 0.0
    assert "quaternion of joint 'ball0'" in judge_mechanism(MechanismProblem(mechanism), q).reasons[0]


def test_every_part_of_a_goal_counts_by_mujoco_s_poses():
    mechanism = platform()
    R, p = frame_at(mechanism, "tool", mechanism.home)
    model, data = mechanism.compiled.model, mujoco.MjData(mechanism.compiled.model)
    mujoco.mj_forward(model, data)
    np.testing.assert_allclose(p, data.site("tool").xpos, atol=1e-12)

    def judged(**goal):
        return judge_mechanism(MechanismProblem(mechanism, (FrameGoal("tool", **goal),)), mechanism.home)

    assert judged(position=p, rotation=R).accepted
    found = judged(position=p + np.array([0.002, 0, 0]))
    assert found.position_error == pytest.approx(0.002)
    assert found.reasons == ("tool is 2 mm from its goal (allowed 0.1)",)
    found = judged(rotation=rotated(R, 0.01))
    assert found.rotation_error == pytest.approx(0.01) and "turned by 0.01 rad" in found.reasons[0]
    up, aside = np.array([0.0, 0, 1]), np.array([np.sin(0.3), 0, np.cos(0.3)])
    assert judged(axis=R.T @ up, direction=up).accepted
    assert judged(axis=R.T @ up, direction=aside).rotation_error == pytest.approx(0.3)
    assert judged(axis=R.T @ up, direction=aside, within=0.3).accepted
    assert judged(axis=R.T @ up, direction=aside, within=0.2).rotation_error == pytest.approx(0.1)
    assert judged(axis=R.T @ up, direction=-up).rotation_error == pytest.approx(np.pi)


def test_regions_count():
    mechanism = platform()
    R, p = frame_at(mechanism, "tool", mechanism.home)
    point = np.array([0.1, 0.0, 0.2])
    place = R @ point + p
    plane = InRegion.plane("tool", [0, 0, 2.0], 2.0 * place[2], point)
    assert judge_mechanism(MechanismProblem(mechanism, regions=(plane,)), mechanism.home).accepted
    for offset in (-0.001, 0.001):
        off = InRegion.plane("tool", [0, 0, 1.0], place[2] + offset, point)
        found = judge_mechanism(MechanismProblem(mechanism, regions=(off,)), mechanism.home)
        assert found.region_error == pytest.approx(0.001)
        assert found.reasons == ("a point of tool is 1 mm outside its plane (allowed 0.001)",)
    box = InRegion.polytope("tool", np.vstack([np.eye(3), -np.eye(3)]), np.full(6, 9.0), point)
    assert judge_mechanism(MechanismProblem(mechanism, regions=(box,)), mechanism.home).region_error == 0.0
    box = InRegion.polytope("tool", np.eye(3), place + np.array([0.0, -0.1, 5.0]), point)
    found = judge_mechanism(MechanismProblem(mechanism, regions=(box,)), mechanism.home)
    assert found.region_error == pytest.approx(0.1)


def test_limits_count_those_of_the_mechanism_and_the_compiled_model_s():
    mechanism = platform()
    at = mechanism.value_slices[mechanism.joint("slide2")].start
    q = np.array(mechanism.home)
    q[at] = 0.25
    found = judge_mechanism(MechanismProblem(mechanism), q)
    assert found.limit_error == pytest.approx(0.05)
    assert "joint slide2 = 0.25 is outside [-0.2, 0.2]" in found.reasons
    wide = tuple(replace(j, upper=1.0) if j.name == "slide2" else j for j in mechanism.joints)
    found = judge_mechanism(MechanismProblem(replace(mechanism, joints=wide)), q)
    assert "joint slide2 of the compiled model = 0.25 is outside [-0.2, 0.2]" in found.reasons
    tight = tuple(replace(j, upper=0.1) if j.kind == "ball" else j for j in mechanism.joints)
    q = np.array(mechanism.home)
    q[:4] = np.cos(0.1), np.sin(0.1), 0, 0
    found = judge_mechanism(MechanismProblem(replace(mechanism, joints=tight)), q)
    assert "joint ball0 = 0.2 is outside [0, 0.1]" in found.reasons


def test_sums_of_joints_count():
    mechanism = four_bar()
    held = JointSum("half", (0, 1), np.array([1.0, 2.0]), 0.5, 0.5)
    kept = JointSum("most", (0,), np.array([2.0]), -1.0, -0.5)
    found = judge_mechanism(MechanismProblem(replace(mechanism, sums=(held, kept))), mechanism.home)
    assert found.closure_error == pytest.approx(0.5) and found.limit_error == pytest.approx(0.5)
    assert found.reasons == ("half is missed by 0.5 (allowed 1e-06)", "most = 0 is outside [-1, -0.5]")


def test_steps_count_from_where_they_are_measured():
    mechanism = platform()
    q = np.array(mechanism.home)
    q[:4] = np.cos(0.1), 0, np.sin(0.1), 0
    problem = MechanismProblem(mechanism, q_reference=mechanism.home, max_step=0.15)
    assert "joint ball0 moves by 0.2 (allowed 0.15)" in judge_mechanism(problem, q).reasons
    assert judge_mechanism(problem, -0.0 + mechanism.home).accepted
    problem = MechanismProblem(mechanism, q_reference=mechanism.home, max_link_rotation=0.1)
    reasons = judge_mechanism(problem, q).reasons
    assert f"link low0 turns by {2 * np.sqrt(2) * np.sin(0.1):.4g} (allowed 0.1)" in reasons


def test_a_user_s_constraints_count_and_are_not_forgotten():
    mechanism = four_bar()
    problem = MechanismProblem(mechanism, constraints=(UserConstraint("stay low", lambda e: []),))
    assert judge_mechanism(problem, mechanism.home).reasons == ("nobody looked at stay low",)
    assert judge_mechanism(problem, mechanism.home, lambda q: []).accepted
    assert judge_mechanism(problem, mechanism.home, lambda q: [f"it is at {q[0]:g}"]).reasons == (
        "it is at 0",
    )


ARM = """<mujoco><worldbody><geom name="wall" type="box" size=".1 .1 .1" pos="{at} 0 0"/>
  <body name="one"><joint name="a" axis="0 0 1"/><geom name="g1" size=".1"/>
    <body name="two" pos="1 0 0"><joint name="b" axis="0 0 1"/><geom name="g2" size=".2" pos=".9 0 0"/></body></body>
  </worldbody></mujoco>"""


def arm(at):
    return mechanism_of(mujoco.MjModel.from_xml_string(ARM.format(at=at)))


def test_the_compiled_model_says_what_touches():
    found = judge_mechanism(MechanismProblem(arm(2.5)), [0, 0])
    assert found.accepted and found.clearance.distance == pytest.approx(0.3) and found.looked_at == 2
    found = judge_mechanism(MechanismProblem(arm(2.1)), [0, 0])
    assert found.reasons == ("wall is 100 mm inside g2",)
    margin = MechanismTolerances(safety_margin=0.5)
    found = judge_mechanism(MechanismProblem(arm(2.5), tolerances=margin), [0, 0])
    assert found.reasons == ("wall is 300 mm from g2 (wanted 500)",)
    may = (("g2", "wall"),)
    assert judge_mechanism(MechanismProblem(arm(2.197), touching=may), [0, 0]).accepted
    found = judge_mechanism(MechanismProblem(arm(2.1), touching=may), [0, 0])
    assert found.reasons == ("wall, which may touch g2, is 100 mm inside it (allowed 5)",)
    deep = MechanismTolerances(overlap=0.2)
    assert judge_mechanism(MechanismProblem(arm(2.1), touching=may, tolerances=deep), [0, 0]).accepted
    assert judge_mechanism(MechanismProblem(arm(2.1), touching=may, collisions=False), [0, 0]).accepted
    assert judge_mechanism(MechanismProblem(arm(2.1), collisions=False), [0, 0]).looked_at == 0
    with pytest.raises(UnknownNameError, match="no geom named 'door'"):
        judge_mechanism(MechanismProblem(arm(2.1), touching=(("g2", "door"),)), [0, 0])


def test_an_obstacle_that_the_compiled_model_has_not_is_seen_by_spheres():
    mechanism = arm(5)
    cover = SphereCover(np.array([2]), np.array([[0.9, 0, 0]]), np.array([0.2]))
    ball = Piece("ball", "sphere", Pose.from_xyz([2.3, 0, 0]), np.array([0.3]))
    found = judge_mechanism(MechanismProblem(mechanism, obstacles=(ball,), cover=cover), [0, 0])
    assert found.reasons == ("sphere 0 (two) is 100 mm inside ball",)
    known = replace(ball, geom=0)
    assert judge_mechanism(MechanismProblem(mechanism, obstacles=(known,), cover=cover), [0, 0]).accepted
    by_spheres = MechanismProblem(mechanism, obstacles=(known,), cover=cover, collisions=False)
    assert judge_mechanism(by_spheres, [0, 0]).clearance.distance == pytest.approx(-0.1)


@pytest.mark.parametrize("seed", range(3))
def test_a_robot_s_mechanism_is_judged_as_the_robot_is(seed):
    rng = np.random.default_rng(seed)
    robot = random_arm(rng, sliding=True)
    q = robot.random_configuration(rng)
    cover = SphereCover(np.arange(1, 7), rng.normal(scale=0.1, size=(6, 3)), np.full(6, 0.05))
    obstacles = tuple(
        Piece(f"p{k}", "box", Pose.from_xyz(rng.normal(size=3)), np.full(3, 0.1)) for k in range(4)
    )
    apart = np.array([[0, 3], [1, 5]])
    off = robot.fk(q) @ Pose.from_xyz([0.001, 0, 0])
    there = IKProblem(robot, off, obstacles=obstacles, cover=cover, self_collision=apart)
    here = MechanismProblem(
        of_robot(robot),
        (FrameGoal.posed(robot.default_tool, off),),
        obstacles=obstacles,
        cover=cover,
        apart=apart,
    )
    one, two = verify(there, q), judge_mechanism(here, robot.joint_values(q))
    assert two.position_error == pytest.approx(one.position_error, abs=1e-12)
    assert two.rotation_error == pytest.approx(one.rotation_error, abs=1e-7)
    assert two.clearance.distance == pytest.approx(one.clearance.distance, abs=1e-12)
    assert two.looked_at == 6 * 4 + 2 and not two.accepted


def test_a_closure_of_a_mechanism_without_a_model_counts():
    mechanism = replace(four_bar(), compiled=None)
    problem = MechanismProblem(mechanism)
    assert judge_mechanism(problem, mechanism.home).accepted
    with_model = judge_mechanism(MechanismProblem(four_bar()), mechanism.home + 0.2)
    without = judge_mechanism(problem, mechanism.home + 0.2)
    assert without.closure_error == pytest.approx(with_model.closure_error, abs=1e-12)
    assert without.reasons == with_model.reasons
