"""The smallest distance over all pairs, found by bounds, equals the one found by asking every pair."""

import mujoco
import numpy as np
import pytest

from workcell.model.contact import CollisionModel
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


def test_a_pair_that_may_touch_does_not_count(scene):
    q = [0.0, 1.4]
    first = CollisionModel(scene).distance(q)
    ids = tuple(scene.model.geom(name).id for name in first.pair)
    second = CollisionModel(scene, allowed_geoms=[ids]).distance(q)
    assert second.pair != first.pair and second.distance >= first.distance
