"""The clear pose nearest to a target that the robot does reach: what can be offered where a query ends in "no"."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field, replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from workcell import clock
from workcell.geometry.engine import ClearanceEngine
from workcell.geometry.self_collision import self_collision_pairs
from workcell.geometry.types import SphereCover
from workcell.ik.explain.nearness import Nearness, nearness
from workcell.ik.judge.verify import Verifier
from workcell.ik.problem import Budget, Clearance, Goal, IKProblem
from workcell.ik.shared.limits import Interval
from workcell.pose import Array, Pose, read_only, rotation_vector

RADIANS_A_METRE = 10.0
"""How a turn compares with a shift: 0.1 rad off are as bad as 1 cm off."""
_STARTS_A_SECOND = 4
"""Starts descended from in a second, on one quiet core."""
_DRAWN, _STARTS, _ITERATIONS = 4000, 24, 80
_COLLIDES = 1e3
"""What a collision adds to the cost of a start: those come last."""
_FAR = 0.3
"""Metres beyond which a distance does not matter."""
_HAIR = 1e-6
"""Metres kept beyond the wanted clearance, against the rounding of the optimiser."""


@dataclass(frozen=True, slots=True)
class ClosestPose:
    """A verified configuration whose tool is near a target.

    Attributes:
        q: (n,) within limits and clear of obstacles by the problem's own judge.
        pose: `T_world_tool` there.
        position_error: metres from the target.
        rotation_error: radians from it.
        clearance: smallest signed distance there.
        bound: what no configuration is nearer than, proved with obstacles aside; zero where nothing is.
        proved: the bound in words; empty: nothing worth telling.
    """

    q: Array
    pose: Pose
    position_error: float
    rotation_error: float
    clearance: Clearance
    bound: Nearness = field(default_factory=Nearness)
    proved: str = ""

    def __post_init__(self) -> None:
        object.__setattr__(self, "q", read_only(self.q))

    @property
    def sentence(self) -> str:
        """In words."""
        found = (
            f"the closest pose found is {1e3 * self.position_error:.1f} mm and "
            f"{np.degrees(self.rotation_error):.1f} degrees away"
        )
        return f"{found}; {self.proved}" if self.proved else found


def closest_pose(
    problem: IKProblem, budget: Budget | None = None, seed: int = 0, near: Sequence[Array] = ()
) -> ClosestPose | None:
    """The best of several local searches for the clear pose nearest to the target (`RADIANS_A_METRE` weighs).

    Minimises the squared pose error, at once and after that of the position, under limits and the cover's clearances
    (SLSQP), from configurations `near` (n,), from `q_reference` and from random ones. What the judge refuses is left
    out. There may be a nearer one; its `bound` says how near any can be.

    Args:
        budget: its effort (default: 1) says how many starts are descended from; its seconds end the search.

    Returns:
        None when no start led, in the budget, to a configuration that the judge accepts but for its pose.
    """
    budget = budget or Budget(60.0, effort=1.0)
    deadline = clock.cpu_seconds() + budget.cpu_s
    search = _Search(problem)
    starts = list(search.starts(np.random.default_rng(seed)))
    if problem.q_reference is not None:
        starts.insert(0, problem.q_reference)
    starts = [*near, *starts][: int(min(budget.work(_STARTS_A_SECOND), len(starts) + len(near)))]
    best: tuple[float, ClosestPose] | None = None
    for start in starts:
        if clock.cpu_seconds() > deadline:
            break
        for q in search.descents(start):
            found = search.judged(q)
            if found is not None:
                cost = _cost(found.position_error, found.rotation_error)
                best = (cost, found) if best is None or cost < best[0] else best
    if best is None:
        return None
    bound = nearness(problem)
    return replace(best[1], bound=bound, proved=bound.words(problem.tolerances))


def _cost(position_error: float, rotation_error: float) -> float:
    return position_error**2 + (rotation_error / RADIANS_A_METRE) ** 2


class _Search:
    def __init__(self, problem: IKProblem) -> None:
        self.problem = problem
        interval = Interval.of(problem)
        self.lower, self.upper = interval.lower, interval.upper
        cover = problem.cover
        self._engine: ClearanceEngine | None = None
        if cover is not None and (cover.link > 0).any():
            pairs = _pairs(problem, cover)
            self._engine = ClearanceEngine(problem.robot, cover, problem.obstacles, pairs)
            self._moving = np.flatnonzero(cover.link > 0)
            links = np.zeros((0, 2)) if pairs is None else cover.link[pairs]
            _, which = np.unique(links, axis=0, return_inverse=True)
            self._link_pairs = [np.flatnonzero(which == k) for k in range(which.max(initial=-1) + 1)]
        # any pose will do, as long as limits and clearance are kept
        self._judge = Verifier(replace(problem, inner=None))

    def starts(self, rng: np.random.Generator) -> Array:
        """Configurations (s, n) to begin at: of many random ones those that are clear, nearest to the target first."""
        robot, target = self.problem.robot, self.problem.target
        drawn = np.clip(robot.random_configuration(rng, _DRAWN), self.lower, self.upper)
        T = robot.fk_transform(drawn)
        shift = np.linalg.norm(T[:, :3, 3] - target.position, axis=1)
        turn = np.linalg.norm(rotation_vector(T[:, :3, :3] @ target.rotation.T), axis=1)
        cost = shift**2 + (turn / RADIANS_A_METRE) ** 2
        if self._engine is not None:
            cost += _COLLIDES * (self._engine.clearances(drawn) < self.problem.tolerances.safety_margin)
        return drawn[np.argsort(cost, kind="stable")[:_STARTS]]

    def descents(self, start: Array) -> tuple[Array, Array]:
        """Where the pose error is smallest near a start, and near where the position's error is."""
        goal = self.problem.goal
        there = self._descend(start, "position")
        return self._descend(start, goal), self._descend(there, goal)

    def _descend(self, start: Array, goal: Goal) -> Array:
        """Where the error of a goal is smallest near a start, within limits and clear of obstacles in the model."""
        from scipy.optimize import minimize

        constraints: Any = []
        if self._engine is not None:
            constraints.append({"type": "ineq", "fun": self._room, "jac": self._slope})
        found = minimize(
            self._error,
            np.clip(start, self.lower, self.upper),
            (goal,),
            jac=True,
            method="SLSQP",
            bounds=list(zip(self.lower, self.upper, strict=True)),
            constraints=constraints,
            options={"maxiter": _ITERATIONS, "ftol": 1e-10},
        )
        q: Array = np.clip(found.x, self.lower, self.upper)
        return q

    def judged(self, q: Array) -> ClosestPose | None:
        """The configuration, if the judge has nothing against it but its pose."""
        if not np.all(np.isfinite(q)):
            return None
        verdict = self._judge(q)
        if (
            not verdict.within_limits
            or not verdict.clearance.distance >= self.problem.tolerances.safety_margin
        ):
            return None
        pose = self.problem.robot.fk(q)
        return ClosestPose(q, pose, verdict.position_error, verdict.rotation_error, verdict.clearance)

    def _error(self, q: Array, goal: Goal) -> Any:
        """The squared pose error and its gradient (n,)."""
        robot, target = self.problem.robot, self.problem.target
        pose, J = robot.fk(q), robot.jacobian(q)
        shift = pose.position - target.position
        turn = _turn(self.problem.target, pose, goal) / RADIANS_A_METRE
        gradient: Array = 2 * (shift @ J[:3] + turn @ J[3:] / RADIANS_A_METRE)
        return float(shift @ shift + turn @ turn), gradient

    def _room(self, q: Array) -> Array:
        return self._gaps(q)[0] - self.problem.tolerances.safety_margin - _HAIR

    def _slope(self, q: Array) -> Array:
        return self._gaps(q)[1]

    def _gaps(self, q: Array) -> tuple[Array, Array]:
        """Smallest distances and their slopes: of each moving sphere to obstacles, of each pair of links to each other.

        What is far away is constant.
        """
        assert self._engine is not None
        gap, slope, _ = self._engine.sphere_clearances_and_gradients(q)
        own, own_slope = self._engine.self_clearances_and_gradients(q)
        nearest = [int(rows[np.argmin(own[rows])]) for rows in self._link_pairs]
        gaps = np.concatenate([gap[self._moving], own[nearest]])
        slopes = np.vstack([slope[self._moving], own_slope[nearest]])
        return np.minimum(gaps, _FAR), np.where((gaps < _FAR)[:, None], slopes, 0.0)


def _turn(target: Pose, pose: Pose, goal: Goal) -> Array:
    """Axis times angle (3,) from the target's rotation to the tool's, as far as the goal asks for it."""
    if goal == "position":
        return np.zeros(3)
    if goal == "pose":
        return rotation_vector(pose.rotation @ target.rotation.T)
    wanted, is_now = target.rotation[:, 2], pose.rotation[:, 2]
    across = np.cross(wanted, is_now)
    sine = float(np.linalg.norm(across))
    angle: Array = np.arctan2(sine, float(wanted @ is_now)) * across / max(sine, 1e-12)
    return angle


def _pairs(problem: IKProblem, cover: SphereCover) -> NDArray[np.int64] | None:
    """The pairs of spheres that must not touch: the problem's, or where a model judges those of different links."""
    if problem.self_collision is not None or problem.checker is None:
        return problem.self_collision
    pairs: NDArray[np.int64] = self_collision_pairs(problem.robot, cover).pairs
    return pairs
