"""Polish and judgement of configurations for CIDGIK's own queries: trees, several goals, workspaces of points."""

from __future__ import annotations

import numpy as np

from workcell.ik.cidgik.recover import nearest_turn
from workcell.ik.cidgik.search import Finished
from workcell.ik.shared.polish import CONVERGED
from workcell.ik.trees.judge import judge_query
from workcell.ik.trees.query import Goal, Query
from workcell.kernels.constants import ROTATION_WEIGHT
from workcell.pose import Array, rotation_vector

_SIDE = 1e-9
"""Sine below which two directions count as parallel."""


class QueryFinisher:
    """Gauss-Newton onto all goals of a query, within the joint limits; then the judge."""

    def __init__(self, query: Query) -> None:
        self.query = query

    def finish(self, q: Array) -> Finished:
        """A few steps without damping."""
        return self._judged(*polish_query(self.query, q, steps=10, damping=1e-9))

    def descend(self, q: Array) -> Finished:
        """A local search."""
        return self._judged(*polish_query(self.query, q, steps=20, damping=1e-2))

    def _judged(self, q: Array, moved: float) -> Finished:
        verdict = judge_query(self.query, q)
        return Finished(q, moved, None if verdict.accepted else verdict.reasons[0])


def polish_query(query: Query, q: Array, *, steps: int, damping: float) -> tuple[Array, float]:
    """Damped Gauss-Newton from angles (n,) onto all goals, within the limits; by how much a joint moved, radians."""
    robot = query.robot
    start = nearest_turn(q, 0.5 * (robot.lower + robot.upper))
    now = np.clip(start, robot.lower, robot.upper)
    e, J = _errors(query, now)
    for _ in range(steps):
        cost = float(e @ e)
        if cost < CONVERGED**2:
            break
        damped = np.vstack([J, np.sqrt(damping) * np.eye(robot.dof)])
        step = np.linalg.lstsq(damped, np.append(e, np.zeros(robot.dof)), rcond=None)[0]
        trial = np.clip(now + step, robot.lower, robot.upper)
        e_trial, J_trial = _errors(query, trial)
        if float(e_trial @ e_trial) < cost:
            now, e, J, damping = trial, e_trial, J_trial, max(0.1 * damping, 1e-12)
        else:
            damping = max(10.0 * damping, 1e-4)
    return now, float(np.abs(now - start).max())


def _errors(query: Query, q: Array) -> tuple[Array, Array]:
    """(6 goals,) weighted errors and their Jacobian."""
    robot = query.robot
    T = robot.link_transforms(q)
    errors, jacobians = [], []
    for goal in query.goals:
        tool = robot.tool(goal.tool)
        tip = (T[tool.link] @ tool.T_link_tool.matrix)[:3, 3]
        position, rotation = _goal_error(query, goal, T)
        J = robot.point_jacobian(T, tool.link, tip)
        errors += [position / ROTATION_WEIGHT, rotation]
        jacobians += [J[:3] / ROTATION_WEIGHT, _rotation_rows(goal, J[3:])]
    return np.concatenate(errors), np.vstack(jacobians)


def _goal_error(query: Query, goal: Goal, T: Array) -> tuple[Array, Array]:
    """(3,) metres and (3,) radians that a tool has yet to go: rotation vector, zero where the goal leaves it free."""
    tool = query.robot.tool(goal.tool)
    pose = T[tool.link] @ tool.T_link_tool.matrix
    position = goal.position - pose[:3, 3]
    if goal.kind == "position":
        return position, np.zeros(3)
    if goal.kind == "pose":
        return position, np.asarray(rotation_vector(goal.directions.T @ pose[:3, :3].T))
    have, want = pose[:3, :3] @ goal.axes[0], goal.directions[0]
    across = np.cross(have, want)
    sine = float(np.linalg.norm(across))
    if sine < _SIDE:
        return position, np.zeros(3) if have @ want > 0 else np.pi * _any_normal(have)
    angle = float(np.arctan2(sine, have @ want))
    return position, across * (angle / sine)


def _any_normal(v: Array) -> Array:
    n = np.cross(v, np.eye(3)[int(np.argmin(np.abs(v)))])
    normal: Array = n / np.linalg.norm(n)
    return normal


def _rotation_rows(goal: Goal, angular: Array) -> Array:
    """Rows (3, n) of the rotation error: none for positions; for a direction, turning about it does not count."""
    if goal.kind == "position":
        return np.zeros_like(angular)
    if goal.kind == "pose":
        return angular
    d = goal.directions[0]
    rows: Array = angular - np.outer(d, d @ angular)
    return rows
