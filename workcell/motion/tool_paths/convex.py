"""Follow a tool path with every configuration, starts included, by a convex method alone."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from workcell.ik.result import IKResult, Status
from workcell.ik.solve import solve
from workcell.motion.tool_paths.graph import Routes
from workcell.motion.tool_paths.planners import OWN_STEP_BUDGET, steps_of
from workcell.motion.tool_paths.query import RouteQuery
from workcell.motion.tool_paths.result import FollowResult
from workcell.motion.tool_paths.starts import with_turns
from workcell.motion.tool_paths.steps import starting_poses
from workcell.pose import Array

STARTS = 8
"""Configurations of the first pose that the convex solver is asked for."""


@dataclass(frozen=True, slots=True)
class ConvexSteps:
    """Starts and steps of one query by its convex solver."""

    query: RouteQuery

    def starts(self) -> tuple[list[Array], IKResult]:
        """Configurations (n,) of the first pose, and the solver's last answer."""
        query, found = self.query, list[Array]()
        poses = starting_poses(query.poses[0], query.tolerance)
        answer, hopeless = IKResult(Status.NOT_FOUND, query.solver), set[int]()
        for k in range(STARTS):
            turn = k % len(poses)
            if turn in hopeless:
                continue
            near = query.near if k < len(poses) else None
            asked = replace(query.problem, target=poses[turn], q_reference=near)
            answer = solve(asked, solver=query.solver, budget=OWN_STEP_BUDGET, seed=query.seed + k)
            if answer.q is not None and answer.solved:
                found.append(np.array(answer.q))
            if answer.status.is_proof:
                hopeless.add(turn)
        return with_turns(query.template.robot, found, query.near), answer

    def motions(self, foretold: Routes) -> list[tuple[int, Array]]:
        """(start, configurations) to try: routes that local tracking found, the cheapest first, then the furthest."""
        ends = sorted(foretold.dead_ends, key=lambda end: -end.waypoint)
        complete = sorted(
            foretold.complete, key=lambda path: path.cost + float(self.query.way_to(path.configurations[0]))
        )
        found = [(path.start, path.configurations) for path in complete]
        return found + [(end.start, end.motion) for end in ends]

    def followed(self, motion: Array) -> FollowResult:
        """Steps by the convex solver to the allowed poses that a motion (k, n) has."""
        query = self.query
        steps = steps_of(query.solver, query.template, tolerance=query.tolerance, seed=query.seed)
        return query.follow(steps, motion)
