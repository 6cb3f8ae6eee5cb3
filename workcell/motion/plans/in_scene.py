"""Paths in a scene: searched for among spheres, compiled, and proved on the MuJoCo model, which alone decides.

First the model itself is asked for the straight line to the nearest goal. Then the spheres: they contain the robot with
some overshoot, which may close a gap that the robot fits through, so that they are tried without it as well, where a
path is a guess until it is proved. Where both fail the compiled model itself is searched.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import replace
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import ArrayLike

from workcell import clock
from workcell.errors import InputError
from workcell.model.robot import Robot
from workcell.motion.body import BodyClearance, Upright, pack_body
from workcell.motion.path import Path
from workcell.motion.plans.by_checker import connect, plan
from workcell.motion.plans.compiled import Effort, Found, search
from workcell.motion.plans.ends import checked_end
from workcell.motion.plans.optimise import optimise, path_length
from workcell.motion.plans.result import Optimised, PlanResult, PlanSettings, PlanStatus
from workcell.motion.proofs.on_model import prove_path
from workcell.pose import Array
from workcell.world.planning_world import PlanningWorld

if TYPE_CHECKING:
    from workcell.motion.kernels.body import Body

_TURNS = 9
"""Configurations of a goal, whole turns apart, that are planned to, at most."""


def plan_in_world(
    world: PlanningWorld,
    q_start: ArrayLike,
    q_goals: ArrayLike,
    *,
    settings: PlanSettings | None = None,
    upright: Upright | None = None,
    seed: int = 0,
    turns: bool = True,
) -> PlanResult:
    """A path from `q_start` (n,) to any of `q_goals` (k, n) or (n,), proved clear; same seed, same path.

    What the hand holds moves with it; the robot's own links keep clear of each other too.

    Args:
        world: what is known of the scene.
        settings: clearance to keep, iterations, attempts; with `optimise_s` the path gets shorter and shorter.
        upright: keep an axis of the tool within a cone all along.
        turns: whether the path may end at whole turns of joints from a goal, where every link is as it is there: at
            those nearest to the start, and where no way to them is found at others; else at the goal itself.

    Raises:
        InputError: the start, or every goal, is outside the joint limits, in collision (which pair, how deep, and the
            nearest free configuration that was found) or tilted too far.
    """
    settings = settings or PlanSettings()
    start, _ = checked_end(world.robot.robot, q_start, world.clearance, "q_start", upright=upright)
    goals = _clear_goals(world, np.atleast_2d(np.asarray(q_goals, dtype=float)), upright)
    nearest, others = _in_turns(world.robot.robot, goals, start) if turns else (goals, goals[:0])
    query = _WorldQuery(world, start, nearest, settings, upright, seed)
    found = query.straight() or query.searched()
    if len(others) and (found is None or not found.planned):
        about = _WorldQuery(world, start, others, settings, upright, seed)
        further = about.straight() or about.searched()
        found = further if further is not None and further.planned else found
    return found or query.slow()


def _in_turns(robot: Robot, goals: Array, start: Array) -> tuple[Array, Array]:
    """Goals (k, n) in whole turns nearest to the start, and in the turns that are next nearest (l, n)."""
    each = [robot.turns(goal, start, _TURNS) for goal in goals]
    others = np.concatenate([rows[1:] for rows in each])
    away = np.linalg.norm(others - start, axis=1)
    return np.stack([rows[0] for rows in each]), others[np.argsort(away, kind="stable")]


class _WorldQuery:
    """One query: its attempts from the quickest to the slowest, and what they have cost so far."""

    def __init__(
        self,
        world: PlanningWorld,
        start: Array,
        goals: Array,
        settings: PlanSettings,
        upright: Upright | None,
        seed: int,
    ) -> None:
        self.world, self.robot, self.start, self.goals = world, world.robot.robot, start, goals
        self.settings, self.upright, self.seed = settings, upright, seed
        self.optimises = settings.optimise_s > 0 and settings.optimise_iterations > 0
        order = 2 if self.optimises else np.inf
        self.nearest = goals[int(np.argmin(np.linalg.norm(goals - start, order, axis=1)))]
        self.least = float(np.linalg.norm(goals - start, axis=1).min())
        self.iterations, self.evaluations = 0, 0
        self.detail = "start or goals are not clear of obstacles in the model of spheres"

    def straight(self) -> PlanResult | None:
        """The line to the nearest goal, if the compiled model proves it. It leaves nothing to optimise."""
        if self.upright is not None:
            return None
        clearance, cover = self.world.clearance, self.world.cover
        found = connect(
            self.robot, self.start, self.nearest, clearance, cover, clearance=self.settings.clearance
        )
        self.evaluations += found.evaluations
        if not found.planned:
            return None
        if not self.optimises:
            return found
        return replace(found, optimised=Optimised(self.least, self.least, self.least, 0, 0.0))

    def searched(self) -> PlanResult | None:
        """A path among the spheres that the compiled model proves."""
        models = list(_models(self.world, self.start, self.goals, self.settings, self.upright))
        for share in sorted({1, self.settings.attempts}):
            for body, reachable in models:
                effort = Effort(
                    iterations=share * self.settings.iterations,
                    step=0.5 if self.upright else 1.0,
                    optimise_s=self.settings.optimise_s,
                    optimise_iterations=self.settings.optimise_iterations,
                )
                found = search(body, self.start, reachable, effort, self.seed + share - 1)
                self.iterations, self.evaluations = (
                    self.iterations + found.iterations,
                    self.evaluations + found.looks,
                )
                if found.path is None:
                    self.detail = f"the trees did not meet within {found.iterations} samples"
                    continue
                proved = self.proved(found.path)
                if proved is not None:
                    return (
                        self.optimised(proved, body, reachable, found, effort) if self.optimises else proved
                    )
        if self.upright is None:
            return None
        return PlanResult(PlanStatus.NOT_FOUND, None, None, self.detail, self.iterations, self.evaluations)

    def proved(self, corners: Array) -> PlanResult | None:
        """A path, if the compiled model proves it."""
        path = Path(self.robot, corners)
        proof = prove_path(path, self.world.clearance, self.world.cover, floor=self.settings.clearance)
        self.evaluations += proof.evaluations
        if not proof.proved:
            self.detail = proof.reason
            return None
        return PlanResult(PlanStatus.PLANNED, path, proof, "", self.iterations, self.evaluations)

    def optimised(
        self, first: PlanResult, body: Body, goals: Array, found: Found, effort: Effort
    ) -> PlanResult:
        """The shortest path among the spheres that the compiled model proves too; the first one, if no other."""
        assert found.path is not None
        began = clock.cpu_seconds()
        shorter = optimise(body, self.start, goals, found.path, found.goal, effort, self.seed)
        self.evaluations += shorter.looks
        best, corners = first, found.path
        for points in shorter.paths[:0:-1]:
            proved = self.proved(points)
            if proved is not None:
                best, corners = proved, points
                break
        spent = Optimised(
            path_length(found.path),
            path_length(corners),
            self.least,
            shorter.iterations,
            clock.cpu_seconds() - began,
        )
        return replace(best, evaluations=self.evaluations, optimised=spent)

    def slow(self) -> PlanResult:
        """The compiled model itself is searched, one configuration at a time."""
        clearance, cover = self.world.clearance, self.world.cover
        found = plan(
            self.robot, self.start, self.nearest, clearance, cover, settings=self.settings, seed=self.seed
        )
        return replace(
            found,
            iterations=found.iterations + self.iterations,
            evaluations=found.evaluations + self.evaluations,
        )


def _clear_goals(world: PlanningWorld, goals: Array, upright: Upright | None) -> Array:
    """The goals that may be one; raises for the first where none may."""
    if len(goals) == 0:
        raise InputError("there is no goal", where="q_goals", remedy="one configuration or more")
    kept, first = [], None
    for k, goal in enumerate(goals):
        try:
            kept.append(
                checked_end(world.robot.robot, goal, world.clearance, f"q_goals[{k}]", upright=upright)[0]
            )
        except InputError as error:
            first = first or error
    if not kept and first is not None:
        raise first
    return np.stack(kept)


def _models(
    world: PlanningWorld, start: Array, goals: Array, settings: PlanSettings, upright: Upright | None
) -> Iterator[tuple[Body, Array]]:
    """The robot as the kernels see it, by its cover and by that without its overshoot, and the goals clear there."""
    robot, cover = world.robot.robot, world.cover
    choices, bare = [(cover, settings.clearance)], cover.without_overshoot()
    if bare is not cover:
        choices.append((bare, settings.clearance + settings.spare))
    for spheres, keep in choices:
        pairs = world.self_pairs(spheres, np.stack([start, *goals]))
        body = pack_body(robot, spheres, world.obstacles, self_pairs=pairs, upright=upright)
        clearance = BodyClearance(body, spheres, world.obstacles)
        gap, gaps = float(clearance.many(start[None])[0]), clearance.many(goals)
        reachable = goals[gaps > 0]
        if gap > 0 and len(reachable):
            floor = min(keep, 0.5 * gap, 0.5 * float(gaps[gaps > 0].min()))
            yield body._replace(floor=floor), reachable
