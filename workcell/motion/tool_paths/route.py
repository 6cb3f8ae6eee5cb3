"""Follow a tool path from whichever configuration leads all the way: a global choice, then every step verified.

Configurations of the first pose are sampled (`workcell.ik.diverse.solutions`), tracked through the path in a layered
graph (`workcell.motion.tool_paths.graph`), from the other end too where that fails. The cheapest route is then
followed pose by pose with `workcell.motion.tool_paths.follow`, which verifies every waypoint and proves what lies
between; where a step of it fails, the convex solver is asked. Where no route leads all the way, everything that
continuous motions reach is looked through (`workcell.motion.tool_paths.layers`), unless the pose where they end is
proved to have no configuration (`workcell.motion.tool_paths.diagnosis`).
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import replace

import numpy as np
from numpy.typing import ArrayLike

from workcell.geometry.types import SphereCover
from workcell.ik.problem import IKProblem
from workcell.ik.registry import plans_alone
from workcell.motion.tool_paths.convex import ConvexSteps
from workcell.motion.tool_paths.diagnosis import words_of
from workcell.motion.tool_paths.follow import check_start
from workcell.motion.tool_paths.graph import Routes, RouteSearch
from workcell.motion.tool_paths.last_resort import LastResort
from workcell.motion.tool_paths.planners import check_planner, step_solver
from workcell.motion.tool_paths.poses import PathTolerance, check_tool_path
from workcell.motion.tool_paths.query import STARTS, RouteQuery
from workcell.motion.tool_paths.result import FollowLimits, FollowResult, not_begun, without_start
from workcell.motion.tool_paths.steps import Tolerant
from workcell.motion.tool_paths.tracker import LocalTracker
from workcell.pose import Array, Pose

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
        InputError: fewer than two poses, a start that is not at the first one, or a solver that tasks are not planned
            with. UnknownNameError: no such solver.
    """
    check_planner(solver)
    robot = template.robot
    given = None if q_start is None else robot.configuration(q_start, where="q_start")
    query = RouteQuery(
        template,
        check_tool_path(tool_poses),
        tolerance or PathTolerance(),
        limits or FollowLimits(),
        extent,
        solver,
        seed,
        None if q_near is None else robot.configuration(q_near, where="q_near"),
        begins,
    )
    if given is not None:
        check_start(template, query.tolerance, query.poses[0], given)
    return _by_convex_steps(query, given) if plans_alone(solver) else _by_graph(query, given)


def _by_convex_steps(query: RouteQuery, q_start: Array | None) -> FollowResult:
    """Every configuration by the convex solver; which start, and which allowed poses, the graph foretells."""
    convex = ConvexSteps(query)
    if q_start is not None:
        starts = [q_start]
    else:
        starts, answer = convex.starts()
        if not starts:
            return without_start(query.poses[0], answer)
    foretold = _graph(query, query.local_solver().tracker).run(starts)
    tried: list[str] = []
    best = _first_followed(query, convex.motions(foretold), convex.followed, tried)
    return replace(best or not_begun(query.poses[0]), tried=tuple(tried))


def _by_graph(query: RouteQuery, q_start: Array | None) -> FollowResult:
    """The cheapest routes of the graph, the first that stands every check; where none does, the last resort."""
    local = query.local_solver()
    starts = [q_start] if q_start is not None else query.starts()
    if not starts:
        first = replace(query.problem, target=query.poses[0])
        answer = Tolerant(step_solver(query.solver, seed=query.seed), query.tolerance)(first)
        if answer.q is None or not answer.solved:
            return without_start(query.poses[0], answer)
        starts = [np.array(answer.q)]
    found = _routes(query, local.tracker, starts, free_start=q_start is None)
    tried = [words_of(end, query.poses) for end in found.dead_ends]
    routes = sorted(found.complete, key=lambda path: path.cost + float(query.way_to(path.configurations[0])))
    complete = [(path.start, path.configurations) for path in routes]
    best = _first_followed(query, complete, lambda motion: query.follow(local, motion), tried)
    if best is None or not best.followed:
        best = LastResort(query, local, starts, q_start is None).run(found, best)
    return replace(best, tried=tuple(tried))


def _graph(query: RouteQuery, tracker: LocalTracker) -> RouteSearch:
    return RouteSearch(tracker, query.poses, query.clearance, query.problem.tolerances.safety_margin)


def _routes(query: RouteQuery, tracker: LocalTracker, starts: Sequence[Array], free_start: bool) -> Routes:
    """Forward from the starts; backward from the end where that fails."""
    search = _graph(query, tracker)
    forward = search.run(starts)
    if forward.complete or not free_start:
        return forward
    back = replace(search, poses=query.poses[::-1])
    backward = back.run(query.sampled(len(query.poses) - 1, STARTS))
    if not backward.complete:
        return forward
    turned = tuple(replace(r, configurations=r.configurations[::-1]) for r in backward.complete)
    return replace(backward, complete=turned, dead_ends=forward.dead_ends)


def _first_followed(
    query: RouteQuery,
    motions: Sequence[tuple[int, Array]],
    follow_motion: Callable[[Array], FollowResult],
    tried: list[str],
) -> FollowResult | None:
    """The first motion (start, configurations) that can be followed, or the furthest; None: none begins."""
    best: FollowResult | None = None
    left = VERIFIED
    for start, motion in motions:
        if query.begins is not None and not query.begins(motion[0]):
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
