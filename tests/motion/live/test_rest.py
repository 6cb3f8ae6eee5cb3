"""How arms come to rest, and that no limit is exceeded inside a period either."""

import numpy as np
import pytest

from workcell.model.scene import Scene
from workcell.motion.live.live_ik import LiveIK
from workcell.motion.live.step import LiveStatus
from workcell.motion.live.weights import WEIGHTS_A, Weights
from workcell.pose import Pose
from workcell.world.planning_world import PlanningWorld


@pytest.fixture(scope="module")
def scene():
    return Scene.load("tracing", robot="iiwa14").drivable()


@pytest.fixture(scope="module")
def live(scene):
    return LiveIK(PlanningWorld.of(scene))


@pytest.fixture
def begun(live, scene):
    live.reset(scene.robot().start)
    return live, scene.robot().robot.fk(scene.robot().start)


def frames(live, goals):
    """(F, n) joints, the first as they are, and what the last step said."""
    rows, said = [live.q], None
    for goal in goals:
        said = live.step(goal)
        rows.append(said.q)
    return np.array(rows), said


def aside(pose, *offset):
    return Pose(pose.position + np.array(offset), pose.quat_wxyz)


def test_without_a_goal_an_arm_comes_to_rest_and_stays_there(begun):
    live, pose = begun
    _, moving = frames(live, [aside(pose, 0.1, 0.15, -0.1)] * 20)
    assert moving.status is LiveStatus.MOVING and np.abs(live.qd).max() > 0.1
    q, said = frames(live, [None] * 60)
    assert said.status is LiveStatus.NO_GOAL
    assert np.abs(np.diff(q[-20:], axis=0)).max() < 1e-9
    assert np.abs(live.qd).max() < 1e-8 and np.abs(live.qdd).max() < 1e-6


def test_on_its_goal_an_arm_rests(begun):
    live, pose = begun
    goal, alone = (
        aside(pose, 0.05, 0.1, -0.05),
        Weights(collision=0.0),
    )  # which has the arm creep, or off its goal
    said = [live.step(goal, weights=alone) for _ in range(300)]
    live.step(None, weights=WEIGHTS_A)
    assert said[-1].status is LiveStatus.ON_GOAL and said[-1].position_error[0] < 1e-8
    assert np.abs(np.diff([step.q for step in said[-20:]], axis=0)).max() < 1e-9


def test_goals_that_jump_take_every_limit_and_exceed_none(begun):
    """Differences of joints are means over periods of what is bounded in all of them."""
    live, pose = begun
    rng, goals = np.random.default_rng(4), []
    for _ in range(12):
        goals += [aside(pose, *rng.uniform(-0.25, 0.25, 3))] * int(rng.integers(5, 40))
    rates, _ = frames(live, goals)
    limits = live.limits
    for most in (limits.velocity, limits.acceleration, limits.jerk):
        rates = np.diff(rates, axis=0, prepend=rates[:1] if most is limits.velocity else np.zeros((1, 7)))
        rates = rates / live.period
        shares = np.abs(rates) / most
        assert shares.max() <= 1 + 1e-6
        assert shares.max() > 0.9


def test_a_margin_that_spheres_do_not_have_as_the_arm_begins_is_no_contact(scene):
    """The covers of two links are 3 mm apart at home, the links themselves 2 cm: the model itself is asked for them."""
    live, pose = LiveIK(PlanningWorld.of(scene), margin=0.006), scene.robot().robot.fk(scene.robot().start)
    _, said = frames(live, [aside(pose, 0.0, 0.1, -0.05)] * 60)
    assert said.status is not LiveStatus.IN_CONTACT and said.position_error[0] < 0.05
