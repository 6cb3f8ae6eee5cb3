"""Follow a tool path from whichever configuration leads all the way: a global choice, then every step verified.

Configurations of the first pose are sampled (`workcell.ik.diverse`), tracked through the path in a layered graph
(`workcell.motion.graph`), from the other end too where that fails, and drawn to configurations sampled along the path
where that fails as well. The cheapest route is then followed pose by pose with `workcell.motion.follow`, which verifies
every waypoint and proves what lies between; where a step of it fails, the convex solver is asked.
"""

from __future__ import annotations

import functools
from collections.abc import Callable, Sequence
from dataclasses import replace

import numpy as np
from numpy.typing import ArrayLike

from workcell.geometry.types import SphereCover
from workcell.ik.problem import Budget, IKProblem
from workcell.ik.result import IKResult, Status
from workcell.ik.solve import solve
from workcell.motion.follow import STEP_BUDGET, diagnose, follow, local_solver, step_solver
from workcell.motion.graph import DeadEnd, Route, Routes, RouteSearch
from workcell.motion.local import LocalTracker
from workcell.motion.outcome import (
    FollowFailure,
    FollowLimits,
    FollowResult,
    FollowStatus,
    not_begun,
    without_start,
)
from workcell.motion.starts import nearby, sampled, with_turns
from workcell.motion.steps import LocalSolver, Solver, Tolerant, starting_poses
from workcell.motion.toolpath import PathTolerance, check_tool_path
from workcell.pose import Array, Pose

CONVEX = ("ikspark", "cidgik")
"""Solvers that answer every step themselves; others track locally."""
STARTS = 12
"""Configurations of the first pose that are tried."""
ALONG = 6
"""Configurations sampled at a layer, where the starts alone don't lead to the end."""
START_BUDGET, LAYER_BUDGET = Budget(0.6), Budget(0.15)
"""CPU seconds for the samples of the first pose, and of a layer."""
CONVEX_STARTS = 8
"""Configurations of the first pose that the convex solvers are asked for."""
DIAGNOSIS_BUDGET = Budget(2.0)
"""CPU seconds to find out why no motion reaches a pose."""
APPROACH = 1.0
"""What a radian of the way to a route's start costs, in radians of the route."""
VERIFIED = 4
"""Routes that are followed in full, the cheapest first, before the search gives up."""


def route(
    template: IKProblem,
    tool_poses: Sequence[Pose],
    q_start: ArrayLike | None = None,
    *,
    q_near: ArrayLike | None = None,
    begins: Callable[[Array], bool] | None = None,
    tolerance: PathTolerance | None = None,
    limits: FollowLimits | None = None,
    extent: SphereCover | None = None,
    solver: str = "auto",
    seed: int = 0,
) -> FollowResult:
    """A continuous motion with the tool along the poses, from a configuration of its own choice (or the given one).

    Args:
        template, tool_poses, tolerance, limits, extent: as of `follow`.
        q_start: (n,) a configuration that has the tool at the first pose; None: any.
        q_near: (n,) where the robot stands before: of routes that are alike, one that begins near it is taken.
        begins: whether a motion may begin at a configuration (n,), such as one that the robot can get to; None: at any.
        solver: `auto`: local tracking, with IKSPARK where it fails. `ikspark`, `cidgik`: every configuration, starts
            included, by the convex method alone; the graph only says which start to take first, and which of the poses
            that the tolerance allows to ask for.
        seed: same seed, same motion.

    Returns:
        the motion, or how far the best try got, where it ended and why (`failure`), and what the other starts led to
        (`tried`).

    Raises:
        InputError: fewer than two poses, or a start that is not at the first one. UnknownNameError: no such solver.
    """
    search = _Search(
        template,
        check_tool_path(tool_poses),
        tolerance or PathTolerance(),
        limits or FollowLimits(),
        extent,
        solver,
        seed,
    )
    given = None if q_start is None else template.robot.configuration(q_start, where="q_start")
    if q_near is not None:
        search.near = template.robot.configuration(q_near, where="q_near")
    search.begins = begins
    return search.by_convex_steps(given) if solver in CONVEX else search.by_graph(given)


class _Search:
    """One query."""

    def __init__(
        self,
        template: IKProblem,
        poses: tuple[Pose, ...],
        tolerance: PathTolerance,
        limits: FollowLimits,
        extent: SphereCover | None,
        solver: str,
        seed: int,
    ) -> None:
        self.template, self.poses, self.tolerance, self.limits = template, poses, tolerance, limits
        self.extent, self.solver, self.seed = extent, solver, seed
        self.near: Array | None = None
        self.begins: Callable[[Array], bool] | None = None
        keep = max(limits.clearance, template.tolerances.safety_margin)
        self.problem = replace(template, tolerances=replace(template.tolerances, safety_margin=keep))

    def by_convex_steps(self, q_start: Array | None) -> FollowResult:
        """Every configuration by the convex solver; which start, and which allowed poses, the graph foretells."""
        starts, answer = ([q_start], None) if q_start is not None else self._convex_starts()
        if not starts:
            return without_start(self.poses[0], answer or IKResult(Status.NOT_FOUND, self.solver))
        foretold = self._graph(self._local().tracker).run(starts)
        ends = sorted(foretold.dead_ends, key=lambda end: -end.waypoint)
        complete = sorted(foretold.complete, key=self._price)
        motions = [(path.start, path.configurations) for path in complete]
        motions += [(end.start, end.motion) for end in ends]
        tried: list[str] = []

        def followed(motion: Array) -> FollowResult:
            return self._followed(motion[0], self._convex_solver(motion), self.limits)

        best = self._first_followed(motions, followed, tried) or not_begun(self.poses[0])
        return replace(best, tried=tuple(tried))

    def _convex_starts(self) -> tuple[list[Array], IKResult | None]:
        """Configurations of the first pose by the convex solver, and its last answer."""
        found: list[Array] = []
        answer = None
        for k in range(CONVEX_STARTS):
            poses = starting_poses(self.poses[0], self.tolerance)
            near = self.near if k < len(poses) else None
            asked = replace(self.problem, target=poses[k % len(poses)], q_reference=near)
            answer = solve(asked, solver=self.solver, budget=STEP_BUDGET, seed=self.seed + k)
            if answer.q is not None and answer.solved:
                found.append(np.array(answer.q))
            if answer.status.is_proof and self.tolerance.exact:
                break
        return with_turns(self.template.robot, found, self.near), answer

    def _convex_solver(self, motion: Array) -> Tolerant:
        """Steps by the convex solver to the allowed poses that a motion (k, n) has."""
        robot = self.template.robot
        wanted = {
            id(pose): self.tolerance.allowed(pose, robot, q)
            for pose, q in zip(self.poses, motion, strict=False)
        }
        steps = step_solver(self.solver, budget=STEP_BUDGET, seed=self.seed)
        return Tolerant(steps, self.tolerance, wanted)

    def by_graph(self, q_start: Array | None) -> FollowResult:
        """The cheapest routes of the graph, the first that stands every check."""
        local = self._local()
        starts = [q_start] if q_start is not None else self._starts()
        if not starts:
            first = replace(self.problem, target=self.poses[0])
            answer = Tolerant(step_solver(self.solver, seed=self.seed), self.tolerance)(first)
            if answer.q is None or not answer.solved:
                return without_start(self.poses[0], answer)
            starts = [np.array(answer.q)]
        found = self._routes(local, starts, free_start=q_start is None)
        tried = [self._words(end) for end in found.dead_ends]
        complete = [(path.start, path.configurations) for path in sorted(found.complete, key=self._price)]
        best = self._first_followed(complete, lambda motion: self._follow(local, motion, self.limits), tried)
        if best is None:
            best = (
                not_begun(self.poses[0]) if complete else self._rescued(local, found) or self._no_route(found)
            )
        return replace(best, tried=tuple(tried))

    def _first_followed(
        self,
        motions: Sequence[tuple[int, Array]],
        follow_motion: Callable[[Array], FollowResult],
        tried: list[str],
    ) -> FollowResult | None:
        """The first motion (start, configurations) that can be followed, or the one that gets furthest; None: none begins."""
        best: FollowResult | None = None
        left = VERIFIED
        for start, motion in motions:
            if self.begins is not None and not self.begins(motion[0]):
                tried.append(f"start {start}: no way to it from where the robot stands was found")
                continue
            result = follow_motion(motion)
            if result.followed:
                return result
            tried.append(f"start {start}: {result.failure.words if result.failure else ''}")
            best = result if best is None or result.fraction > best.fraction else best
            left -= 1
            if left == 0:
                break
        return best

    def _price(self, path: Route) -> float:
        """A route's cost, and a share of the way to its start (radians, the joint that moves most)."""
        apart = 0.0 if self.near is None else float(np.abs(path.configurations[0] - self.near).max())
        return path.cost + APPROACH * apart

    def _local(self) -> LocalSolver:
        return local_solver(self.template, tolerance=self.tolerance, limits=self.limits, seed=self.seed)

    def _graph(self, tracker: LocalTracker) -> RouteSearch:
        checker = self.template.checker
        clear = None if checker is None else lambda q: checker(q).distance
        return RouteSearch(tracker, self.poses, None, clear, self.problem.tolerances.safety_margin)

    def _routes(self, local: LocalSolver, starts: Sequence[Array], free_start: bool) -> Routes:
        """Forward from the starts; backward from the end; forward again, drawn to samples along the path."""
        search = self._graph(local.tracker)
        forward = search.run(starts)
        if forward.complete:
            return forward
        if free_start:
            back = replace(search, poses=self.poses[::-1])
            ends = self._sampled(len(self.poses) - 1, STARTS, START_BUDGET)
            backward = back.run(ends)
            if backward.complete:
                turned = tuple(replace(r, configurations=r.configurations[::-1]) for r in backward.complete)
                return replace(backward, complete=turned, dead_ends=forward.dead_ends)
        samples = functools.cache(lambda row: self._sampled(row, ALONG, LAYER_BUDGET))
        drawn = replace(search, samples=samples).run(starts)
        return drawn if drawn.complete or _far(drawn) >= _far(forward) else forward

    def _starts(self) -> list[Array]:
        """Configurations (n,) of the first pose: near where the robot stands, and sampled."""
        first = replace(self.problem, target=self.poses[0])
        found = self._sampled(0, STARTS, START_BUDGET)
        if self.near is not None:
            found = [*nearby(first, self.tolerance, self.near, self.seed, LAYER_BUDGET), *found]
        return with_turns(self.template.robot, found, self.near)

    def _sampled(self, row: int, count: int, budget: Budget) -> list[Array]:
        """Configurations (n,) of one pose of the path, or of poses that its tolerance allows."""
        problem = replace(self.problem, target=self.poses[row])
        return sampled(problem, self.tolerance, count, self.seed, budget)

    def _follow(self, local: LocalSolver, motion: Array, limits: FollowLimits) -> FollowResult:
        """Step by step along a motion (k, n) through the first k poses, and on from there."""
        local.propose(self.poses, motion)
        return self._followed(motion[0], local, limits)

    def _followed(self, q_start: Array, solver: Solver, limits: FollowLimits) -> FollowResult:
        return follow(
            self.template,
            self.poses,
            q_start,
            tolerance=self.tolerance,
            limits=limits,
            extent=self.extent,
            solver=solver,
        )

    def _rescued(self, local: LocalSolver, found: Routes) -> FollowResult | None:
        """From the start that led furthest, with the convex solver where local steps fail; None if that fails too."""
        furthest = found.furthest
        if furthest is None:
            return None
        result = self._follow(local, furthest.motion, replace(self.limits, max_halvings=1))
        return result if result.followed else None

    def _no_route(self, found: Routes) -> FollowResult:
        """No route: the pose that no start gets to, and whether that pose itself is the reason."""
        end = found.furthest
        assert end is not None
        pose = self.poses[end.waypoint]
        answer = Tolerant(step_solver(self.solver, DIAGNOSIS_BUDGET, self.seed), self.tolerance)
        reason = diagnose(answer, self.problem, pose, end.motion[-1], self.limits.max_step)
        status, detail = reason.status, reason.detail
        if status in (FollowStatus.STEP_TOO_LARGE, FollowStatus.NOT_FOUND):
            status = FollowStatus.NO_CONTINUOUS_MOTION
            detail = f"{end.why}. {found.nodes} configurations in the graph, {found.edges} motions tried; {reason.detail}"
        fraction = (end.waypoint - 1) / (len(self.poses) - 1)
        return FollowResult(
            status, None, FollowFailure(end.waypoint, fraction, pose, detail, reason.ik), None, found.edges
        )

    def _words(self, end: DeadEnd) -> str:
        x, y, z = self.poses[end.waypoint].position
        return f"start {end.start}: ends before pose {end.waypoint} ({x:.3f}, {y:.3f}, {z:.3f}): {end.why}"


def _far(routes: Routes) -> int:
    furthest = routes.furthest
    return -1 if furthest is None else furthest.waypoint
