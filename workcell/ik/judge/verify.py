"""The judge: whether a configuration solves a problem. Knows no solver; only what passes here is `SOLVED`."""

from __future__ import annotations

import math
from dataclasses import dataclass, field

import numpy as np
from numpy.typing import ArrayLike

from workcell.ik.judge.exact import (
    exact_distances,
    exact_kinematics,
    rotation_angle,
    smallest_clearance,
    target_rotation,
)
from workcell.ik.problem import STEP_SLACK, Clearance, IKProblem
from workcell.model.robot import LIMIT_SLACK
from workcell.pose import Array

_NAN = float("nan")


@dataclass(frozen=True, slots=True)
class Verification:
    """What the judge found.

    Attributes:
        position_error: metres between the tool and its target; nan when `q` could not be judged.
        rotation_error: radians between them.
        clearance: smallest signed distance and the pair that has it; inf without obstacles.
        within_limits: joint limits, with `LIMIT_SLACK`.
        accepted: whether everything holds.
        reasons: why not, in words; empty when accepted.
    """

    position_error: float = _NAN
    rotation_error: float = _NAN
    clearance: Clearance = field(default_factory=lambda: Clearance(_NAN))
    within_limits: bool = False
    accepted: bool = False
    reasons: tuple[str, ...] = ()


class Verifier:
    """Judges any number of configurations for one problem; what depends on the problem alone is computed once."""

    def __init__(self, problem: IKProblem) -> None:
        self.problem = problem
        self._kinematics = exact_kinematics(problem.robot)
        self._target_rotation = target_rotation(problem)
        judged_here = problem.checker is None and problem.cover is not None and len(problem.cover) > 0
        self._distances = exact_distances(problem.obstacles) if judged_here and problem.obstacles else None

    def __call__(self, q: ArrayLike) -> Verification:
        """Judge one configuration (n,); anything that is not one is refused with the reason, not raised."""
        problem = self.problem
        try:
            values = np.asarray(q, dtype=float)
        except (TypeError, ValueError):
            return Verification(reasons=("the configuration is not a list of numbers",))
        if values.shape != (problem.robot.dof,):
            return Verification(reasons=(f"{_counted(values)}, the robot has {problem.robot.dof} joints",))
        if not np.isfinite(values).all():
            return Verification(reasons=("the configuration is not finite",))
        rotation, position = self._kinematics.links(values)
        tool_rotation, tool_position = self._kinematics.tool(rotation, position)
        away = math.dist(tool_position.tolist(), problem.target.position.tolist())
        turned = self._turned(tool_rotation)
        if problem.tool_pose is not None:
            seen = problem.tool_pose(values)
            away = max(away, math.dist(seen.position.tolist(), problem.target.position.tolist()))
            turned = max(turned, self._turned(seen.rotation))
        clearance = self._clearance(values, rotation, position)
        limit_reasons = self._limit_reasons(values)
        reasons = (
            *self._pose_reasons(away, turned),
            *self._clearance_reasons(clearance),
            *limit_reasons,
            *self._step_reasons(values, rotation),
        )
        return Verification(away, turned, clearance, not limit_reasons, not reasons, reasons)

    def _turned(self, tool_rotation: Array) -> float:
        """Radians between the tool's rotation and the target's, as far as the goal asks for it."""
        if self.problem.goal == "position":
            return 0.0
        if self.problem.goal == "axis":
            one, two = self._target_rotation[:, 2], tool_rotation[:, 2]
            return math.atan2(float(np.linalg.norm(np.cross(one, two))), float(one @ two))
        return rotation_angle(self._target_rotation @ tool_rotation.T)

    def _clearance(self, q: Array, rotation: Array, position: Array) -> Clearance:
        problem = self.problem
        if problem.checker is not None:
            found, ask = problem.checker(q), getattr(problem.checker, "second_opinion", None)
            other: Clearance | None = ask(q) if ask is not None and found.distance >= 0.0 else None
            return found if other is None else other
        clearance = Clearance(float("inf"))
        if self._distances is not None and problem.cover is not None:
            distance, sphere, piece = smallest_clearance(problem.cover, rotation, position, self._distances)
            clearance = Clearance(distance, (sphere_name(problem, sphere), problem.obstacles[piece].name))
        own = self._own_clearance(rotation, position)
        return own if own.distance < clearance.distance else clearance

    def _own_clearance(self, rotation: Array, position: Array) -> Clearance:
        """Smallest clearance among the pairs of spheres that must not touch."""
        cover, pairs = self.problem.cover, self.problem.self_collision
        if cover is None or pairs is None or not len(pairs):
            return Clearance(float("inf"))
        centres = np.einsum("mij,mj->mi", rotation[cover.link], cover.centre) + position[cover.link]
        one, two = pairs.T
        gaps = np.linalg.norm(centres[one] - centres[two], axis=1) - cover.radius[one] - cover.radius[two]
        k = int(np.argmin(gaps))
        return Clearance(
            float(gaps[k]), (sphere_name(self.problem, int(one[k])), sphere_name(self.problem, int(two[k])))
        )

    def _pose_reasons(self, away: float, turned: float) -> list[str]:
        allowed = self.problem.tolerances
        reasons = []
        if not away <= allowed.position:
            reasons.append(
                f"the tool is {1e3 * away:.3g} mm from its target (allowed {1e3 * allowed.position:g})"
            )
        if not turned <= allowed.rotation:
            reasons.append(f"the tool is turned by {turned:.3g} rad (allowed {allowed.rotation:g})")
        return reasons

    def _clearance_reasons(self, clearance: Clearance) -> list[str]:
        margin = self.problem.tolerances.safety_margin
        if clearance.distance >= margin:
            return []
        if np.isnan(clearance.distance):
            return ["the clearance is not a number"]
        if clearance.reason:
            return [clearance.reason]
        first, second = clearance.pair
        if clearance.distance < 0:
            return [f"{first} is {-1e3 * clearance.distance:.3g} mm inside {second}"]
        return [f"{first} is {1e3 * clearance.distance:.3g} mm from {second} (wanted {1e3 * margin:g})"]

    def _limit_reasons(self, q: Array) -> list[str]:
        robot = self.problem.robot
        outside = (q < robot.lower - LIMIT_SLACK) | (q > robot.upper + LIMIT_SLACK)
        if not outside.any():
            return []
        return [
            f"joint {robot.joint_names[k]} = {q[k]:.6g} is outside [{robot.lower[k]:.6g}, {robot.upper[k]:.6g}]"
            for k in np.flatnonzero(outside)
        ]

    def _step_reasons(self, q: Array, rotation: Array) -> list[str]:
        problem = self.problem
        if problem.q_reference is None:
            return []
        reasons = []
        if problem.max_step is not None:
            allowed = np.broadcast_to(problem.max_step, q.shape)
            moved = np.abs(q - problem.q_reference)
            reasons += [
                f"joint {problem.robot.joint_names[k]} moves by {moved[k]:.4g} (allowed {allowed[k]:.4g})"
                for k in np.flatnonzero(moved > allowed + STEP_SLACK)
            ]
        if problem.max_link_rotation is not None:
            before, _ = self._kinematics.links(problem.q_reference)
            change = np.linalg.norm(rotation - before, axis=(1, 2))
            reasons += [
                f"link {problem.robot.link_names[k]} turns by {change[k]:.4g} (allowed {problem.max_link_rotation:.4g})"
                for k in np.flatnonzero(change > problem.max_link_rotation + STEP_SLACK)
            ]
        return reasons


def verify(problem: IKProblem, q: ArrayLike) -> Verification:
    """Judge configuration `q` (n,) for `problem`, independently of every solver.

    Collisions are judged by `problem.checker` (the compiled model) where there is one, else by the exact kernel on
    the problem's spheres and obstacles. The pose is judged by the exact kernel, and by `problem.tool_pose` (the
    compiled model) too where there is one: the larger error counts.
    """
    return Verifier(problem)(q)


def sphere_name(problem: IKProblem, sphere: int) -> str:
    """A sphere of the robot's cover in words."""
    assert problem.cover is not None
    link = int(problem.cover.link[sphere])
    source = problem.cover.source[sphere] if problem.cover.source else ""
    carrier = source or problem.robot.link_names[link]
    return f"sphere {sphere} ({carrier})"


def _counted(values: Array) -> str:
    return f"{values.size} joint values" if values.ndim == 1 else f"an array of shape {values.shape}"
