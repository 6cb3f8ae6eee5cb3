"""The smallest distance over all pairs, found by bounds, equals the one found by asking every pair."""

import mujoco
import numpy as np
import pytest

from workcell.model.collision_model import CollisionModel
from workcell.model.scene import Scene

CELL = """
<mujoco model="yard">
  <asset>
    <mesh name="wedge" vertex="0 0 0  0.4 0 0  0 0.3 0  0 0 0.5  0.4 0 0.5"/>
  </asset>
  <worldbody>
    <geom name="floor" type="plane" pos="0 0 -0.3" zaxis="0.2 0.1 1" size="0 0 1"/>
    <geom name="board" type="box" pos="0.5 0.2 0.1" euler="10 20 30" size="0.6 0.02 0.4"/>
    <geom name="wedge" type="mesh" mesh="wedge" pos="-0.6 0.1 0"/>
    <geom name="rod" type="capsule" fromto="0.3 -0.5 -0.2 0.3 -0.5 1.0" size="0.03"/>
    <body name="arm">
      <joint name="a" axis="0 0 1" range="-3 3" limited="true"/>
      <geom name="upper" type="capsule" fromto="0 0 0 0.4 0 0" size="0.05"/>
      <body name="fore" pos="0.4 0 0">
        <joint name="b" axis="0 1 0" range="-3 3" limited="true"/>
        <geom name="lower" type="cylinder" fromto="0.1 0 0 0.4 0 0" size="0.04"/>
        <site name="tool" pos="0.45 0 0"/>
      </body>
    </body>
  </worldbody>
  <actuator><motor name="a" joint="a"/><motor name="b" joint="b"/></actuator>
</mujoco>
"""


@pytest.fixture(scope="module")
def scene(tmp_path_factory):
    path = tmp_path_factory.mktemp("yard") / "yard.xml"
    path.write_text(CELL)
    return Scene.load(path)


def test_bounds_lose_no_pair(scene):
    collision = CollisionModel(scene)
    data = mujoco.MjData(scene.model)
    nearest = set()
    for q in np.random.default_rng(0).uniform(-3, 3, (300, 2)):
        data.qpos[:] = q
        mujoco.mj_kinematics(scene.model, data)
        every = {
            pair: mujoco.mj_geomDistance(
                scene.model, data, scene.model.geom(pair[0]).id, scene.model.geom(pair[1]).id, 10.0, None
            )
            for pair in collision.pairs
        }
        found = collision.distance(q)
        assert found.distance == pytest.approx(min(every.values()), abs=1e-9)
        assert every[found.pair] == pytest.approx(found.distance, abs=1e-9)
        nearest |= set(found.pair)
    assert {"floor", "board", "wedge"} <= nearest


def test_a_site_stands_where_the_robot_has_its_tool(scene):
    collision = CollisionModel(scene)
    for q in np.random.default_rng(2).uniform(-3, 3, (20, 2)):
        distance, angle = collision.site_pose("tool", q).error_to(scene.robot().robot.fk(q))
        assert distance < 1e-9 and angle < 1e-9


def test_a_pair_that_may_touch_does_not_count(scene):
    q = [0.0, 1.4]
    first = CollisionModel(scene).distance(q)
    ids = tuple(scene.model.geom(name).id for name in first.pair)
    second = CollisionModel(scene, allowed_geoms=[ids]).distance(q)
    assert second.pair != first.pair and second.distance >= first.distance


FILTERS = """
<mujoco model="filters">
  <option>{flag}</option>
  <worldbody>
    <geom name="post" type="box" pos="0.3 0 0.2" size="0.1 0.1 0.2"/>
    <geom name="ghost" type="sphere" pos="-0.3 0 0.1" size="0.15" contype="0" conaffinity="0"/>
    <body name="base">
      <geom name="foot" type="sphere" size="0.12"/>
      <body name="one">
        <joint name="a" axis="0 0 1" range="-3 3" limited="true"/>
        <geom name="first" type="capsule" fromto="0 0 0 0.3 0 0" size="0.06"/>
        <body name="two" pos="0.3 0 0">
          <joint name="b" axis="0 1 0" range="-3 3" limited="true"/>
          <geom name="second" type="capsule" fromto="0 0 0 0.2 0 0" size="0.06" contype="2" conaffinity="3"/>
          <body name="rigid"><geom name="plate" type="box" pos="0.1 0 0" size="0.03 0.1 0.03"/></body>
          <body name="three" pos="0.2 0 0">
            <joint name="c" axis="0 1 0" range="-3 3" limited="true"/>
            <geom name="third" type="capsule" fromto="0 0 0 0.25 0 0" size="0.06"/>
            <site name="tool" pos="0.25 0 0"/>
          </body>
        </body>
      </body>
    </body>
  </worldbody>
  <contact>
    <exclude body1="one" body2="three"/>
    <pair geom1="third" geom2="ghost"/>
    <pair geom1="first" geom2="third"/>
  </contact>
  <actuator><motor joint="a"/><motor joint="b"/><motor joint="c"/></actuator>
</mujoco>
"""


@pytest.mark.parametrize("flag", ["", '<flag filterparent="disable"/>'])
def test_the_pairs_are_those_that_mujoco_itself_would_let_touch(tmp_path, flag):
    path = tmp_path / "filters.xml"
    path.write_text(FILTERS.format(flag=flag))
    scene = Scene.load(path)
    collision = CollisionModel(scene)
    pairs = {frozenset(pair) for pair in collision.pairs}
    data = mujoco.MjData(scene.model)
    touching = set()
    for q in np.random.default_rng(1).uniform(-3, 3, (300, 3)):
        data.qpos[:] = q
        mujoco.mj_forward(scene.model, data)
        for geoms in data.contact.geom:
            touching.add(frozenset(scene.model.geom(int(g)).name for g in geoms))
    assert touching <= pairs
    assert frozenset(("third", "ghost")) in touching and frozenset(("first", "third")) in touching
    # the others never meet in this arm, or never as deep as these samples
    assert all("post" in pair or "foot" in pair for pair in pairs - touching)
