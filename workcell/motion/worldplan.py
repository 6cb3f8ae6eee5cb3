"""Paths in a scene: searched for among spheres, compiled, and proved on the compiled MuJoCo model, which alone decides.

First the model itself is asked for the straight line to the nearest goal. Then the spheres: they contain the robot with
some overshoot, which may close a gap that the robot fits through, so that they are tried without it as well, where a path
is a guess until it is proved. Where both fail the compiled model itself is searched.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import replace
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import ArrayLike

from workcell.errors import InputError
from workcell.geometry.self_collision import self_collision_pairs
from workcell.motion.body import BodyClearance, Upright, pack_body
from workcell.motion.ends import checked_end
from workcell.motion.path import Path
from workcell.motion.plan import PlanResult, PlanSettings, PlanStatus, connect, plan
from workcell.motion.proof import prove_path
from workcell.motion.search import Effort, search
from workcell.motion.world import PlanningWorld
from workcell.pose import Array

if TYPE_CHECKING:
    from workcell.motion.kernels.body import Body

_SAMPLES = 200
"""Configurations that tell which pairs of the cover's spheres always touch."""
_SMALLEST = 1e-5
"""Metres: radius that a sphere keeps when its overshoot is taken away."""


def plan_in_world(
    world: PlanningWorld,
    q_start: ArrayLike,
    q_goals: ArrayLike,
    *,
    settings: PlanSettings | None = None,
    upright: Upright | None = None,
    seed: int = 0,
) -> PlanResult:
    """A path from `q_start` (n,) to any of `q_goals` (k, n) or (n,), proved clear; the same seed gives the same path.

    What the hand holds moves with it; the robot's own links keep clear of each other too.

    Args:
        world: what is known of the scene.
        settings: clearance to keep, iterations, attempts.
        upright: keep an axis of the tool within a cone all along.

    Raises:
        InputError: the start, or every goal, is outside the joint limits, in collision (which pair, how deep, and the
            nearest free configuration that was found) or tilted too far.
    """
    settings = settings or PlanSettings()
    robot = world.robot.robot
    start, _ = checked_end(robot, q_start, world.clearance, "q_start", upright=upright)
    goals = _clear_goals(world, np.atleast_2d(np.asarray(q_goals, dtype=float)), upright)
    nearest = goals[int(np.argmin(np.abs(goals - start).max(axis=1)))]
    iterations, evaluations = 0, 0
    if upright is None:
        straight = connect(robot, start, nearest, world.clearance, world.cover, clearance=settings.clearance)
        if straight.planned:
            return straight
        evaluations = straight.evaluations
    detail = "start or goals are not clear of obstacles in the model of spheres"
    models = list(_models(world, start, goals, settings, upright))
    for share in sorted({1, settings.attempts}):
        for body, reachable in models:
            effort = Effort(iterations=share * settings.iterations, step=0.5 if upright else 1.0)
            found = search(body, start, reachable, effort, seed + share - 1)
            iterations, evaluations = iterations + found.iterations, evaluations + found.looks
            if found.path is None:
                detail = f"the trees did not meet within {found.iterations} samples"
                continue
            path = Path(robot, found.path)
            proof = prove_path(path, world.clearance, world.cover, floor=settings.clearance)
            evaluations += proof.evaluations
            if proof.proved:
                return PlanResult(PlanStatus.PLANNED, path, proof, "", iterations, evaluations)
            detail = proof.reason
    if upright is not None:
        return PlanResult(PlanStatus.NOT_FOUND, None, None, detail, iterations, evaluations)
    slow = plan(robot, start, nearest, world.clearance, world.cover, settings=settings, seed=seed)
    return replace(slow, iterations=slow.iterations + iterations, evaluations=slow.evaluations + evaluations)


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
    """The robot as the kernels see it, by its cover and by the cover without its overshoot, and the goals clear there."""
    robot, cover = world.robot.robot, world.cover
    assert cover.overshoot is not None  # always set by SphereCover
    choices = [(cover, settings.clearance)]
    if np.any(cover.overshoot > 0):
        radius = np.maximum(cover.radius - cover.overshoot, _SMALLEST)
        slim = replace(cover, radius=radius, overshoot=np.zeros(len(radius)), kind="given")
        choices.append((slim, settings.clearance + settings.spare))
    for spheres, keep in choices:
        pairs = self_collision_pairs(
            robot,
            spheres,
            links=world.collision.self_links,
            known_free=np.stack([start, *goals]),
            samples=_SAMPLES,
            prove=False,
        ).pairs
        body = pack_body(robot, spheres, world.obstacles, self_pairs=pairs, upright=upright)
        clearance = BodyClearance(body, spheres, world.obstacles)
        gap, gaps = float(clearance.many(start[None])[0]), clearance.many(goals)
        reachable = goals[gaps > 0]
        if gap > 0 and len(reachable):
            floor = min(keep, 0.5 * gap, 0.5 * float(gaps[gaps > 0].min()))
            yield body._replace(floor=floor), reachable
