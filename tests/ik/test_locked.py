"""Joints of one value: every solver finds what is there, and motions leave such a joint alone."""

from dataclasses import replace

import numpy as np
import pytest

from workcell.errors import InputError
from workcell.ik.problem import Budget, IKProblem
from workcell.ik.registry import solver_names
from workcell.ik.result import Status
from workcell.ik.solve import solve
from workcell.model.loading.load import load_robot
from workcell.model.scene import robot_scene
from workcell.motion.path import Path
from workcell.motion.plans.in_scene import plan_in_world
from workcell.motion.timing.retime import retime
from workcell.simulate.simulation import Simulation
from workcell.world.planning_world import PlanningWorld

LINK = """
<link name="l{k}"><inertial><mass value="1"/><inertia ixx=".01" iyy=".01" izz=".01" ixy="0" ixz="0" iyz="0"/></inertial>
<collision><origin xyz="0 0 0.1"/><geometry><cylinder radius="0.03" length="0.16"/></geometry></collision></link>
"""
JOINT = """
<joint name="j{k}" type="revolute"><parent link="l{parent}"/><child link="l{k}"/><origin xyz="0 0 0.2"/>
<axis xyz="{axis}"/><limit {limits} effort="60" velocity="2"/></joint>
"""
AXES = ("0 0 1", "0 1 0", "1 0 0", "0 1 0", "0 0 1", "0 1 0", "1 0 0")


def arm(locked, value):
    """A URDF of seven joints, one of them locked."""
    parts = [LINK.format(k=k) for k in range(8)]
    for k, axis in enumerate(AXES):
        limits = f'lower="{value}" upper="{value}"' if k == locked else 'lower="-2.2" upper="2.4"'
        parts.append(JOINT.format(k=k + 1, parent=k, axis=axis, limits=limits))
    return f'<robot name="arm">{"".join(parts)}</robot>'


@pytest.fixture(scope="module")
def path(tmp_path_factory):
    file = tmp_path_factory.mktemp("locked") / "arm.urdf"
    file.write_text(arm(3, 0.5))
    return file


@pytest.fixture(scope="module")
def robot(path):
    return load_robot(path).chain()


@pytest.mark.parametrize("solver", [name for name in solver_names() if not name.endswith("+lm")])
def test_every_solver_finds_configurations_of_a_locked_joint(robot, solver):
    rng = np.random.default_rng(4)
    for _ in range(3):
        planted = robot.random_configuration(rng)
        assert planted[3] == 0.5
        result = solve(IKProblem(robot, robot.fk(planted)), solver, Budget(20.0))
        assert result.status is Status.SOLVED and result.q[3] == pytest.approx(0.5, abs=1e-6)


def test_what_the_lock_keeps_out_of_reach_is_proved_unreachable(robot):
    also = np.arange(7) == 5
    six = replace(robot, lower=np.where(also, 0.3, robot.lower), upper=np.where(also, 0.3, robot.upper))
    free = replace(robot, lower=np.full(7, -2.2), upper=np.full(7, 2.4))
    q = np.array([0.3, -0.4, 0.5, -1.2, 0.2, 0.9, -0.3])
    assert solve(IKProblem(free, free.fk(q))).solved
    assert solve(IKProblem(six, free.fk(q)), budget=Budget(30.0)).status is Status.UNREACHABLE


def test_a_locked_joint_is_planned_proved_timed_and_executed(path):
    scene = robot_scene(path)
    world = PlanningWorld.of(scene)
    actor = scene.robot()
    goal = np.array([0.5, 0.4, 0.3, 0.5, -0.4, 0.5, 0.2])
    assert world.clearance(goal).distance > 0
    found = plan_in_world(world, actor.start, goal)
    assert found.path is not None and found.proof.proved
    assert np.allclose(found.path.configurations[:, 3], 0.5)
    trajectory = retime(found.path, acceleration=4.0)
    assert np.abs(trajectory.qd[:, 3]).max() < 1e-9
    simulation = Simulation(scene)
    assert simulation.execute(trajectory)
    assert simulation.result().max_tracking_error_m < 1e-3
    assert np.abs(simulation.result().q[:, 3] - 0.5).max() < 1e-4


def test_a_path_that_moves_a_locked_joint_is_refused(robot):
    with pytest.raises(InputError, match="j4"):
        Path(robot, np.array([np.zeros(7), np.full(7, 0.5)]))
