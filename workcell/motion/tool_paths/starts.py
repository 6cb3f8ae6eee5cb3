"""Configurations to begin a tool path with: sampled, near where the robot stands, and by whole turns of joints."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from workcell.ik.diverse.solutions import solutions
from workcell.ik.hjcd.solver import collect_solutions
from workcell.ik.problem import Budget, IKProblem
from workcell.model.robot import Robot
from workcell.motion.tool_paths.poses import PathTolerance
from workcell.motion.tool_paths.steps import starting_poses
from workcell.pose import Array


def with_turns(robot: Robot, found: Sequence[Array], near: Array | None) -> list[Array]:
    """Configurations (n,), before each of them the one in whole turns nearest to `near` (n,), where that is another."""
    kept = []
    for q in found:
        turned = q if near is None else robot.unwrap(q, near)
        kept += [q] if np.array_equal(turned, q) else [turned, q]
    return kept


def all_turns(robot: Robot, found: Sequence[Array]) -> list[Array]:
    """Configurations (n,) and all others within the limits that differ from them by whole turns of revolute joints."""
    kept = list(found)
    for q in found:
        kept += [other for other in robot.turns(q, q) if not np.array_equal(other, q)]
    return kept


def nearby(
    problem: IKProblem, tolerance: PathTolerance, near: Array, seed: int, budget: Budget
) -> list[Array]:
    """Configurations (n,) of the problem's pose, or of those that a tolerance allows, found from `near` (n,)."""
    poses = starting_poses(problem.target, tolerance)
    share = budget.shared(len(poses))
    asked = [replace(problem, target=pose, q_reference=near) for pose in poses]
    return [q for question in asked for q in collect_solutions(question, 1, seed, share)]


def sampled(
    problem: IKProblem, tolerance: PathTolerance, count: int, seed: int, budget: Budget
) -> list[Array]:
    """About `count` configurations (n,) of the problem's pose, or of poses that a tolerance allows."""
    poses = starting_poses(problem.target, tolerance)
    share, few = budget.shared(len(poses)), -(-count // len(poses))
    found: list[Array] = []
    for k, pose in enumerate(poses):
        results = solutions(replace(problem, target=pose), few, share, seed + k)
        found += [np.array(result.q) for result in results if result.q is not None]
    return found
