"""Reach a goal pose along a tool path: directly from where the robot stands, or by way of other goal configurations.

A tool path that is followed from one given configuration may run into a joint limit half-way (continuity leaves no
second choice). Then the goal's inverse kinematics is solved again, with other seeds; each solution is followed backwards
out along the path, and the place where it comes out is connected to the start by a collision-free joint motion.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from workcell.ik.result import IKResult
from workcell.ik.solve import solve
from workcell.motion.follow import FollowLimits, FollowResult, Solver, follow, line, local_solver, step_solver
from workcell.motion.path import Path
from workcell.motion.plan import PlanSettings
from workcell.motion.world import PlanningWorld
from workcell.motion.worldplan import plan_in_world
from workcell.pose import Array, Pose


@dataclass(frozen=True, slots=True)
class ReachResult:
    """What became of it.

    Attributes:
        path: from the start to the last pose, proved clear between waypoints; None when none was found.
        how: in words, for a log.
        ik: the goal's last answer by the solver; None when it was not asked.
        failures: why each way failed, in words.
    """

    path: Path | None
    how: str
    ik: IKResult | None
    failures: tuple[str, ...]


def reach(
    world: PlanningWorld,
    q_start: Array,
    inward: Sequence[Pose],
    *,
    limits: FollowLimits,
    solver: str = "ikspark",
    seed: int = 0,
    tries: int = 6,
) -> ReachResult:
    """A continuous path from `q_start` through the tool poses `inward`, of which the last is the goal.

    Args:
        world: what the planner knows of the scene.
        q_start: (n,) where the robot stands.
        inward: two or more tool poses, from the mouth of the narrow way to the goal.
        limits: what the motion keeps.
        solver: of every IK problem.
        seed: same seed, same path.
        tries: goal configurations to try when the direct way fails.
    """
    robot = world.robot.robot
    direct = [*line(robot.fk(q_start), inward[0]), *inward[1:]]
    followed = follow(
        world.problem(direct[0]),
        direct,
        q_start,
        limits=limits,
        solver=_steps(world, direct[0], limits, solver, seed),
    )
    if followed.path is not None and followed.followed:
        return ReachResult(followed.path, "followed from the start", None, ())
    failures = [f"from the start: {_words(followed)}"]
    answers = []
    for k in range(tries):
        answers.append(solve(world.problem(inward[-1]), solver=solver, seed=seed + k))
        if answers[-1].status.is_proof:
            failures.append(answers[-1].status.sentence)
            break
        if not answers[-1].solved:
            failures.append(f"goal configuration {k}: {answers[-1].status.sentence}")
    solved = [ik for ik in answers if ik.solved]
    # the nearest first: a transfer with half a turn less is shorter, and gentler to what is in the hand
    for k, ik in enumerate(sorted(solved, key=lambda ik: float(np.abs(ik.unwrap() - q_start).max()))):
        path, why = _by_way_of(world, q_start, inward, ik.unwrap(), limits, solver, seed + k)
        if path is not None:
            return ReachResult(path, f"by way of goal configuration {k}", ik, tuple(failures))
        failures.append(f"goal configuration {k}: {why}")
    return ReachResult(None, "not found", answers[-1] if answers else None, tuple(failures))


def _by_way_of(
    world: PlanningWorld,
    q_start: Array,
    inward: Sequence[Pose],
    q_goal: Array,
    limits: FollowLimits,
    solver: str,
    seed: int,
) -> tuple[Path | None, str]:
    """Out of the narrow way backwards from one goal configuration, then to the start in joint space."""
    outward = tuple(reversed(inward))
    back = follow(
        world.problem(outward[0]),
        outward,
        q_goal,
        limits=limits,
        solver=_steps(world, outward[0], limits, solver, seed),
    )
    if back.path is None or not back.followed:
        return None, _words(back)
    settings = PlanSettings(clearance=limits.clearance)
    way = plan_in_world(world, q_start, back.path.end, settings=settings, seed=seed)
    if way.path is None:
        return None, way.detail
    return way.path + back.path.reversed(), ""


def _steps(world: PlanningWorld, first: Pose, limits: FollowLimits, solver: str, seed: int) -> Solver:
    """Fast local steps, the solver behind them."""
    return local_solver(world.problem(first), limits=limits, rescue=step_solver(solver, seed=seed), seed=seed)


def _words(result: FollowResult) -> str:
    detail = "" if result.failure is None else f" (pose {result.failure.waypoint}: {result.failure.detail})"
    return f"{result.status.sentence}{detail}"
