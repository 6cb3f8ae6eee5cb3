"""Plans in a compiled scene: around a post, proved pair by pair on the model, for the arm against itself too."""

import mujoco
import numpy as np
import pytest

from tests.motion.three_joints import MOTORS, bodies
from workcell.errors import InputError
from workcell.model.collision_model import CollisionModel
from workcell.model.scene import Scene
from workcell.motion.body import Upright
from workcell.motion.path import Path, Trajectory
from workcell.motion.plans.in_scene import plan_in_world
from workcell.motion.plans.result import PlanSettings
from workcell.motion.proofs.on_model import link_motion, prove_path, trajectory_clearance
from workcell.world.planning_world import PlanningWorld

CELL = f"""
<mujoco model="yard">
  <compiler angle="radian"/>
  <worldbody>
    <geom name="floor" type="plane" pos="0 0 -0.5" size="0 0 1"/>
    <geom name="post" type="cylinder" pos="0.75 0 0" size="0.06 0.5"/>
    {bodies(2.8, 2.8)}
  </worldbody>
  {MOTORS}
</mujoco>
"""
START, GOAL = np.array([-0.7, 0.0, 0.0]), np.array([0.7, 0.0, 0.0])


@pytest.fixture(scope="module")
def world(tmp_path_factory):
    path = tmp_path_factory.mktemp("yard") / "yard.xml"
    path.write_text(CELL)
    return PlanningWorld.of(Scene.load(path))


def dense(world, path, count=1500):
    return min(world.clearance(q).distance for q in path.at(np.linspace(0, len(path) - 1, count)))


def test_around_the_post(world):
    settings = PlanSettings(clearance=0.01)
    found = plan_in_world(world, START, GOAL, settings=settings, seed=2)
    assert found.planned and found.proof.proved and found.proof.margin >= 0.01
    assert dense(world, found.path) >= 0.01 - 1e-6
    again = plan_in_world(world, START, GOAL, settings=settings, seed=2)
    assert np.array_equal(found.path.configurations, again.path.configurations)


def test_any_of_several_goals(world):
    colliding = np.zeros(3)
    found = plan_in_world(world, START, [colliding, [-1.2, 0.3, 0.1]])
    assert found.planned and np.allclose(found.path.end, [-1.2, 0.3, 0.1])


def test_a_goal_in_the_post_names_the_pair_and_a_way_out(world):
    with pytest.raises(
        InputError, match=r"q_goals\[0\].*post.*overlap by \d+\.\d+ mm.*free configuration"
    ) as caught:
        plan_in_world(world, START, np.zeros(3))
    listed = str(caught.value).split(": [")[1].split("]")[0]
    assert world.clearance(np.array([float(value) for value in listed.split(",")])).distance > 0
    with pytest.raises(InputError, match="q_start"):
        plan_in_world(world, np.zeros(3), GOAL)
    with pytest.raises(InputError, match="takes 3 joint values"):
        plan_in_world(world, START[:2], GOAL)
    with pytest.raises(InputError, match="clearance"):
        PlanSettings(clearance=float("nan"))


def test_the_hand_stays_level(world):
    """Only the last joint tilts the hand; within its cone it may hardly move."""
    upright = Upright(0.2)
    found = plan_in_world(world, START, [GOAL], upright=upright, seed=1)
    assert found.planned
    path = found.path.at(np.linspace(0, len(found.path) - 1, 500))
    assert np.abs(path[:, 2]).max() <= 0.2 + 1e-9
    with pytest.raises(InputError, match=r"tilted by 0\.5"):
        plan_in_world(world, [-0.7, 0.0, 0.5], [GOAL], upright=upright)


def test_motions_of_links_bound_what_pairs_lose(world):
    """The excess that the proof uses is below every pair's distance anywhere in the box of configurations."""
    collision, robot = world.collision, world.robot.robot
    data, rng = mujoco.MjData(world.scene.model), np.random.default_rng(0)
    for _ in range(20):
        q, half = rng.uniform(-1.5, 1.5, 3), rng.uniform(0, 0.1, 3)
        least, found = collision.excess(q, link_motion(robot, q, half, world.cover), half)
        assert found.distance >= least
        for _ in range(5):
            data.qpos[:] = q + half * rng.uniform(-1, 1, 3)
            mujoco.mj_kinematics(world.scene.model, data)
            true = CollisionModel(world.scene).distance(data.qpos).distance
            assert true >= least - 1e-6


def test_a_graze_in_a_scene_is_found(world):
    """The arm sweeps past the post at the reach where its hand touches it by a millimetre, and misses it by one."""
    robot = world.robot.robot
    for offset, proved in ((-1e-3, False), (1e-3, True)):
        # folded so that the forearm's end passes the post's side
        elbow = _elbow_for_gap(world, offset)
        path = Path(robot, np.array([[-0.9, elbow, 0.0], [-0.9 + 2.4, elbow, 0.0]]))
        assert prove_path(path, world.clearance, world.cover).proved is proved


def _elbow_for_gap(world, wanted):
    """The elbow angle at which the smallest clearance of the sweep is `wanted`, by bisection on dense samples."""
    low, high = 1.0, 2.6
    for _ in range(13):
        middle = 0.5 * (low + high)
        sweep = np.column_stack([np.linspace(-0.9, 1.5, 160), np.full(160, middle), np.zeros(160)])
        gap = min(world.clearance(q).distance for q in sweep)
        low, high = (middle, high) if gap < wanted else (low, middle)
    return 0.5 * (low + high)


def test_a_timed_motion_is_proved_between_its_samples(world):
    t = np.linspace(0, 1, 51)
    q = START + np.outer(1 - np.cos(np.pi * t), [-0.3, 0.2, 0.1])
    qd = np.outer(np.pi * np.sin(np.pi * t), [-0.3, 0.2, 0.1])
    qdd = np.outer(np.pi**2 * np.cos(np.pi * t), [-0.3, 0.2, 0.1])
    robot = world.robot.robot
    proof = trajectory_clearance(
        robot, Trajectory("yard", t, q, qd, qdd), world.clearance, world.cover, floor=0.01
    )
    assert proof.proved and proof.margin >= 0.01
