"""A world's clearance is called, leads proofs to the model, and knows which spheres may hit each other."""

import numpy as np
import pytest

from tests.motion.three_joints import MOTORS, bodies
from workcell.errors import InputError
from workcell.geometry.self_collision import self_collision_pairs
from workcell.model.scene import Scene
from workcell.motion.proofs.on_model import prove_segment
from workcell.motion.tool_paths.models import worlds
from workcell.pose import Pose
from workcell.world.planning_world import PlanningWorld

CELL = f"""
<mujoco model="yard">
  <compiler angle="radian"/>
  <worldbody>
    <geom name="post" type="cylinder" pos="0 0.9 0" size="0.06 0.5"/>
    {bodies(2.8, 2.8)}
  </worldbody>
  {MOTORS}
</mujoco>
"""
TASK = """
format = "workcell-task/1"
name = "carrying"
cell = "cell.xml"
[[robots]]
name = "arm"
model = "arm.xml"
mount = "mount"
[[objects]]
name = "rod"
model = "rod.xml"
place = "place"
"""
FOLDED = np.array([0.0, 2.7, 0.0])


@pytest.fixture(scope="module")
def world(tmp_path_factory):
    path = tmp_path_factory.mktemp("yard") / "yard.xml"
    path.write_text(CELL)
    return PlanningWorld.of(Scene.load(path))


def test_it_is_the_distance_of_the_compiled_model(world):
    q = np.array([0.3, -0.4, 0.1])
    found, there = world.clearance(q), world.collision.distance(q)
    assert (found.distance, found.pair) == (there.distance, there.pair)
    assert world.problem(world.robot.robot.fk(q)).checker == world.clearance


def test_proofs_ask_the_model_pair_by_pair_and_other_checkers_as_a_whole(world):
    robot, q = world.robot.robot, np.array([0.0, 0.2, 0.0])
    of_pairs = prove_segment(robot, q, q + 0.4, world.clearance, world.cover)
    as_a_whole = prove_segment(robot, q, q + 0.4, lambda q: world.clearance(q), world.cover)
    assert of_pairs.proved and as_a_whole.proved
    # a pair of the arm's own loses nothing by joints that move both
    assert of_pairs.margin > as_a_whole.margin


def test_pairs_of_spheres_are_those_of_links_that_the_model_collides(world):
    robot, cover = world.robot.robot, world.cover
    pairs = world.self_pairs(cover)
    assert {tuple(sorted(pair)) for pair in cover.link[pairs].tolist()} <= world.collision.self_links
    whole = self_collision_pairs(
        robot, cover, links=world.collision.self_links, known_free=robot.home, samples=200, prove=False
    )
    assert np.array_equal(pairs, whole.pairs)
    template = world.problem(robot.fk(robot.home))
    assert len(pairs) and len(worlds(template, 0.0)[0].pairs) == len(pairs)


def test_pairs_that_touch_where_the_robot_is_free_are_left_out_there_alone(world):
    robot, cover = world.robot.robot, world.cover
    before = world.self_pairs(cover)
    free = np.stack([robot.home, FOLDED])
    folded = world.self_pairs(cover, free)
    whole = self_collision_pairs(
        robot, cover, links=world.collision.self_links, known_free=free, samples=200, prove=False
    )
    assert np.array_equal(folded, whole.pairs)
    assert np.array_equal(world.self_pairs(cover), before)
    with pytest.raises(InputError, match="known_free"):
        world.self_pairs(cover, np.zeros(2))


def test_a_home_that_is_not_clear_tells_nothing_of_the_robot_itself(tmp_path):
    path = tmp_path / "blocked.xml"
    path.write_text(CELL.replace('pos="0 0.9 0"', 'pos="0.6 0 0"'))
    world = PlanningWorld.of(Scene.load(path))
    robot, cover = world.robot.robot, world.cover
    assert not world.clearance(robot.home).distance > 0
    every = self_collision_pairs(robot, cover, links=world.collision.self_links, samples=200, prove=False)
    assert np.array_equal(world.self_pairs(cover), every.pairs)


def test_what_the_hand_carries_keeps_clear_of_every_link_but_its_own(tmp_path):
    arm = f'<mujoco model="arm"><compiler angle="radian"/><worldbody>{bodies(2.8, 2.8)}</worldbody>{MOTORS}</mujoco>'
    rod = '<geom name="rod" type="capsule" size="0.02 0.3"/>'
    files = {
        "arm": arm,
        "rod": f'<mujoco><worldbody><body name="rod">{rod}</body></worldbody></mujoco>',
        "cell": '<mujoco><worldbody><site name="mount"/><site name="place" pos="0 -1.5 0"/></worldbody></mujoco>',
    }
    for name, text in files.items():
        (tmp_path / f"{name}.xml").write_text(text)
    (tmp_path / "carrying.toml").write_text(TASK)
    scene = Scene.load(tmp_path / "carrying.toml")
    bare = PlanningWorld.of(scene)
    # across the hand: its ends can reach the forearm, which the hand's own box never does by MuJoCo's rules
    world = bare.holding("rod", Pose.from_xyz([0.05, 0.0, 0.0]))
    robot, cover = world.robot.robot, world.cover
    assert (2, 3) not in bare.collision.self_links and (2, 3) in world.collision.self_links
    assert not bare.collision.carried_geoms and world.collision.carried_geoms == {"rod/rod"}
    pairs = world.self_pairs(cover)
    carried = np.array([name == "rod/rod" for name in cover.source])
    of_rod = carried[pairs].any(axis=1)
    links = {tuple(sorted(pair)) for pair in cover.link[pairs[of_rod]].tolist()}
    assert (2, 3) in links and (1, 3) in links and (3, 3) not in links
    own = {tuple(sorted(pair)) for pair in cover.link[pairs[~of_rod]].tolist()}
    assert (2, 3) not in own
    # wherever the model has the rod in the robot, and the cover knows of no such overlap at home, a pair tells
    rng, met = np.random.default_rng(0), 0
    for q in robot.random_configuration(rng, 300):
        geoms = world.collision.distance(q)
        if geoms.distance < -0.01 and "rod/rod" in geoms.pair:
            at = cover.centres_world(robot.link_transforms(q))
            gap = np.linalg.norm(at[pairs[:, 0]] - at[pairs[:, 1]], axis=1) - cover.radius[pairs].sum(axis=1)
            assert gap[of_rod].min() < 0.0
            met += 1
    assert met > 5
