"""MuJoCo's own contacts are a second opinion: on the pairs that are looked at, deeper than distances may be off."""

import mujoco
import numpy as np
import pytest

from tests.model.judge.shapes import CONVEX, pair_model, scatter
from tests.model.judge.test_pairs import Generator
from workcell.errors import ModelError
from workcell.ik.judge.verify import Verifier
from workcell.model.collision_model import CollisionModel
from workcell.model.judge.contacts import deepest_contact
from workcell.model.judge.distances import judge_model
from workcell.model.judge.pairs import colliding_pairs
from workcell.model.scene import Scene
from workcell.motion.path import Path
from workcell.motion.proofs.on_model import prove_path
from workcell.world.planning_world import PlanningWorld


@pytest.mark.parametrize("first", ["hfield", *CONVEX])
def test_it_sees_what_the_distances_see(first):
    rng, met = np.random.default_rng(len(first)), 0
    for second in CONVEX:
        model = pair_model(rng, first, second, sizes=rng.uniform(0.05, 0.2, (2, 3)))
        judge, data = judge_model(model), mujoco.MjData(model)
        for _ in range(20):
            scatter(model, data, rng, 0.1)
            found = deepest_contact(judge, data, np.array([[0, 1]]))
            distance = judge.distance(data, 0, 1, 10.0)
            met += found is not None
            if found is None:
                assert distance > -1e-5 or {first, second} == {"box", "capsule"}
            else:
                assert found[1] == (0, 1) and found[0] < -1e-6 and distance < 0
    assert met > 10


def test_only_the_pairs_that_are_asked_for_count():
    model = Generator(9).model()
    model.geom_pos[:] = 0.0
    judge, data = judge_model(model), mujoco.MjData(model)
    data.qpos[:] = model.qpos0
    mujoco.mj_kinematics(judge.model, data)
    every = colliding_pairs(model, range(model.nbody))
    seen = [pair for pair in every if deepest_contact(judge, data, pair[None]) is not None]
    assert seen
    for pair in seen:
        assert deepest_contact(judge, data, pair[None])[1] == tuple(pair)
        rest = every[~(every == pair).all(axis=1)]
        found = deepest_contact(judge, data, rest)
        assert found is None or found[1] != tuple(pair)


CELL = """
<mujoco><compiler angle="radian"/><option ccd_iterations="2"/><worldbody>
  <geom name="wall" type="box" pos="0.4 0.4 0" size="0.05 0.2 0.2"/>
  <body name="arm"><joint name="a" axis="0 0 1" range="-3 3"/>
    <geom name="upper" type="cylinder" fromto="0.1 0 0 0.6 0 0" size="0.04"/><site name="tool" pos="0.6 0 0"/></body>
</worldbody><actuator><motor name="a" joint="a"/></actuator></mujoco>
"""


@pytest.fixture
def world(tmp_path):
    (tmp_path / "cell.xml").write_text(CELL)
    return PlanningWorld.of(Scene.load(tmp_path / "cell.xml"))


def test_where_it_and_the_distance_disagree_the_stricter_one_holds(world, monkeypatch):
    collision, q = world.collision, np.array([0.7])
    assert world.clearance(q).distance < 0
    assert collision.contact(q).pair == ("wall", "upper") and collision.contact([-1.0]) is None
    monkeypatch.setattr(type(collision._judge), "distance", lambda *_: 0.01)  # a distance that is wrong
    assert collision.distance(q).distance > 0
    judge = Verifier(world.problem(world.tool_pose(q)))
    assert judge(q).clearance.distance < -1e-6 and judge(q).clearance.pair == ("wall", "upper")
    assert not judge(q).accepted and judge(np.array([-1.0])).clearance.distance > 0
    proof = prove_path(Path(world.robot.robot, [[-1.0], [0.7]]), world.clearance, world.cover)
    assert not proof.proved and proof.failed_at == 1 and "collision between wall and upper" in proof.reason


def test_a_model_that_mujoco_itself_gives_up_on_is_refused_in_words(tmp_path):
    bodies = "".join(
        f'<body pos="{0.1 * k} 0 2"><freejoint/><geom type="box" size=".2 .2 .2"/></body>' for k in range(40)
    )
    text = CELL.replace("<worldbody>", f'<size memory="100K"/><worldbody>{bodies}')
    (tmp_path / "cell.xml").write_text(text)
    collision = CollisionModel(Scene.load(tmp_path / "cell.xml"))
    with pytest.raises(ModelError, match=r"MuJoCo's own collision detection.*memory"):
        collision.contact([-1.0])
