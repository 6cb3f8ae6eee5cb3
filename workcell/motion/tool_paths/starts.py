"""Configurations to begin a tool path with: sampled, near where the robot stands, and by whole turns of joints."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np
from numpy.typing import ArrayLike

from workcell.ik.diverse.solutions import solutions
from workcell.ik.hjcd.solver import collect_solutions
from workcell.ik.problem import Budget, IKProblem
from workcell.model.robot import Robot
from workcell.motion.tool_paths.poses import PathTolerance
from workcell.motion.tool_paths.steps import starting_poses
from workcell.pose import Array


def turned_towards(robot: Robot, q: ArrayLike, near: ArrayLike) -> Array:
    """The configuration `q` (n,), each revolute joint moved by whole turns to where it is nearest to `near` (n,).

    Every link stays where it is. A joint whose nearest turn is beyond its limits keeps its value.
    """
    values = np.asarray(q, dtype=float)
    turned = values + 2 * np.pi * np.round((np.asarray(near, dtype=float) - values) / (2 * np.pi))
    free = robot.repeats & (turned >= robot.lower) & (turned <= robot.upper)
    return np.where(free, turned, values)


def with_turns(robot: Robot, found: Sequence[Array], near: Array | None) -> list[Array]:
    """Configurations (n,), and before each of them the one that `turned_towards` makes of it, where that is another."""
    kept = []
    for q in found:
        turned = q if near is None else turned_towards(robot, q, near)
        kept += [q] if np.array_equal(turned, q) else [turned, q]
    return kept


def all_turns(robot: Robot, found: Sequence[Array]) -> list[Array]:
    """Configurations (n,) and all others within the limits that differ from them by whole turns of revolute joints."""
    kept = list(found)
    for joint in np.flatnonzero(robot.repeats & (robot.upper - robot.lower > 2 * np.pi)):
        turn = 2 * np.pi * np.eye(robot.dof)[joint]
        for q in list(kept):
            kept += [other for other in (q - turn, q + turn) if bool(robot.within_limits(other))]
    return kept


def nearby(
    problem: IKProblem, tolerance: PathTolerance, near: Array, seed: int, budget: Budget
) -> list[Array]:
    """Configurations (n,) of the problem's pose, or of those that a tolerance allows, found from `near` (n,)."""
    poses = starting_poses(problem.target, tolerance)
    share = Budget(budget.cpu_s / len(poses))
    asked = [replace(problem, target=pose, q_reference=near) for pose in poses]
    return [q for question in asked for q in collect_solutions(question, 1, seed, share)]


def sampled(
    problem: IKProblem, tolerance: PathTolerance, count: int, seed: int, budget: Budget
) -> list[Array]:
    """About `count` configurations (n,) of the problem's pose, or of poses that a tolerance allows."""
    poses = starting_poses(problem.target, tolerance)
    share, few = Budget(budget.cpu_s / len(poses)), -(-count // len(poses))
    found: list[Array] = []
    for k, pose in enumerate(poses):
        results = solutions(replace(problem, target=pose), few, share, seed + k)
        found += [np.array(result.q) for result in results if result.q is not None]
    return found
