"""No proof takes what is nearly so for so: arms of files with few digits reach what they reach, by every solver."""

from __future__ import annotations

import numpy as np
import pytest

from workcell.bench.reference.nearly import nearly_arm, planted, written_arm
from workcell.ik.cidgik.reduction import Reduction
from workcell.ik.cidgik.skeleton import Skeleton
from workcell.ik.cidgik.solver import prove_cidgik
from workcell.ik.ikspark.lift import Lift
from workcell.ik.problem import Budget, IKProblem
from workcell.ik.registry import solver_names
from workcell.ik.result import Status
from workcell.ik.solve import solve
from workcell.ik.trees.query import Goal
from workcell.model.robot import Robot
from workcell.model.serial import serial_robot
from workcell.pose import Pose

HALF_TURN = 3.1416
"""Pi in five digits: 7e-6 rad too much."""


def two_parallel(half_turn: float) -> Robot:
    """Six joints, the first two about parallel axes that a URDF's `rpy` of half a turn makes, and the last two."""
    flip = [np.cos(half_turn / 2), np.sin(half_turn / 2), 0.0, 0.0]
    side = [np.cos(np.pi / 4), np.sin(np.pi / 4), 0.0, 0.0]
    straight = [1.0, 0.0, 0.0, 0.0]
    rows = [
        ([0.0, 0.0, 0.3], straight),
        ([0.35, 0.0, 0.0], flip),
        ([0.3, 0.0, 0.1], side),
        ([0.0, 0.3, 0.05], straight),
        ([0.0, 0.1, 0.2], side),
        ([0.15, 0.0, 0.1], flip),
    ]
    joints = [
        {"name": f"j{k}", "xyz": xyz, "quat": quat, "axis": [0.0, 0.0, 1.0], "lower": -2.6, "upper": 2.6}
        for k, (xyz, quat) in enumerate(rows)
    ]
    return serial_robot("two_parallel", joints, Pose.from_xyz([0.0, 0.05, 0.12]))


@pytest.mark.parametrize("solver", ["ikspark", "cidgik"])
@pytest.mark.parametrize("half_turn", [np.pi, HALF_TURN])
def test_a_half_turn_in_few_digits_costs_no_solution(solver: str, half_turn: float) -> None:
    robot, rng = two_parallel(half_turn), np.random.default_rng(3)
    for _ in range(20):
        problem = IKProblem(robot, robot.fk(robot.random_configuration(rng)))
        assert solve(problem, solver, Budget(10.0)).status is Status.SOLVED


def test_links_are_planar_only_where_axes_are_parallel_but_for_rounding() -> None:
    assert [disc.link for disc in Lift(two_parallel(np.pi)).discs] == [1, 2, 4, 5]
    assert [disc.link for disc in Lift(two_parallel(HALF_TURN)).discs] == [1, 5]


@pytest.mark.parametrize("seed", range(4))
def test_a_pose_that_is_reached_is_never_proved_unreachable(seed: int) -> None:
    rng = np.random.default_rng(seed)
    for k in range(8):
        robot = written_arm(rng) if k % 2 else nearly_arm(rng)
        problem, _ = planted(robot, rng)
        for solver in solver_names():
            if not solver.endswith("+lm"):
                assert not solve(problem, solver, Budget(0.5), seed=k).status.is_proof, (seed, k, solver)
        assert prove_cidgik(problem) is None


def test_vectors_that_nearly_depend_on_each_other_are_good_for_no_proof() -> None:
    def reduced(half_turn: float) -> Reduction:
        robot = two_parallel(half_turn)
        nothing = (np.zeros(0, dtype=np.int64), np.zeros((0, 3)))
        goal = Goal.posed(robot.default_tool, Pose.identity())
        return Reduction(Skeleton(robot, (goal,), nothing, robot.lower, robot.upper))

    assert reduced(np.pi).exact
    # a pair that is 1e-9 rad from parallel: its vectors are dependent to within that
    assert not reduced(np.pi + 1e-9).exact or reduced(np.pi + 1e-9).rank > reduced(np.pi).rank


@pytest.mark.parametrize("axis", [[0.0, 0.0, 1.0 + 1e-7], [1e-4, 0.0, 1.0 - 1e-7]])
def test_axes_that_are_nearly_unit_vectors_are_made_so(axis: list[float]) -> None:
    joints = [
        {
            "name": "a",
            "xyz": [0.0] * 3,
            "quat": [0.7071, 0.0, 0.7071, 0.0],
            "axis": axis,
            "lower": -1,
            "upper": 1,
        }
    ]
    joints[0]["quat"] = np.array(joints[0]["quat"]) / np.linalg.norm(joints[0]["quat"])
    robot = serial_robot("one", joints, Pose.identity())
    assert abs(np.linalg.norm(robot.axis[0]) - 1.0) < 1e-15
    assert np.abs(robot.joint_rotation[0] @ robot.joint_rotation[0].T - np.eye(3)).max() < 2e-15
