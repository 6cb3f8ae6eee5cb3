"""What the hand holds counts: where the bare hand passes under a bar, a rod in it must go round, or can't pass."""

import numpy as np
import pytest

from tests.motion.three_joints import MOTORS, bodies
from workcell.errors import InputError
from workcell.model.collision_model import CollisionModel
from workcell.model.scene import Scene
from workcell.motion.body import Upright
from workcell.motion.path import Path
from workcell.motion.plans.in_scene import plan_in_world
from workcell.motion.plans.result import PlanSettings
from workcell.motion.proofs.on_model import prove_path
from workcell.pose import Pose
from workcell.world.planning_world import PlanningWorld

CELL = """
<mujoco model="cell">
  <worldbody>
    <geom name="bar" type="box" pos="{middle} 0 0.16" size="{half} 0.02 0.06"/>
    <site name="mount"/>
    <site name="rack" pos="0 -3 0"/>
  </worldbody>
</mujoco>
"""
ARM = f"""
<mujoco model="arm">
  <compiler angle="radian"/>
  <worldbody>
    {bodies(1.5, 2.6)}
  </worldbody>
  {MOTORS}
</mujoco>
"""
ROD = """
<mujoco model="rod">
  <worldbody><body name="rod"><geom name="rod" type="capsule" size="0.01 0.14" mass="0.1"/></body></worldbody>
</mujoco>
"""
TASK = """
format = "workcell-task/1"
name = "bar"
cell = "cell.xml"
[[robots]]
name = "arm"
model = "arm.xml"
mount = "mount"
[[objects]]
name = "rod"
model = "rod.xml"
place = "rack"
"""
START, GOAL = np.array([-0.6, 0.0, 0.0]), np.array([0.6, 0.0, 0.0])
LEVEL = Upright(0.15)
SETTINGS = PlanSettings(iterations=1500)


def worlds(folder, middle, half):
    """The world with the hand empty and with the rod in it, upright at the tool."""
    for name, text in (
        ("cell.xml", CELL.format(middle=middle, half=half)),
        ("arm.xml", ARM),
        ("rod.xml", ROD),
    ):
        (folder / name).write_text(text)
    (folder / "bar.toml").write_text(TASK)
    bare = PlanningWorld.of(Scene.load(folder / "bar.toml"))
    return bare, bare.holding("rod", Pose.identity())


@pytest.fixture(scope="module")
def short(tmp_path_factory):
    """A bar over the reach of the outstretched arm alone."""
    return worlds(tmp_path_factory.mktemp("short"), 0.95, 0.14)


@pytest.fixture(scope="module")
def long(tmp_path_factory):
    """A bar over all that the arm reaches."""
    return worlds(tmp_path_factory.mktemp("long"), 0.65, 0.8)


def rod_clearance(world, path):
    """The smallest clearance of arm and rod together on the compiled model, at 600 configurations of a path."""
    model = CollisionModel(world.scene, world.robot.name, attached=world.attached)
    return min(model.distance(q).distance for q in path.at(np.linspace(0, len(path) - 1, 600)))


def test_the_bare_hand_passes_straight_and_the_rod_goes_round(short):
    bare, held = short
    straight = plan_in_world(bare, START, GOAL, settings=SETTINGS)
    assert straight.planned and len(straight.path) == 2
    # what is proved for the hand alone is no proof for the rod, and the obstacle is named
    proof = prove_path(straight.path, held.clearance, held.cover)
    assert not proof.proved and "bar" in proof.reason and "rod" in proof.reason
    assert rod_clearance(held, straight.path) < -0.02
    found = plan_in_world(held, START, GOAL, settings=SETTINGS, seed=1)
    assert found.planned and found.proof.proved and len(found.path) > 2
    assert rod_clearance(held, found.path) >= 0.0


def test_the_rod_goes_round_upright(short):
    """It can't be tilted under the bar: the arm has to be folded."""
    held = short[1]
    found = plan_in_world(held, START, GOAL, settings=SETTINGS, upright=LEVEL, seed=1)
    assert found.planned and rod_clearance(held, found.path) >= 0.0
    dense = found.path.at(np.linspace(0, len(found.path) - 1, 600))
    assert max(LEVEL.tilt(held.robot.robot, q) for q in dense) <= LEVEL.angle + 1e-9
    assert np.abs(dense[:, 1]).max() > 0.5


def test_upright_under_a_long_bar_there_is_no_way_with_the_rod(long):
    bare, held = long
    assert plan_in_world(bare, START, GOAL, settings=SETTINGS, upright=LEVEL).planned
    refused = plan_in_world(held, START, GOAL, settings=SETTINGS, upright=LEVEL)
    assert not refused.planned and refused.path is None and refused.detail
    # lowered, and tilted with that, it passes
    tilted = plan_in_world(held, START, GOAL, settings=SETTINGS, seed=2)
    assert tilted.planned and rod_clearance(held, tilted.path) >= 0.0
    assert np.abs(tilted.path.configurations[:, 2]).max() > LEVEL.angle


def test_optimised_paths_with_the_rod_are_proved_too(short):
    held = short[1]
    settings = PlanSettings(iterations=1500, optimise_s=np.inf, optimise_iterations=600)
    for upright in (None, LEVEL):
        first = plan_in_world(held, START, GOAL, settings=SETTINGS, upright=upright, seed=1)
        found = plan_in_world(held, START, GOAL, settings=settings, upright=upright, seed=1)
        assert first.optimised is None and found.optimised is not None
        spent = found.optimised
        assert spent.lower_bound <= spent.length <= spent.first_length
        assert spent.lower_bound == pytest.approx(1.2)
        assert spent.length == pytest.approx(length(found.path)) and spent.length <= length(first.path) + 1e-9
        assert found.proof.proved and rod_clearance(held, found.path) >= 0.0
        if upright is not None:
            assert all(upright.kept(held.robot.robot, q) for q in found.path.configurations)


def length(path: Path) -> float:
    return float(np.linalg.norm(np.diff(path.configurations, axis=0), axis=1).sum())


def test_a_start_where_only_the_rod_touches_is_refused_with_a_way_out(short):
    bare, held = short
    under = np.zeros(3)
    assert plan_in_world(bare, under, GOAL, settings=SETTINGS).planned
    with pytest.raises(InputError, match=r"q_start.*bar and rod/rod overlap by 30\.00 mm") as caught:
        plan_in_world(held, under, GOAL, settings=SETTINGS)
    listed = str(caught.value).split(": [")[1].split("]")[0]
    free = np.array([float(value) for value in listed.split(",")])
    assert held.clearance(free).distance > 0 and np.abs(free - under).max() < 0.7
    assert plan_in_world(held, free, GOAL, settings=SETTINGS).planned
