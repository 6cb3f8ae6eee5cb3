"""Eq. 75 as rows: every turn within the bound keeps them, a whole frame's row is the bound itself."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from tests.ik.lifted_arms import parallel_elbow, seven_axis, skew_arm
from workcell.bench.ik.cidgik_scaling import long_arm
from workcell.bench.reference.cidgik_problems import bench_arm, off_centre
from workcell.ik.cidgik.instance import Instance
from workcell.ik.cidgik.model import fastest_relaxation_at, relaxation_at
from workcell.ik.cidgik.solver import solve_cidgik
from workcell.ik.cidgik.turning import turning_rows
from workcell.ik.judge.verify import verify
from workcell.ik.problem import Budget, IKProblem
from workcell.ik.shared.conic import svec
from workcell.ik.solve import solve
from workcell.model.robot import Robot
from workcell.pose import Pose, axis_angle_to_matrix

ARMS = [
    bench_arm("ur10"),
    off_centre(bench_arm("kuka")),
    seven_axis(),
    parallel_elbow(),
    skew_arm(26, 6),
    replace(seven_axis(1.2), T_world_base=Pose(np.array([0.3, -0.2, 0.5]), np.array([0.5, 0.5, 0.5, -0.5]))),
]


def rotations(robot: Robot, q: np.ndarray) -> np.ndarray:
    """Of the links, seen from the base."""
    return robot.T_world_base.rotation.T @ robot.link_transforms(q)[:, :3, :3]


def values(instance: Instance, q: np.ndarray, rows: np.ndarray) -> np.ndarray:
    """What the rows are at a configuration that reaches the goal."""
    X = instance.structure.reduction.basis_at(q)
    columns = np.vstack([X, np.eye(3)])[instance.structure.keep]
    y = instance.D.T @ (svec(columns @ columns.T) - instance.Z0)
    return rows @ np.append(y, 1.0)


def test_a_bounded_turn_moves_no_direction_farther() -> None:
    rng = np.random.default_rng(0)
    for _ in range(300):
        axes = rng.normal(size=(3, 3))
        axes /= np.linalg.norm(axes, axis=1, keepdims=True)
        before = axis_angle_to_matrix(axes[0], rng.uniform(-3, 3))
        after = axis_angle_to_matrix(axes[1], rng.uniform(-3, 3)) @ before
        b = float(np.linalg.norm(after - before))
        assert (before @ axes[2]) @ (after @ axes[2]) >= 1.0 - b**2 / 4 - 1e-12
        assert np.trace(before.T @ after) == pytest.approx(3.0 - b**2 / 2)


@pytest.mark.parametrize("robot", ARMS, ids=lambda robot: f"{robot.name}{robot.dof}")
def test_rows_follow_from_the_bound(robot: Robot) -> None:
    rng = np.random.default_rng(1)
    seen = 0
    for _ in range(40):
        q = robot.random_configuration(rng)
        before = np.clip(q + rng.normal(size=robot.dof) * rng.uniform(0.0, 0.4), robot.lower, robot.upper)
        changes = np.linalg.norm(rotations(robot, q) - rotations(robot, before), axis=(1, 2))
        instance, _ = relaxation_at(IKProblem(robot, robot.fk(q)))
        rows = turning_rows(instance, rotations(robot, before), max(float(changes.max()), 1e-6))
        assert np.all(values(instance, q, rows) >= -1e-7)
        seen += len(rows)
    assert seen > 40


def test_the_row_of_a_frame_is_the_bound() -> None:
    robot = skew_arm(26, 6)
    rng, told = np.random.default_rng(2), 0
    for _ in range(30):
        q = robot.random_configuration(rng)
        before = q + rng.normal(size=robot.dof) * 0.2
        instance, _ = relaxation_at(IKProblem(robot, robot.fk(q)))
        skeleton = instance.structure.skeleton
        free = sorted(skeleton.framed - skeleton.known)
        assert free == [link for link in range(robot.dof + 1) if link not in skeleton.known]
        changes = np.linalg.norm(rotations(robot, q) - rotations(robot, before), axis=(1, 2))[free]
        bound = float(np.median(changes))
        kept = values(instance, q, turning_rows(instance, rotations(robot, before), bound)) >= 0
        assert np.array_equal(
            kept[np.abs(changes - bound) > 1e-6], (changes <= bound)[np.abs(changes - bound) > 1e-6]
        )
        told += int(np.count_nonzero(~kept))
    assert told > 0


@pytest.mark.parametrize("robot", ARMS[:4], ids=lambda robot: robot.name)
def test_steps_keep_the_bound(robot: Robot) -> None:
    """Also where a step within the joints' bound alone would turn a link too far."""
    rng = np.random.default_rng(3)
    for seed in range(3):
        q = 0.5 * robot.random_configuration(rng)
        moved = q + rng.uniform(-0.05, 0.05, robot.dof)
        bound = 1.02 * float(np.linalg.norm(rotations(robot, moved) - rotations(robot, q), axis=(1, 2)).max())
        problem = IKProblem(robot, robot.fk(moved), q_reference=q, max_step=0.3, max_link_rotation=bound)
        result = solve(problem, "cidgik", Budget(10.0, effort=1.0), seed)
        assert result.solved and result.q is not None
        assert verify(problem, result.q).accepted


def test_a_target_beyond_the_bound_is_empty_at_once() -> None:
    """No certificate: what is proved is proved without the bound."""
    robot = seven_axis()
    q = np.array([0.3, 0.6, -0.2, 1.0, 0.4, 0.8, 0.5])
    problem = IKProblem(robot, robot.fk(q + 0.1), q_reference=q, max_step=0.3, max_link_rotation=0.02)
    candidate = solve_cidgik(problem, Budget(10.0, effort=1.0))
    assert candidate.q is None and candidate.certificate is None and candidate.error is None
    assert candidate.stats["low_rank"] == 0 and candidate.stats["restarts"] <= 3


def test_blocks_have_the_rows_too() -> None:
    robot = long_arm(20, 2.0)
    q = np.full(20, 0.2)
    problem = IKProblem(robot, robot.fk(q + 0.005), q_reference=q, max_step=0.1, max_link_rotation=0.3)
    _, blocks, _ = fastest_relaxation_at(problem)
    assert not isinstance(blocks, Instance)
    result = solve(problem, "cidgik", Budget(10.0))
    assert result.solved and result.q is not None and verify(problem, result.q).accepted
