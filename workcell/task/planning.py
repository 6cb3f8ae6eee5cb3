"""The parts of a task's plan: verified configurations and proved paths; without one the task ends with why."""

from __future__ import annotations

import functools
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from typing import NoReturn

from workcell.errors import InputError
from workcell.files import write_json_atomic
from workcell.ik.explain.why_not import explain
from workcell.ik.problem import POSE_BUDGET, Budget, IKProblem
from workcell.ik.registry import plans_alone
from workcell.ik.result import IKResult
from workcell.ik.solve import solve
from workcell.motion.body import Upright
from workcell.motion.path import Path
from workcell.motion.plans.in_scene import plan_in_world
from workcell.motion.plans.result import PlanSettings
from workcell.motion.teams.carrying import carry
from workcell.motion.teams.team import Team
from workcell.motion.tool_paths.follow import FollowLimits, follow, steps_of
from workcell.motion.tool_paths.poses import PathTolerance
from workcell.motion.tool_paths.reach import reach
from workcell.motion.tool_paths.result import Answered
from workcell.motion.tool_paths.route import route
from workcell.pose import Array, Pose
from workcell.task.script import TaskFailedError
from workcell.task.story import Story
from workcell.world.planning_world import PlanningWorld

MOVING = PlanSettings(clearance=0.002, iterations=6000)
"""How joint motions between two configurations are planned."""
LOOKING = replace(MOVING, iterations=1000, attempts=1)
"""How hard it is tried to get to a configuration that is one of several."""
LOOKING_BUDGET, LOOKING_HALVINGS = Budget(60.0, effort=0.1), 3
"""What a step of such a try may take, and how often it is halved."""


@dataclass(frozen=True, slots=True)
class Planning:
    """A run of a task as far as paths are planned.

    Attributes:
        story: where it is told what was planned, and where the queries of inverse kinematics are recorded.
        planner: name of the solver for configurations and paths.
        seed: same seed, same plan.
    """

    story: Story
    planner: str
    seed: int

    def solve(self, problem: IKProblem, what: str) -> IKResult:
        """A verified configuration; without one the task ends, with any proof and what is in the way."""
        with self.story.asking(what):
            result = solve(problem, self.planner, POSE_BUDGET, self.seed)
            if not result.solved:
                self._refuse(problem, result, what)
        first, second = result.clearance.pair
        how = f"{1e3 * result.clearance.distance:.0f} mm clear ({first} to {second})"
        if not first:
            how = "nothing checked" if result.checks is None else result.checks.words
        self.story.say(f"{what}: verified, {how}")
        return result

    def _refuse(self, problem: IKProblem, result: IKResult, what: str) -> NoReturn:
        """End the task. What the planner did not find, the portfolio decides; a proof is kept, explained and drawn."""
        decided = (
            result if result.status.is_impossible else solve(problem, budget=POSE_BUDGET, seed=self.seed)
        )
        if decided.certificate is None or not decided.status.is_proof:
            because = f" ({'; '.join(result.rejected[:2])})" if result.rejected else ""
            hint = f" {decided.solver} finds one: try --planner auto." if decided.solved else ""
            self.story.fail(result.status.value, f"{what}: {result.status.sentence}{because}{hint}")
        self.story.say(f"{what}: proved impossible: {decided.certificate.statement}")
        why = explain(problem, decided, seed=self.seed)
        self.story.summary |= {"why": why.to_json(), "proof": decided.certificate.statement}
        folder = self.story.recording.path.parent
        write_json_atomic(folder / f"{self.story.scene.name}.certificate.json", decided.certificate.to_json())
        if problem.cover is not None:
            nearest = None if why.closest is None else why.closest.q
            self.story.recording.log_blame(why.pieces, problem.robot, problem.cover, nearest)
        self.story.fail(decided.status.value, f"{what}: {decided.status.sentence} In short: {why.sentence}.")

    def follow(
        self,
        world: PlanningWorld,
        poses: Sequence[Pose],
        q_start: Array,
        limits: FollowLimits,
        what: str,
        *,
        tolerance: PathTolerance | None = None,
    ) -> Path:
        """A continuous joint path along tool poses, by the planner's steps; without one the task ends with why."""
        budget = None
        if self.story.trying:
            limits = replace(limits, max_halvings=min(limits.max_halvings, LOOKING_HALVINGS))
            budget = LOOKING_BUDGET
        world = world.fitting(poses) if plans_alone(self.planner) else world
        with self.story.asking(what, world):
            problem = world.problem(poses[0])
            solver = steps_of(
                self.planner, problem, tolerance=tolerance, limits=limits, budget=budget, seed=self.seed
            )
            result = follow(problem, poses, q_start, tolerance=tolerance, limits=limits, solver=solver)
        if result.path is None or not result.followed:
            where = "" if result.failure is None else f" {result.failure.words}"
            self.story.fail(result.status.value, f"{what}{where}. {result.status.sentence}")
        self._tell_path(world, result.path, limits, what, result.answered)
        return result.path

    def trace(
        self,
        world: PlanningWorld,
        poses: Sequence[Pose],
        limits: FollowLimits,
        what: str,
        *,
        tolerance: PathTolerance | None = None,
        q_start: Array | None = None,
        begins: Callable[[Array], object] | None = None,
    ) -> Path:
        """A continuous joint path along tool poses, from the start that leads all the way (or from the given one).

        Of the starts (n,) one is taken for which `begins`, a part of the plan, can be made; None: to which the robot
        can `move` from where it stands.
        """
        begins = begins or functools.partial(self._begin, world)
        with self.story.asking(what, world):
            result = route(
                world.problem(poses[0]),
                poses,
                q_start,
                q_near=world.robot.start,
                begins=functools.partial(self.can, begins) if q_start is None else None,
                tolerance=tolerance,
                limits=limits,
                solver=self.planner,
                seed=self.seed,
            )
        for line in result.tried:
            self.story.say(f"{what}: {line}")
        if result.path is None or result.metrics is None or not result.followed:
            where = "" if result.failure is None else f" {result.failure.words}"
            self.story.fail(result.status.value, f"{what}{where}. {result.status.sentence}")
        metrics = result.metrics
        self.story.say(
            f"{what}: {steps_in_words(result.path, limits, result.answered)}, half-way at most "
            f"{1e3 * metrics.deviation_m:.2f} mm off, manipulability {1e3 * metrics.manipulability:.2f}e-3 or more, "
            f"{metrics.limit_distance:.2f} rad or more from limits, "
            + self.story.if_looked_at(world, f"proved {1e3 * metrics.clearance_between:.0f} mm clear")
        )
        return result.path

    def move(self, world: PlanningWorld, q_from: Array, q_to: Array, what: str) -> Path:
        """A collision-free joint path between two configurations; without one the task ends with the reason."""
        settings = LOOKING if self.story.trying else MOVING
        with self.story.asking(what, world):
            found = plan_in_world(world, q_from, q_to, settings=settings, seed=self.seed, turns=False)
        if found.path is None:
            self.story.fail(found.status.value, f"{what}: {found.detail}. {found.status.sentence}")
        self.story.say(
            f"{what}: {len(found.path)} waypoints by the sampling planner, "
            + self.story.if_looked_at(world, "proved clear")
        )
        return found.path

    def _begin(self, world: PlanningWorld, q: Array) -> Path:
        return self.move(world, world.robot.start, q, "way to the start")

    def can(self, plan: Callable[..., object], *arguments: object) -> bool:
        """Whether a part of the plan, such as `move`, can be made: a quick try, not told, that does not end the task.

        A configuration that may not be one, because it collides, is a no as well.
        """
        with self.story.quietly():
            try:
                plan(*arguments)
            except (TaskFailedError, InputError):
                return False
        return True

    def reach(
        self,
        world: PlanningWorld,
        q_start: Array,
        inward: Sequence[Pose],
        limits: FollowLimits,
        what: str,
        *,
        goal: Array | None = None,
        others: Sequence[Sequence[Pose]] = (),
        upright: Upright | None = None,
    ) -> Path:
        """A continuous path from where the robot stands along tool poses; without one the task ends with the reason.

        `goal` (n,) is a configuration of the last pose, in which the path is to end. `others` would do as well as
        `inward`: the first that can be followed without a detour is taken. `upright` keeps an axis of the tool within
        a cone all along: for what must not tilt, or would slip if it did.
        """
        ways = [inward, *others]
        with self.story.asking(what, world):
            result = reach(
                world,
                q_start,
                ways,
                limits=limits,
                goal=goal,
                upright=upright,
                solver=self.planner,
                seed=self.seed,
            )
        if result.path is None:
            status = "NOT_FOUND" if result.ik is None or result.ik.solved else result.ik.status.value
            self.story.fail(status, f"{what}: {'; '.join(result.failures)}")
        followed = result.path if result.followed is None else result.followed.path or result.path
        self._tell_path(world, followed, limits, f"{what} ({result.how})", result.answered)
        return result.path

    def carry(
        self, team: Team, poses: Sequence[Pose], starts: Mapping[str, Array], limits: FollowLimits, what: str
    ) -> Path:
        """A proved path of all arms that hold an object, along its poses; without one the task ends with why."""
        with self.story.asking(what, *team.worlds.values()):
            result = carry(team, poses, starts, limits=limits, solver=self.planner, seed=self.seed)
        if result.path is None or result.proof is None:
            status = "COLLISION" if result.proof is not None else "NOT_FOUND"
            self.story.fail(status, f"{what}: {result.failure}")
        self.story.say(
            f"{what}: {len(team.grasps)} arms, {steps_in_words(result.path, limits, result.answered)}, "
            f"proved at least {1e3 * result.proof.margin:.0f} mm clear all along"
        )
        for name in team.grasps:
            self.story.log_way(name, team.tools(name, result.path.configurations))
        return result.path

    def _tell_path(
        self, world: PlanningWorld, path: Path, limits: FollowLimits, what: str, answered: Answered
    ) -> None:
        proved = f"proved at least {1e3 * limits.clearance:.0f} mm clear all along"
        self.story.say(
            f"{what}: {steps_in_words(path, limits, answered)}, " + self.story.if_looked_at(world, proved)
        )


def steps_in_words(path: Path, limits: FollowLimits, answered: Answered) -> str:
    """How many steps a path has, whose they are, and the largest of them against their bounds."""
    turned = f"largest link rotation {path.largest_link_rotation:.2f}"
    bound = "" if limits.max_link_rotation is None else f" of {limits.max_link_rotation:.2f}"
    return (
        f"{len(path)} waypoints, {answered.words}, largest step {path.largest_step:.3f} of {limits.max_step:.3f} rad, "
        f"{turned}{bound}"
    )
