"""MuJoCo's measure of a mechanism: residuals, poses, limits, and what touches."""

from dataclasses import replace

import mujoco
import numpy as np
import pytest

from tests.model.loops.linkages import four_bar, linked_gripper
from tests.model.mechanism.trees import compiled, data_at, random_q, random_tree
from workcell.errors import ModelError, UnknownNameError
from workcell.model.mechanism.from_model import mechanism_of
from workcell.model.mechanism.measuring import MechanismMeasure, measure_of, turn_of
from workcell.model.mechanism.mechanism import Closure, Frame
from workcell.model.mechanism.of_robot import of_robot
from workcell.model.mechanism.placing import missed, place
from workcell.model.scene import robot_scene
from workcell.pose import Pose

EQUALITIES = """
<connect name="c" body1="b1" body2="b4" anchor=".1 .2 -.1"/>
<weld name="w" body1="b2" body2="b5" anchor=".1 0 .3" relpose=".1 .2 .3 .5 .5 -.5 .5" torquescale="{scale}"/>
<weld name="ws" site1="s0" site2="s7"/>
"""


@pytest.mark.parametrize("seed", range(6))
@pytest.mark.parametrize("scale", [1, 0, 30])
def test_ties_miss_what_the_mechanism_s_own_kinematics_say(seed, scale):
    rng = np.random.default_rng(seed)
    model = compiled(random_tree(rng, equality=EQUALITIES.format(scale=scale)))
    mechanism = mechanism_of(model, moving=[model.joint(j).name for j in range(model.njnt)])
    q = random_q(mechanism, rng)
    values, k = missed(place(mechanism, q))[0], 0
    ties = MechanismMeasure(mechanism).ties(q)
    assert [tie.name for tie in ties] == [closure.name for closure in mechanism.closures]
    for closure, tie in zip(mechanism.closures, ties, strict=True):
        assert tie.missed == pytest.approx(np.linalg.norm(values[k : k + 3]), abs=1e-12)
        k += 3
        if closure.kind == "weld":
            assert tie.turned == pytest.approx(np.linalg.norm(values[k : k + 3]), abs=1e-9)
            k += 3
        assert tie.worst == max(tie.missed, tie.turned)


def test_constraints_are_looked_at_although_the_file_disables_them():
    model = compiled(four_bar(np.random.default_rng(0)).replace("<worldbody>",
        '<option><flag equality="disable" constraint="disable"/></option><worldbody>'))  # fmt: skip
    mechanism = mechanism_of(model)
    measure = MechanismMeasure(mechanism)
    assert measure.ties(mechanism.home)[0].missed < 1e-9
    assert measure.ties(mechanism.home + 0.1)[0].missed > 1e-3


def test_couplings_locks_and_tendons():
    text = """<mujoco><worldbody><body><joint name="a" axis="0 0 1"/><geom size=".1"/>
      <body pos="1 0 0"><joint name="b" axis="0 0 1"/><geom size=".1"/>
        <body pos="1 0 0"><joint axis="0 0 1"/><geom size=".1"/></body></body></body></worldbody>
      <tendon><fixed name="t"><joint joint="a" coef="1"/><joint joint="b" coef="1"/></fixed></tendon>
      <equality><joint joint1="b" joint2="a" polycoef="0 2"/><tendon tendon1="t" polycoef="0"/>
        <joint joint1="a" polycoef=".1"/></equality></mujoco>"""
    mechanism = mechanism_of(compiled(text))
    ties = {tie.name: tie.worst for tie in MechanismMeasure(mechanism).ties(np.array([0.3, 0.5, 0.0]))}
    assert ties == {
        "tendon equality ('t')" if "tendon equality ('t')" in ties else "tendon equality (t)": pytest.approx(
            0.8
        ),
        "the coupling of joint 'b' with joint 'a'": pytest.approx(0.1),
        "the lock of joint 'a'": pytest.approx(0.2),
    }


def test_frames_are_mujoco_s_sites_and_bodies_and_places_on_them():
    rng = np.random.default_rng(1)
    model = compiled(random_tree(rng))
    mechanism = mechanism_of(model, moving=[model.joint(j).name for j in range(model.njnt)])
    T = Pose(rng.normal(size=3), [0.5, 0.5, -0.5, 0.5])
    tip = mechanism.frame("s3")
    more = {
        **mechanism.frames,
        "extra": Frame("extra", tip.link, tip.T_link_frame @ T),
        "s4": Frame("s4", tip.link, tip.T_link_frame @ T),  # another place than the model's site
    }
    mechanism = replace(mechanism, frames=more)
    q = random_q(mechanism, rng)
    data, found = data_at(mechanism, q), MechanismMeasure(mechanism).frames(("s3", "b2", "extra", "s4"), q)
    R = data.site_xmat[model.site("s3").id].reshape(3, 3)
    np.testing.assert_allclose(found["s3"][0], R, atol=1e-12)
    np.testing.assert_allclose(found["b2"][1], data.body("b2").xpos, atol=1e-12)
    for name in ("extra", "s4"):
        np.testing.assert_allclose(found[name][0], R @ T.rotation, atol=1e-12)
        np.testing.assert_allclose(found[name][1], R @ T.position + data.site("s3").xpos, atol=1e-12)


def test_a_closure_beside_the_model_s_is_measured_and_its_bodies_are_neighbours():
    model = compiled(linked_gripper(np.random.default_rng(0)))
    mechanism = mechanism_of(model)
    a, b = mechanism.frame("finger_l"), mechanism.frame("finger_r")
    closure = Closure("grasp", "weld", (a.link, b.link), (a.T_link_frame, b.T_link_frame))
    more = replace(mechanism, closures=(*mechanism.closures, closure))
    q = mechanism.home
    data = data_at(mechanism, q)
    tie = MechanismMeasure(more).ties(q)[-1]
    assert tie.name == "grasp"
    assert tie.missed == pytest.approx(
        np.linalg.norm(data.body("finger_l").xpos - data.body("finger_r").xpos)
    )
    assert ("finger_l", "finger_r") in MechanismMeasure(mechanism).pair_names
    assert ("finger_l", "finger_r") not in MechanismMeasure(more).pair_names


def test_limits_are_the_compiled_model_s():
    text = """<mujoco><compiler angle="radian"/><worldbody><body><joint name="a" axis="0 0 1" range="-1 1"/>
      <geom size=".1"/><body pos="1 0 0"><joint name="k" type="ball" range="0 .5"/><geom size=".1"/></body>
      </body></worldbody></mujoco>"""
    mechanism = mechanism_of(compiled(text))
    q = np.array([1.2, np.cos(0.4), 0.0, np.sin(0.4), 0.0])
    beyond = MechanismMeasure(mechanism).beyond(q)
    assert [one[0] for one in beyond] == ["a", "k"]
    assert beyond[0][1:] == (1.2, -1.0, 1.0) and beyond[1][1] == pytest.approx(0.8)
    assert MechanismMeasure(mechanism).beyond(mechanism.home) == ()
    assert turn_of(np.array([-1.0, 0, 0, 0])) == 0.0


ARM = """<mujoco><worldbody><geom name="wall" type="box" size=".1 .1 .1" pos="2.5 0 0"/>
  <geom name="far" type="sphere" size=".1" pos="9 9 9"/>
  <body name="one"><joint name="a" axis="0 0 1"/><geom name="g1" size=".1"/>
    <body name="two" pos="1 0 0"><joint name="b" axis="0 0 1"/><geom name="g2" size=".2" pos=".9 0 0"/></body></body>
  <body name="cup" pos="0 3 0"><freejoint/><geom name="cup" size=".1"/></body></worldbody></mujoco>"""


def test_distances_of_what_moves_to_what_stands():
    measure = MechanismMeasure(mechanism_of(compiled(ARM)))
    assert set(measure.pair_names) == {(w, g) for w in ("wall", "far") for g in ("g1", "g2")} | {
        ("g1", "cup"),
        ("g2", "cup"),
    }
    found = measure.distance(np.zeros(2))
    assert found.distance == pytest.approx(2.4 - 1.9 - 0.2) and found.pair == ("wall", "g2")
    assert measure.contact(np.zeros(2)) is None
    touching = measure_of(measure.mechanism, (("g2", "wall"),))
    assert ("wall", "g2") not in touching.pair_names and measure_of(
        measure.mechanism, (("g2", "wall"),)
    ) is touching
    with pytest.raises(UnknownNameError, match="no geom named 'door'"):
        MechanismMeasure(measure.mechanism, [("g2", "door")])


def test_what_touches_is_seen_by_both_opinions():
    mechanism = mechanism_of(compiled(ARM.replace('pos="2.5 0 0"', 'pos="2.15 0 0"')))
    measure = MechanismMeasure(mechanism)
    assert measure.distance(np.zeros(2)).distance == pytest.approx(-0.05, abs=1e-6)
    assert measure.contact(np.zeros(2)).pair == ("wall", "g2")


def test_what_can_not_be_measured_is_refused():
    with pytest.raises(ModelError, match="comes from no compiled model"):
        MechanismMeasure(of_robot(robot_scene("ur10").robot().robot))
    field = """<mujoco><extension><plugin plugin="mujoco.sdf.torus"><instance name="t"/></plugin></extension>
      <asset><mesh name="m"><plugin instance="t"/></mesh></asset><worldbody>
      <geom type="sdf" mesh="m"><plugin instance="t"/></geom><body pos="3 0 0"><joint/><geom size=".1"/></body>
      </worldbody></mujoco>"""
    try:
        model = compiled(field)
    except ValueError:
        pytest.skip("this MuJoCo comes without its torus")
    with pytest.raises(ModelError, match="sdf can't be trusted"):
        MechanismMeasure(mechanism_of(model))
    assert mujoco.mjtGeom.mjGEOM_SDF == 8


def test_a_tie_on_a_link_without_a_body_is_refused():
    text = """<mujoco><worldbody><body name="x"><joint name="a" axis="0 0 1"/><joint name="b" axis="0 1 0"/>
      <geom size=".1"/></body></worldbody></mujoco>"""
    mechanism = mechanism_of(compiled(text))
    tie = Closure("t", "connect", (1, 0), (Pose.identity(), Pose.identity()))
    with pytest.raises(ModelError, match="no body stands on link 'x'"):
        MechanismMeasure(replace(mechanism, closures=(tie,)))
