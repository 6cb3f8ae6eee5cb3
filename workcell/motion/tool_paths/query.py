"""What is asked of `workcell.motion.tool_paths.route`, and what its ways of answering share.

They share starts, and motions followed in full.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field, replace

import numpy as np

from workcell.geometry.types import SphereCover
from workcell.ik.problem import Budget, IKProblem
from workcell.motion.tool_paths.follow import follow
from workcell.motion.tool_paths.planners import local_solver
from workcell.motion.tool_paths.poses import PathTolerance
from workcell.motion.tool_paths.result import FollowLimits, FollowResult
from workcell.motion.tool_paths.starts import nearby, sampled, with_turns
from workcell.motion.tool_paths.steps import LocalSolver, Solver
from workcell.pose import Array, Pose

STARTS = 12
"""Configurations of the first pose that are tried."""
START_BUDGET, NEAR_BUDGET = Budget(60.0, effort=0.6), Budget(60.0, effort=0.15)
"""For the samples of the first pose, and for those near where the robot stands."""
APPROACH = 1.0
"""What a radian of the way to a route's start costs, in radians of the route."""


@dataclass(slots=True)
class RouteQuery:
    """One query; the attributes are the arguments of `route`.

    Attributes:
        problem: the template with the clearance that the limits ask for.
    """

    template: IKProblem
    poses: tuple[Pose, ...]
    tolerance: PathTolerance
    limits: FollowLimits
    extent: SphereCover | None
    solver: str
    seed: int
    near: Array | None = None
    begins: Callable[[Array], bool] | None = None
    problem: IKProblem = field(init=False)

    def __post_init__(self) -> None:
        keep = max(self.limits.clearance, self.template.tolerances.safety_margin)
        tolerances = replace(self.template.tolerances, safety_margin=keep)
        self.problem = replace(self.template, tolerances=tolerances)

    def clearance(self, q: Array) -> float:
        """Metres at a configuration (n,), by the problem's own truth; inf where it has none."""
        checker = self.template.checker
        return float(np.inf) if checker is None else checker(q).distance

    def way_to(self, q: Array) -> Array:
        """What it costs to begin at configurations (..., n): (...,)."""
        near = q if self.near is None else self.near
        apart: Array = np.abs(q - near).max(axis=-1)
        return APPROACH * apart

    def starts(self) -> list[Array]:
        """Configurations (n,) of the first pose: near where the robot stands, and sampled."""
        first = replace(self.problem, target=self.poses[0])
        found = self.sampled(0, STARTS)
        if self.near is not None:
            found = [*nearby(first, self.tolerance, self.near, self.seed, NEAR_BUDGET), *found]
        return with_turns(self.template.robot, found, self.near)

    def sampled(self, row: int, count: int) -> list[Array]:
        """Configurations (n,) of one pose of the path, or of poses that its tolerance allows."""
        problem = replace(self.problem, target=self.poses[row])
        return sampled(problem, self.tolerance, count, self.seed, START_BUDGET)

    def local_solver(self) -> LocalSolver:
        """Local steps, with IKSPARK where they fail."""
        return local_solver(self.template, tolerance=self.tolerance, limits=self.limits, seed=self.seed)

    def follow(
        self,
        solver: Solver,
        motion: Array,
        poses: tuple[Pose, ...] | None = None,
        halvings: int | None = None,
    ) -> FollowResult:
        """Step by step along a motion (k, n) through the first k poses (None: of the path), and on from there."""
        return follow(
            self.template,
            poses or self.poses,
            motion[0],
            tolerance=self.tolerance,
            limits=self.limits if halvings is None else replace(self.limits, max_halvings=halvings),
            extent=self.extent,
            solver=solver,
            proposed=motion,
        )
