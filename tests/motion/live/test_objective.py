"""The frame's weighted sum against plain numpy, and its gradient and the conditioning's against differences."""

import numpy as np
import pytest

from tests.motion.live.kernels.called import conditioning_at
from tests.motion.live.reference import objective
from workcell.motion.live.goals import LiveGoal
from workcell.motion.live.live_ik import LiveIK
from workcell.motion.live.objective import Objective
from workcell.motion.live.weights import WEIGHTS_A, WEIGHTS_B, Weights
from workcell.pose import Pose
from workcell.world.planning_world import PlanningWorld


@pytest.fixture(scope="module")
def world():
    return PlanningWorld.of("ur5")


def driven(world, weights=WEIGHTS_A, loss="groove", goal=None):
    """A frame in the midst of a motion, its objective, and the last three relaxed solutions."""
    live = LiveIK(world, weights=weights, loss=loss)
    start = world.robot.robot.fk(live.q)
    goal = goal or Pose(start.position + np.array([0.05, -0.1, 0.08]), start.quat_wxyz)
    for _ in range(6):
        live.step(goal)
    return live, Objective(live._frame, live._desk.box), np.array(live._wish.past), goal


@pytest.mark.parametrize("loss", ["groove", "quadratic"])
@pytest.mark.parametrize("weights", [WEIGHTS_A, WEIGHTS_B], ids=["A", "B"])
def test_the_sum_is_the_papers(world, loss, weights):
    plain = Weights(*weights.array[:6], collision=0.0)
    live, asked, past, goal = driven(world, plain, loss)
    rng = np.random.default_rng(0)
    for _ in range(20):
        q = past[0] + rng.uniform(-0.2, 0.2, size=live.robot.dof)
        want = objective(live.robot, q, past, goal, plain.array, loss)
        assert asked.value(q) == pytest.approx(want, rel=1e-9, abs=1e-9)


@pytest.mark.parametrize("loss", ["groove", "quadratic"])
def test_the_gradient_is_that_of_the_sum(world, loss):
    live, asked, past, _ = driven(world, WEIGHTS_B, loss)
    rng = np.random.default_rng(1)
    for _ in range(20):
        q = past[0] + rng.uniform(-0.1, 0.1, size=live.robot.dof)
        gradient = asked.value_and_gradient(q)[1].copy()
        for k, step in enumerate(1e-6 * np.eye(live.robot.dof)):
            rate = (asked.value(q + step) - asked.value(q - step)) / 2e-6
            assert gradient[k] == pytest.approx(rate, rel=1e-4, abs=1e-4)


def test_inside_its_bands_a_goal_asks_for_nothing(world):
    here = world.robot.robot.fk(LiveIK(world).q)
    band = LiveGoal(
        here, position_band=np.tile([-0.3, 0.3], (3, 1)), rotation_band=np.tile([-0.6, 0.6], (3, 1))
    )
    live = LiveIK(world)
    step = live.step(band)
    assert step.position_error == pytest.approx(0.0)
    assert step.rotation_error == pytest.approx(0.0)
    moved = Pose(here.position + np.array([0.0, 0.0, 0.1]), here.quat_wxyz)
    narrow = LiveGoal(moved, position_band=np.array([[-np.inf, np.inf], [-np.inf, np.inf], [0.0, 0.0]]))
    assert live.step(narrow).position_error == pytest.approx(0.1, abs=2e-3)
    for _ in range(100):
        step = live.step(narrow)
    tool = live.robot.fk(step.q)
    assert tool.position[2] == pytest.approx(here.position[2] + 0.1, abs=1e-3)


def test_conditioning_is_that_of_numpy_and_its_gradient_that_of_differences(world):
    live = LiveIK(world)
    robot, rng = live.robot, np.random.default_rng(2)
    slope, none = np.empty(robot.dof), np.empty(robot.dof)
    for _ in range(30):
        q = robot.random_configuration(rng)
        values = np.linalg.svd(robot.jacobian(q), compute_uv=False)
        assert conditioning_at(live._frame, q, slope) == pytest.approx(values[-1] / values[0], abs=1e-7)
        for k, step in enumerate(1e-6 * np.eye(robot.dof)):
            ahead, behind = (
                conditioning_at(live._frame, q + step, none),
                conditioning_at(live._frame, q - step, none),
            )
            assert slope[k] == pytest.approx((ahead - behind) / 2e-6, abs=2e-4)
