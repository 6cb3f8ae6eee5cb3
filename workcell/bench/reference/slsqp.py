"""The papers' nonlinear-programming baseline: scipy's SLSQP on the tool's error twist, from one random start."""

from __future__ import annotations

import time
from dataclasses import dataclass
from typing import Any

import numpy as np

from workcell.ik.problem import IKProblem
from workcell.pose import Array, rotation_vector

ITERATIONS = 200


@dataclass(frozen=True, slots=True)
class SlsqpRun:
    """Where a run ended, and the CPU seconds it took."""

    q: Array
    cpu_s: float


def run_slsqp(problem: IKProblem, seed: int) -> SlsqpRun:
    """Minimise the squared error twist within the joint limits, with |y - c|^2 >= l^2 for every point and sphere.

    CIDGIK's Eq. 18. The paper states no start: ours is drawn evenly in the limits. Gradients are analytic.

    Args:
        problem: its obstacles are spheres.
        seed: of the start.
    """
    from scipy.optimize import minimize

    robot = problem.robot
    # a joint that turns all the way has no bound to be stuck at
    whole = robot.upper - robot.lower >= 2 * np.pi - 1e-9
    start = robot.random_configuration(np.random.default_rng(seed))
    constraints: list[dict[str, Any]] = []
    if problem.obstacles and problem.cover is not None:
        keep = _Distances(problem)
        constraints = [{"type": "ineq", "fun": keep.values, "jac": keep.gradients}]
    began = time.process_time()
    with np.errstate(all="ignore"):
        settings: dict[str, Any] = {
            "jac": True,
            "method": "SLSQP",
            "bounds": [
                (None, None) if wraps else (lower, upper)
                for lower, upper, wraps in zip(robot.lower, robot.upper, whole, strict=True)
            ],
            "constraints": constraints,
            "options": {"maxiter": ITERATIONS, "ftol": 1e-12},
        }
        found = minimize(_cost, start, (problem,), **settings)
    q = np.clip(robot.unwrap(found.x), robot.lower, robot.upper)
    return SlsqpRun(q, time.process_time() - began)


def _cost(q: Any, problem: IKProblem) -> Any:
    """Squared error (metres and radians alike, as the twist has them) at q (n,), and its gradient (n,)."""
    robot = problem.robot
    T = robot.fk_transform(q)
    e = np.concatenate(
        [
            problem.target.position - T[:3, 3],
            rotation_vector(problem.target.rotation @ T[:3, :3].T),
        ]
    )
    J = robot.jacobian(q)
    return float(e @ e), -2.0 * J.T @ e


class _Distances:
    """|y - c|^2 - l^2 of every sphere of the cover and every obstacle, with derivatives."""

    def __init__(self, problem: IKProblem) -> None:
        assert problem.cover is not None
        self._robot, self._cover = problem.robot, problem.cover
        self._centres = np.array([piece.pose.position for piece in problem.obstacles])
        radii = np.array([piece.size[0] for piece in problem.obstacles])
        self._least = radii + problem.cover.radius[:, None]

    def values(self, q: Array) -> Array:
        """(points * obstacles,)."""
        y = self._cover.centres_world(self._robot.link_transforms(q))
        squared = np.sum((y[:, None] - self._centres) ** 2, axis=-1)
        kept: Array = (squared - self._least**2).ravel()
        return kept

    def gradients(self, q: Array) -> Array:
        """(points * obstacles, n)."""
        T = self._robot.link_transforms(q)
        y = self._cover.centres_world(T)
        J = np.array(
            [
                self._robot.point_jacobian(T, int(link), point)[:3]
                for link, point in zip(self._cover.link, y, strict=True)
            ]
        )
        away = y[:, None] - self._centres
        rows: Array = 2.0 * np.einsum("moi,mij->moj", away, J).reshape(-1, len(q))
        return rows
