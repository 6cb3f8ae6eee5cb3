"""Reach a goal pose along a tool path: directly from where the robot stands, or by other goal configurations.

A tool path that is followed from one given configuration may run into a joint limit half-way (continuity leaves no
second choice). Then the goal's inverse kinematics is solved again, with other seeds; each solution is followed
backwards out along the path: by a convex planner all the way to where the robot stands, if the motion comes out in that
very configuration; else the place where it leaves the path is connected to the start by a collision-free joint motion.
Where several tool paths would do, such as one for each grasp that an object allows, one that needs no such
detour comes first. Where a goal configuration is known already, the path ends in it.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field, replace

import numpy as np

from workcell.errors import InputError
from workcell.ik.problem import POSE_BUDGET, Budget
from workcell.ik.registry import plans_alone
from workcell.ik.result import IKResult
from workcell.ik.solve import solve
from workcell.motion.body import Upright
from workcell.motion.path import Path
from workcell.motion.plans.in_scene import plan_in_world
from workcell.motion.plans.result import PlanSettings
from workcell.motion.tool_paths.follow import FollowLimits, follow, line
from workcell.motion.tool_paths.homing import follow_to
from workcell.motion.tool_paths.planners import steps_of
from workcell.motion.tool_paths.result import Answered, FollowResult
from workcell.pose import Array, Pose
from workcell.world.planning_world import PlanningWorld

_DIRECT_BUDGET, _DIRECT_HALVINGS = Budget(60.0, effort=0.25), 3
"""What the solver behind a step of the direct way may spend, and how often the distance between its poses is halved."""
_TURNS = 3
"""Configurations of one goal, whole turns apart, that are tried; the nearest first."""
_LOOKS = 4
"""Configurations between two waypoints at which the tool's tilt is looked at."""


@dataclass(frozen=True, slots=True)
class ReachResult:
    """What became of it.

    Attributes:
        path: from the start to the last pose, proved clear between waypoints; None when none was found.
        how: in words, for a log.
        ik: the solver's answer about a goal: of a path's own; without a path the most hopeful one, so that it is a
            proof only where every goal is proved out of reach; None when it was not asked.
        failures: why each way failed, in words.
        followed: the part of the path that was followed step by step, in the direction in which that was done; the rest
            is a joint motion. None without a path.
        answered: who answered its configurations, a goal configuration of the path's own among them.
    """

    path: Path | None
    how: str
    ik: IKResult | None
    failures: tuple[str, ...]
    followed: FollowResult | None = None
    answered: Answered = field(default_factory=Answered)


def reach(
    world: PlanningWorld,
    q_start: Array,
    ways: Sequence[Sequence[Pose]],
    *,
    limits: FollowLimits,
    goal: Array | None = None,
    upright: Upright | None = None,
    solver: str = "ikspark",
    seed: int = 0,
    tries: int = 6,
) -> ReachResult:
    """A continuous path from `q_start` along one of several lists of tool poses, of which the last is the goal.

    From a given goal configuration outwards; else the first that can be followed directly from the start, else the
    first to which a goal configuration leads.

    Args:
        world: what the planner knows of the scene.
        q_start: (n,) where the robot stands.
        ways: one or more lists of two or more tool poses, from the mouth of the narrow way to the goal.
        limits: what the motion keeps.
        goal: (n,) a configuration with the tool at the last pose of the first list, in which the path is to end; others
            are looked for only where no way leads there. None: any.
        upright: keep an axis of the tool within a cone all along, joint motions included; None: it may turn as it
            likes.
        solver: of every IK problem: see `workcell.motion.tool_paths.planners.steps_of` for those of the steps.
        seed: same seed, same path.
        tries: goal configurations of one way to try when the direct ways fail.

    Raises:
        InputError: no way; a goal configuration that has the tool elsewhere; a start that is tilted beyond `upright`.
    """
    if not ways:
        raise InputError(
            "there is no way to choose from", where="ways", remedy="one list of tool poses or more"
        )
    worlds = [world.fitting(inward) if plans_alone(solver) else world for inward in ways]
    queries = [
        _Query(one, tuple(inward), limits, upright, solver, seed)
        for one, inward in zip(worlds, ways, strict=True)
    ]
    failures: list[str] = []
    if goal is not None:
        found = queries[0].ending_in(goal, q_start)
        if found.path is not None:
            return found
        failures += found.failures
    for query in queries if goal is None else ():
        found = query.directly(q_start)
        if found.path is not None:
            return replace(found, failures=tuple(failures))
        failures += found.failures
    answers: list[IKResult] = []
    for query in queries:
        found = query.by_goal_configurations(q_start, tries)
        failures += found.failures
        answers += [] if found.ik is None else [found.ik]
        if found.path is not None:
            return replace(found, failures=tuple(failures))
    return ReachResult(None, "not found", _most_hopeful(answers), tuple(failures))


def _most_hopeful(answers: Sequence[IKResult]) -> IKResult | None:
    """A solution, if there is one among the answers, else one that proves nothing, else a proof."""
    return min(answers, key=lambda ik: 0 if ik.solved else 2 if ik.status.is_impossible else 1, default=None)


@dataclass(frozen=True, slots=True)
class _Query:
    """One list of tool poses: see `reach`."""

    world: PlanningWorld
    inward: tuple[Pose, ...]
    limits: FollowLimits
    upright: Upright | None
    solver: str
    seed: int

    def directly(self, q_start: Array) -> ReachResult:
        """Straight to the mouth of the narrow way and in, within the configurations that begin at the start."""
        poses = (*line(self.world.robot.robot.fk(q_start), self.inward[0]), *self.inward[1:])
        # this way may well end at a joint limit, and there are others: not worth a long search at every step
        limits = replace(self.limits, max_halvings=min(self.limits.max_halvings, _DIRECT_HALVINGS))
        result, why = self._followed(poses, q_start, limits, _DIRECT_BUDGET)
        if why:
            return ReachResult(None, "not found", None, (f"from the start: {why}",))
        return ReachResult(result.path, "followed from the start", None, (), result, result.answered)

    def ending_in(self, q_goal: Array, q_start: Array) -> ReachResult:
        """By way of a goal configuration that is known already."""
        return self._by_way_of(q_goal, q_start, self.seed, "the goal configuration")

    def by_goal_configurations(self, q_start: Array, tries: int) -> ReachResult:
        """By way of the goal configuration nearest to the start that leads out of the narrow way."""
        robot, answers, failures = self.world.robot.robot, list[IKResult](), list[str]()
        for k in range(tries):
            problem = self.world.problem(self.inward[-1])
            answers.append(solve(problem, self.solver, POSE_BUDGET, self.seed + k))
            if answers[-1].status.is_proof:
                failures.append(answers[-1].status.sentence)
                break
            if not answers[-1].solved:
                failures.append(f"goal configuration {k}: {answers[-1].status.sentence}")
        solved = [ik for ik in answers if ik.solved]
        goals = [(q, ik) for ik in solved for q in robot.turns(ik.unwrap(), q_start, _TURNS)]
        # a transfer with half a turn less is shorter, and gentler to what is in the hand
        goals.sort(key=lambda goal: float(np.abs(goal[0] - q_start).max()))
        for k, (q_goal, ik) in enumerate(goals):
            found = self._by_way_of(q_goal, q_start, self.seed + k, f"goal configuration {k}")
            if found.path is not None:
                answered = found.answered + Answered.of([ik])
                return replace(found, ik=ik, failures=tuple(failures), answered=answered)
            failures += found.failures
        return ReachResult(None, "not found", _most_hopeful(answers), tuple(failures))

    def _by_way_of(self, q_goal: Array, q_start: Array, seed: int, goal: str) -> ReachResult:
        """From one goal configuration backwards: all the way to the start, or out and then on in joint space."""
        if plans_alone(self.solver):
            home = self._all_the_way_back(q_goal, q_start)
            if home.path is not None and home.followed:
                how = f"from {goal} back to the start"
                return ReachResult(home.path.reversed(), how, None, (), home, home.answered)
        back, why = self._followed(self.inward[::-1], q_goal, self.limits)
        if why or back.path is None:
            return ReachResult(None, "not found", None, (f"{goal}: {why}",))
        settings = PlanSettings(clearance=self.limits.clearance)
        way = plan_in_world(
            self.world,
            q_start,
            back.path.end,
            settings=settings,
            upright=self.upright,
            seed=seed,
            turns=False,
        )
        if way.path is None:
            return ReachResult(None, "not found", None, (f"{goal}: {way.detail}",))
        path = way.path + back.path.reversed()
        how = f"by way of {goal}, before it a joint motion by the sampling planner"
        return ReachResult(path, how, None, (), back, back.answered)

    def _all_the_way_back(self, q_goal: Array, q_start: Array) -> FollowResult:
        """A convex planner's steps from a goal configuration out of the narrow way, and straight to the start."""
        out = line(self.inward[0], self.world.robot.robot.fk(q_start))
        poses = (*self.inward[::-1], *out[1:])
        limits = replace(self.limits, max_halvings=min(self.limits.max_halvings, _DIRECT_HALVINGS))
        problem = self.world.problem(poses[0])
        steps = steps_of(self.solver, problem, limits=limits, budget=_DIRECT_BUDGET, seed=self.seed)
        result = follow_to(problem, poses, q_goal, q_start, limits, steps)
        if result.path is None or self._tilts(result.path):
            return replace(result, path=None)
        return result

    def _tilts(self, path: Path) -> str:
        """Why a path tilts the tool too far; empty: it doesn't."""
        tilt = 0.0 if self.upright is None else self._tilt(path, self.upright)
        if self.upright is None or tilt <= self.upright.angle:
            return ""
        return f"the tool would tilt by {tilt:.3f} rad, and may by {self.upright.angle:.3f}"

    def _followed(
        self, poses: tuple[Pose, ...], q_start: Array, limits: FollowLimits, budget: Budget | None = None
    ) -> tuple[FollowResult, str]:
        """The planner's steps along tool poses, and why they are no way; empty: they are one."""
        problem = self.world.problem(poses[0])
        steps = steps_of(self.solver, problem, limits=limits, budget=budget, seed=self.seed)
        result = follow(problem, poses, q_start, limits=limits, solver=steps)
        if result.path is None or not result.followed:
            where = "" if result.failure is None else f" ({result.failure.words})"
            return result, f"{result.status.sentence}{where}"
        return result, self._tilts(result.path)

    def _tilt(self, path: Path, upright: Upright) -> float:
        """The largest tilt of the tool along a path whose waypoints are close."""
        looks = np.linspace(0.0, len(path) - 1, _LOOKS * (len(path) - 1) + 1)
        return max(upright.tilt(self.world.robot.robot, q) for q in path.at(looks))
