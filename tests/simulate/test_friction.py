"""Holding by the fingers' contact forces alone: nothing is welded, and what slips is noticed and named."""

import mujoco
import numpy as np
import pytest

from tests.motion.local_solver import solve_locally
from tests.simulate.test_simulation import quintic, replace_start
from workcell.ik.problem import IKProblem
from workcell.pose import Pose
from workcell.simulate.execution import StopReason
from workcell.simulate.simulation import Simulation


@pytest.fixture(scope="module")
def at_the_brick(scene, robot):
    problem = IKProblem(robot, scene.goal("grasp").pose, q_reference=scene.robot().start)
    return replace_start(scene, solve_locally(problem).unwrap())


def lifted(scene, pads=1.0):
    """Grasp by friction, then lift by a hand's breadth with the pads' friction times `pads`."""
    simulation = Simulation(scene)
    held = simulation.grasp("brick", hold="friction")
    for geom in range(scene.model.ngeom):
        if "pad" in scene.model.geom(geom).name:
            simulation.model.geom_friction[geom] *= pads
    start = scene.robot().start
    # the shoulder goes back
    simulation.execute(quintic("sawyer", start, start - 0.12 * np.eye(7)[1], 0.6))
    return simulation, held


def test_friction_holds_the_brick(at_the_brick):
    simulation, held = lifted(at_the_brick)
    assert held and simulation.stop is None
    assert simulation.object_pose("brick").position[2] > 0.03
    assert not simulation.data.eq_active[simulation.model.equality("grasp:sawyer:brick").id]
    simulation.hold(0.5)
    assert 0.0 < simulation.slip() < 1e-3 and simulation.held == "brick"


def test_slippery_pads_lose_it_and_the_run_says_so(at_the_brick):
    """Two fingers of 35 N hold 1.7 N then, and the brick weighs 2.9 N."""
    simulation, held = lifted(at_the_brick, pads=0.02)
    assert held and simulation.stop.reason is StopReason.LOST_GRASP
    assert "brick slipped by" in simulation.stop.detail
    events = [event.text for event in simulation.result().events]
    assert any("the brick slips in the hand" in text for text in events), "a warning comes first"


def test_an_object_that_only_turns_in_the_hand_slips_too(at_the_brick):
    simulation = Simulation(at_the_brick)
    assert simulation.grasp("brick", hold="friction")
    before = simulation.slip()
    address = at_the_brick.object("brick").qpos_address
    turned = Pose(np.zeros(3), simulation.data.qpos[address + 3 : address + 7]) @ Pose(
        np.zeros(3), np.array([np.cos(0.05), np.sin(0.05), 0.0, 0.0])
    )
    simulation.data.qpos[address + 3 : address + 7] = turned.quat_wxyz
    mujoco.mj_forward(simulation.model, simulation.data)
    # a box of half sizes 0.03, 0.03, 0.04 that stands on its origin: its top edges are farthest from the x axis
    assert simulation.slip() == pytest.approx(2 * np.sin(0.05) * np.hypot(0.03, 0.08), abs=2 * before + 1e-6)


def test_releasing_by_friction(at_the_brick):
    simulation = Simulation(at_the_brick)
    before = simulation.object_pose("brick")
    assert simulation.grasp("brick", hold="friction") and simulation.release(opening=0.9)
    assert simulation.held is None and simulation.slip() == 0.0
    assert simulation.hold(0.2) and simulation.stands_on("brick", "plinth")
    assert simulation.object_pose("brick").error_to(before)[0] < 1e-3
