"""A mechanism in its scene: obstacles, spheres, grasps and contacts, as the compiled model has them."""

import mujoco
import numpy as np
import pytest

from workcell.errors import InputError, UnknownNameError
from workcell.ik.mechanisms.goals import FrameGoal, InRegion
from workcell.ik.mechanisms.judge import judge_mechanism
from workcell.ik.multistart.mechanisms import solve_mechanism_multistart
from workcell.ik.problem import Budget
from workcell.model.mechanism.from_model import mechanism_of
from workcell.pose import Pose
from workcell.world.mechanism_world import Held, MechanismWorld

TWO_ARMS = """<mujoco><compiler angle="radian"/><worldbody>
  <geom name="floor" type="plane" size="3 3 .1" pos="0 0 -1"/>
  <geom name="post" type="cylinder" size=".05 .3" pos="-.1 .8 0"/>
  {arms}
  <body name="tray" pos="0 .5 .5"><freejoint name="tray"/><geom name="tray" type="box" size=".1 .05 .02"/>
    <site name="tray_middle"/></body>
  </worldbody><actuator>{motors}</actuator></mujoco>"""
ARM = """<body name="{s}0" pos="{x} 0 0"><joint name="{s}j0" axis="0 0 1" range="-3 3"/><geom name="{s}g0" size=".05"/>
  <body name="{s}1" pos="0 0 .1"><joint name="{s}j1" axis="1 0 0" range="-3 3"/>
    <geom name="{s}g1" type="capsule" fromto="0 .06 0 0 .34 0" size=".03"/>
    <body name="{s}2" pos="0 .4 0"><joint name="{s}j2" axis="1 0 0" range="-3 3"/>
      <geom name="{s}g2" type="capsule" fromto="0 .05 0 0 .3 0" size=".03"/>
      <body name="{s}3" pos="0 .35 0"><joint name="{s}j3" axis="1 0 0" range="-3 3"/>{eye}
        <body name="{s}4"><joint name="{s}j4" axis="0 0 1" range="-3 3"/>{eye}
          <body name="{s}5"><joint name="{s}j5" axis="0 1 0" range="-3 3"/>
            <geom name="{s}hand" type="box" size=".02 .04 .02" pos="0 .06 0"/>
            <site name="{s}tool" pos="0 .12 0"/></body></body></body></body></body></body>"""

EYE = '<geom size=".01" contype="0" conaffinity="0"/>'


def two_arms():
    arms = "".join(ARM.format(s=side, x=x, eye=EYE) for side, x in (("l", -0.25), ("r", 0.25)))
    motors = "".join(f'<motor joint="{side}j{k}"/>' for side in "lr" for k in range(6))
    return mujoco.MjModel.from_xml_string(TWO_ARMS.format(arms=arms, motors=motors))


GRASPS = [
    Held("tray", "ltool", Pose.from_xyz([0.1, 0.0, 0.0])),
    Held("tray", "rtool", Pose.from_xyz([-0.1, 0.0, 0.0])),
]


def test_what_moves_and_what_stands():
    world = MechanismWorld.of(two_arms(), overshoot=0.03, samples=10)
    assert [joint.name for joint in world.mechanism.joints] == [f"{s}j{k}" for s in "lr" for k in range(6)]
    assert {piece.name for piece in world.obstacles} == {"floor", "post", "tray"}
    problem = world.problem()
    assert problem.cover is world.cover and problem.obstacles == world.obstacles
    assert len(problem.apart) == len(world.spheres.pairs) > 0
    sources = np.array(world.cover.source)[world.spheres.pairs]
    assert ["lg1", "lg2"] not in sources.tolist()  # parent and child
    assert any(a[0] != b[0] for a, b in sources)  # one arm with the other


def test_two_arms_that_hold_a_tray_are_a_closed_chain():
    world = MechanismWorld.of(two_arms(), held=GRASPS, overshoot=0.03, samples=5)
    mechanism = world.mechanism
    assert [joint.kind for joint in mechanism.joints].count("free") == 1
    assert [closure.name for closure in mechanism.closures] == [
        "the grasp of tray by ltool",
        "the grasp of tray by rtool",
    ]
    assert "tray" not in {piece.name for piece in world.obstacles}
    goal = FrameGoal("tray_middle", np.array([0.05, 0.5, 0.2]), np.eye(3))
    problem = world.problem([goal])
    found = solve_mechanism_multistart(problem, Budget(60.0, iterations=60))
    verdict = judge_mechanism(problem, found.q)
    assert verdict.accepted and verdict.closure_error < 1e-9
    data = mujoco.MjData(mechanism.compiled.model)
    data.qpos[:] = mechanism.compiled.qpos(found.q)
    mujoco.mj_forward(mechanism.compiled.model, data)
    away = data.site("ltool").xpos - data.site("rtool").xpos
    np.testing.assert_allclose(away, [-0.2, 0, 0], atol=1e-9)
    np.testing.assert_allclose(data.body("tray").xpos, [0.05, 0.5, 0.2], atol=1e-9)


def test_a_grasp_as_the_scene_has_it():
    model = two_arms()
    world = MechanismWorld.of(model, held=[Held("tray", "ltool")], overshoot=0.05, samples=2)
    assert judge_mechanism(world.problem(), world.mechanism.home).closure_error < 1e-12


def test_contacts_that_are_asked_for_may_touch_and_no_others():
    model = two_arms()
    touching = [("lhand", "post")]
    world = MechanismWorld.of(model, moving=[f"lj{k}" for k in range(6)], touching=touching, overshoot=0.02)
    assert "post" not in {piece.name for piece in world.obstacles} and 0 in world.cover.link
    sources = np.array(world.cover.source)
    met = {tuple(sorted(pair)) for pair in sources[world.spheres.pairs].tolist() if "post" in pair}
    assert met == {("lg0", "post"), ("lg1", "post"), ("lg2", "post")}
    contact = InRegion.plane("ltool", [0.0, 1.0, 0.0], 0.75)
    near = InRegion.polytope(
        "ltool", np.array([[1.0, 0, 0], [-1, 0, 0], [0, 0, 1], [0, 0, -1]]), [0.01, 0.01, 0.2, 0.2]
    )
    problem = world.problem([FrameGoal.pointing("ltool", [0, 1, 0], [0, 1, 0])], [contact, near])
    found = solve_mechanism_multistart(problem, Budget(60.0, iterations=60))
    assert judge_mechanism(problem, found.q).accepted


def test_bad_grasps_and_contacts_are_named():
    model = two_arms()
    with pytest.raises(UnknownNameError, match="no body named 'cup'"):
        MechanismWorld.of(model, held=[Held("cup", "ltool")])
    with pytest.raises(InputError, match="'l3' does not float"):
        MechanismWorld.of(model, held=[Held("l3", "ltool")])
    with pytest.raises(UnknownNameError, match="no site named 'ttool'"):
        MechanismWorld.of(model, held=[Held("tray", "ttool", Pose.identity())])
    with pytest.raises(UnknownNameError, match="no geom named 'palm'"):
        MechanismWorld.of(model, touching=[("palm", "tray")])


def test_a_mechanism_and_a_cell_by_name_will_do():
    mechanism = mechanism_of(two_arms())
    assert MechanismWorld.of(mechanism, overshoot=0.05, samples=2).mechanism is mechanism
    world = MechanismWorld.of("stewart", overshoot=0.15, samples=2)
    assert (
        world.mechanism.is_closed
        and judge_mechanism(world.problem(margin=0.0), world.mechanism.home).accepted
    )
