"""A plain local solver, injected where the tests are about following a path and not about inverse kinematics."""

from __future__ import annotations

import numpy as np

from workcell.ik.problem import Clearance, IKProblem
from workcell.ik.result import IKResult, Status
from workcell.pose import Array, rotation_vector


def solve_locally(problem: IKProblem, attempts: int = 20) -> IKResult:
    """Damped least squares from the reference (or from random starts), within limits and the step bound."""
    robot = problem.robot
    lower, upper = robot.lower, robot.upper
    if problem.q_reference is not None and problem.max_step is not None:
        lower = np.maximum(lower, problem.q_reference - problem.max_step)
        upper = np.minimum(upper, problem.q_reference + problem.max_step)
    rng = np.random.default_rng(0)
    starts = [robot.home if problem.q_reference is None else problem.q_reference]
    starts += [rng.uniform(lower, upper) for _ in range(attempts)]
    for start in starts:
        q = _descend(problem, np.array(start), lower, upper)
        position, rotation = robot.fk(q).error_to(problem.target)
        if position > problem.tolerances.position or rotation > problem.tolerances.rotation:
            continue
        clearance = problem.checker(q) if problem.checker is not None else Clearance(np.inf)
        if clearance.distance >= problem.tolerances.safety_margin:
            return IKResult(Status.SOLVED, "local", q, position, rotation, clearance)
    return IKResult(Status.NOT_FOUND, "local")


def _descend(problem: IKProblem, q: Array, lower: Array, upper: Array) -> Array:
    for _ in range(60):
        T = problem.robot.fk_transform(q)
        error = np.concatenate(
            [problem.target.position - T[:3, 3], rotation_vector(problem.target.rotation @ T[:3, :3].T)]
        )
        if np.linalg.norm(error) < 1e-9:
            break
        J = problem.robot.jacobian(q)
        q = np.clip(q + J.T @ np.linalg.solve(J @ J.T + 1e-6 * np.eye(6), error), lower, upper)
    return q
