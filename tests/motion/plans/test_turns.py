"""Goals whole turns away are none: motions go to the nearest turn, and to others where they have to."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from tests.ik.arms import box
from workcell.errors import InputError
from workcell.geometry.types import SphereCover
from workcell.ik.diverse.solutions import solutions
from workcell.ik.problem import Budget, IKProblem
from workcell.ik.solve import solve
from workcell.model.loading.load import load_robot
from workcell.model.serial import serial_robot
from workcell.motion.plans.in_scene import plan_in_world
from workcell.motion.plans.to_pose import plan_to_pose
from workcell.pose import Pose

TURN = 2 * np.pi
RANGES = {"two turns": (-TURN, TURN), "off the centre": (-3.0, 8.0), "many": (-15.0, 15.0)}


@pytest.fixture(scope="module")
def ur10():
    return load_robot("ur10")


def ball(robot):
    """One sphere on the last link, so that paths are planned among spheres."""
    return SphereCover(np.array([robot.dof]), np.zeros((1, 3)), np.array([0.02]), kind="given")


@pytest.mark.parametrize("span", RANGES)
@pytest.mark.parametrize("seed", range(3))
def test_a_goal_near_by_is_reached_by_a_short_motion(ur10, span, seed):
    """Starts anywhere in ranges beyond a turn; the target a third of a radian on in one joint."""
    lower, upper = RANGES[span]
    robot = replace(ur10, lower=np.full(6, lower), upper=np.full(6, upper))
    rng = np.random.default_rng(seed)
    start = rng.uniform(lower + 0.4, upper - 0.4, 6)
    goal = start + 0.3 * np.eye(6)[seed]
    problem = IKProblem(robot, robot.fk(goal), (), ball(robot))
    plan = plan_to_pose(problem, start, seed=seed)
    assert plan.solved
    assert plan.stats["length"] == pytest.approx(0.3, abs=1e-3)
    answer = solve(replace(problem, q_near=start), seed=seed)
    assert answer.solved and np.array_equal(answer.q, robot.unwrap(answer.q, start))
    by_reference = solve(replace(problem, q_reference=start), seed=seed)
    assert np.abs(by_reference.q - start).max() == pytest.approx(0.3, abs=1e-3)
    for result in solutions(replace(problem, q_near=start), 3, Budget(5.0, effort=0.2), seed=seed):
        assert np.array_equal(result.q, robot.unwrap(result.q, start))


def finger(upper):
    """One joint with a rod, that may turn from 0.1 rad on."""
    joint = {"name": "a", "xyz": [0.0, 0.0, 0.0], "quat": [1.0, 0.0, 0.0, 0.0], "axis": [0.0, 0.0, 1.0]}
    return serial_robot("finger", [{**joint, "lower": -3.0, "upper": upper}], Pose.from_xyz([0.5, 0.0, 0.0]))


def test_a_turn_that_is_needed_is_made():
    """A wall between the start and the nearest turn: the way round, to the next one, remains."""
    robot = finger(upper=6.0)
    cover = SphereCover(np.array([1]), np.array([[0.5, 0.0, 0.0]]), np.array([0.02]), kind="given")
    wall = box("wall", (0.5, 0.0, 0.0), (0.05, 0.05, 0.05))
    problem = IKProblem(robot, robot.fk(np.array([-0.5])), (wall,), cover)
    assert robot.unwrap([-0.5], [0.5]) == pytest.approx([-0.5])
    plan = plan_to_pose(problem, [0.5], seed=1)
    assert plan.solved and plan.path[-1] == pytest.approx([TURN - 0.5], abs=1e-3)
    short = replace(problem, robot=finger(upper=5.0))
    assert not plan_to_pose(short, [0.5], budget=Budget(0.5), seed=1).solved


def test_in_a_scene_too(turning_world):
    world, robot = turning_world, turning_world.robot.robot
    start = np.zeros(robot.dof)
    goal = np.array([0.4 + TURN, -0.2, 0.3 - TURN])
    found = plan_in_world(world, start, goal)
    assert found.planned and found.path.end == pytest.approx([0.4, -0.2, 0.3])
    exact = plan_in_world(world, start, goal, turns=False)
    assert exact.planned and np.array_equal(exact.path.end, goal)
    answer = solve(world.problem(robot.fk(goal)))
    assert answer.solved and np.abs(answer.q - start).max() <= np.pi + 1e-6


@pytest.fixture(scope="module")
def turning_world(tmp_path_factory):
    from workcell.model.scene import robot_scene
    from workcell.world.planning_world import PlanningWorld

    file = tmp_path_factory.mktemp("arm") / "arm.xml"
    link = '<geom type="capsule" fromto="0 0 0.06 0 0 0.24" size="0.03" group="3"/>'
    inner = '<site name="tool" pos="0 0 0.3"/>'
    for name, axis in (("c", "1 0 0"), ("b", "0 1 0"), ("a", "0 0 1")):
        place = "0 0 0.3" if name != "a" else "0 0 0.1"
        joint = f'<joint name="{name}" axis="{axis}" range="-7 7"/>'
        inner = f'<body name="link {name}" pos="{place}">{joint}{link}{inner}</body>'
    motors = "".join(f'<motor joint="{name}"/>' for name in "abc")
    file.write_text(
        f'<mujoco><compiler angle="radian"/><worldbody><body name="base">{inner}</body></worldbody>'
        f"<actuator>{motors}</actuator></mujoco>"
    )
    return PlanningWorld.of(robot_scene(str(file)))


def test_where_a_robot_stands_is_a_configuration(ur10):
    with pytest.raises(InputError, match="q_near"):
        IKProblem(ur10, Pose.identity(), q_near=np.zeros(3))
