"""A proved path from a configuration to a pose: goals by inverse kinematics, then the compiled search.

What SOLVED rests on: the judge of single configurations, which shares nothing with solvers and planners, accepts the
path's end, and the planner's own kernels prove all of it once more when it is whole. `motion.proofs.judge.judge_path`
proves a path with code of its own. It takes four times as long as planning does, so that it is not asked here but by
`workcell verify`, and by whoever calls it.
"""

from __future__ import annotations

import time
from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from types import MappingProxyType
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import ArrayLike

from workcell import clock
from workcell.errors import InputError
from workcell.ik.hjcd.solver import prepare as prepare_goals
from workcell.ik.problem import Budget, IKProblem
from workcell.ik.result import IKResult, Status
from workcell.ik.solve import solve
from workcell.motion.body import BodyClearance, Upright, kernels, pack_body
from workcell.motion.plans.compiled import Effort, prepare_kernels, search
from workcell.motion.plans.ends import checked_end
from workcell.motion.plans.goals import GOALS, ROOM, Goals
from workcell.motion.plans.optimise import optimise, path_length, prepare_optimising
from workcell.pose import Array, read_only

if TYPE_CHECKING:
    from workcell.motion.kernels.body import Body

FIRST_ITERATIONS, FIRST_LOOKS = 200_000, 30_000
"""Samples drawn and configurations looked at in the first round, at most: 0.1 s or so. Every further round has twice as
many. Counts and not times, so that a slower machine finds the same path."""
SAMPLING = 1600
"""Restarts of the first round in which sampling may look for goals, before the whole portfolio is asked; then
doubled."""
KEEP = 0.5
"""Share of the clearance that the final proof asks for as its margin."""
OPTIMISED = 500
"""Samples of the first round of optimising; every further round has twice as many, and knows more goals."""
_MOST_GOALS = 48
"""Further goals of one round of optimising."""


@dataclass(frozen=True, slots=True)
class PosePlan:
    """A path to a pose, or why there is none.

    Attributes:
        status: SOLVED: there is a path, whose end the independent judge accepts, and which the planner's own kernels
            proved; UNREACHABLE, BLOCKED, BLOCKED_IN_MODEL: no configuration reaches the pose, with the certificate in
            `ik`; NOT_FOUND: the budget was spent.
        path: (k, n) corners, straight lines between, from the start to a configuration that solves the problem; or
            None.
        proved: whether all of the path was proved clear, by the planner's own kernels (see the module).
        margin: metres of clearance that were proved; nan without a path.
        reason: what stood in the way, in words; empty when solved.
        ik: the last answer of inverse kinematics, where it has none or a proof that there is none.
        stats: CPU and wall seconds, samples drawn, lines tried, configurations looked at, goals; of a path its length
            in radians (`length`), and, where it was optimised, the length before (`first_length`), the CPU seconds
            before (`first_cpu_s`), the length of the straight line to the nearest goal known (`lower_bound`), which
            no path to these goals is shorter than, and the samples drawn (`optimise_iterations`).
    """

    status: Status
    path: Array | None
    proved: bool = False
    margin: float = float("nan")
    reason: str = ""
    ik: IKResult | None = None
    stats: Mapping[str, float] = field(default_factory=dict)

    def __post_init__(self) -> None:
        if self.path is not None:
            object.__setattr__(self, "path", read_only(self.path))
        object.__setattr__(self, "stats", MappingProxyType(dict(self.stats)))

    @property
    def solved(self) -> bool:
        """Whether there is a path."""
        return self.status is Status.SOLVED


def plan_to_pose(
    problem: IKProblem,
    q_start: ArrayLike,
    *,
    budget: Budget | None = None,
    seed: int = 0,
    upright: Upright | None = None,
    effort: Effort | None = None,
) -> PosePlan:
    """Bring the tool from `q_start` (n,) to the problem's target without touching anything on the way.

    The robot is the problem's cover and the obstacles its pieces; a problem with its own judge (`checker`) is planned
    by `workcell.motion.plans.by_checker`. Same problem, budget and seed, same path, as far as the budget reaches.

    Args:
        budget: CPU seconds of this process, for goals, search and proof; default 5 s.
        upright: keep an axis of the tool within a cone all along.
        effort: how the search goes; its own time limit is overruled. Its `optimise_s` comes on top of the budget: the
            path gets shorter and shorter, to ever more goal configurations.

    Raises:
        InputError: a start of the wrong size, not finite, outside its limits, in collision (which pair, how deep,
            and the nearest free configuration that was found), or tilted too far already.
    """
    prepare_kernels()
    prepare_goals(problem)
    effort = effort or Effort()
    if effort.optimises:
        prepare_optimising()
    return _Query(problem, q_start, budget or Budget(), seed, upright, effort).run()


class _Query:
    """One query: rounds of goals and search, each with twice the means of the one before."""

    def __init__(
        self,
        problem: IKProblem,
        q_start: ArrayLike,
        budget: Budget,
        seed: int,
        upright: Upright | None,
        effort: Effort,
    ) -> None:
        if problem.checker is not None:
            raise InputError(
                "the problem has a judge of its own",
                where="problem",
                remedy="workcell.motion.plans.by_checker.plan takes a checker",
            )
        self.wall, self.cpu = time.perf_counter(), clock.cpu_seconds()
        self.problem, self.seed, self.effort, self.budget = problem, seed, effort, budget
        self.body = pack_body(
            problem.robot,
            problem.cover,
            problem.obstacles,
            self_pairs=problem.self_collision,
            upright=upright,
        )
        self.clearance = BodyClearance(self.body, problem.cover, problem.obstacles)
        self.start, gap = checked_end(problem.robot, q_start, self.clearance, "start", upright=upright)
        self.floor = min(ROOM, 0.5 * gap)
        self.goals = Goals(problem, self.clearance, upright, seed, self.start)
        self.spent = {"iterations": 0.0, "lines": 0.0, "looks": 0.0, "rounds": 0.0}

    def left(self) -> float:
        """CPU seconds that may still be spent."""
        return self.budget.cpu_s - (clock.cpu_seconds() - self.cpu)

    def run(self) -> PosePlan:
        reason = "the budget was spent"
        while self.left() > 0 or self.spent["rounds"] == 0:
            scale = 2 ** int(self.spent["rounds"])
            self.goals.sample(SAMPLING * scale, clock.cpu_seconds() + max(self.left(), 0.0))
            if not self.goals.rows:
                # sampling finds nothing: let the whole portfolio say whether the pose can be reached at all
                result = solve(self.problem, budget=Budget(max(self.left(), 0.0)), seed=self.seed)
                if result.q is None or not self.goals.allowed(result.q):
                    return self.without_goals(result)
                self.goals.add([np.array(result.q)])
            goals, rows = self.goals.offered(int(self.spent["rounds"]))
            self.spent["rounds"] += 1
            # the clearance to keep on the way is at most half of the ends'
            floor = min(self.floor, 0.5 * max(self.goals.least, 0.0))
            body = self.body._replace(floor=floor)
            effort = replace(
                self.effort,
                cpu_s=max(self.left(), 0.0),
                iterations=min(self.effort.iterations, FIRST_ITERATIONS * scale),
                looks=min(self.effort.looks, FIRST_LOOKS * scale),
            )
            found = search(body, self.start, goals, effort, self.seed + scale - 1)
            self.spent["iterations"] += found.iterations
            self.spent["lines"] += found.lines
            self.spent["looks"] += found.looks
            reason = f"none of {len(goals)} goal configurations was reached with {int(self.spent['lines'])} lines tried"
            if found.path is not None:
                answer = self.answer(body, found.path)
                if answer is not None:
                    return answer
                del self.goals.rows[rows[found.goal]]
        return self.result(Status.NOT_FOUND, None, reason=reason)

    def answer(self, body: Body, path: Array) -> PosePlan | None:
        """The only door to SOLVED; None where the judge of single configurations refuses the end of a path found."""
        if self.effort.optimises and self.goals.reaches(path[-1]):
            path = self.optimised(body, path)
        return self.proved(body, path) if self.goals.reaches(path[-1]) else None

    def optimised(self, body: Body, path: Array) -> Array:
        """The shortest path that the means for optimising lead to, in rounds with ever more goals and samples."""
        left = self.effort.optimise_iterations
        deadline = clock.cpu_seconds() + self.effort.optimise_s
        self.spent["first_length"] = path_length(path)
        self.spent["first_cpu_s"] = clock.cpu_seconds() - self.cpu
        self.spent["optimise_iterations"] = 0.0
        goals, goal, rounds = [q for q in self.goals.rows if self.goals.reaches(q)], path[-1], 0
        if not any(np.array_equal(q, goal) for q in goals):
            goals.append(goal)
        while left > 0 and (rounds == 0 or clock.cpu_seconds() < deadline):
            count, now = min(GOALS * 2**rounds, _MOST_GOALS), clock.cpu_seconds()
            goals += self.goals.nearer(path, body.floor, count, now + 0.3 * max(deadline - now, 0.0))
            samples = min(OPTIMISED * 2**rounds, left)
            rounds, left = rounds + 1, left - samples
            effort = replace(
                self.effort, optimise_s=max(deadline - clock.cpu_seconds(), 0.0), optimise_iterations=samples
            )
            row = next(k for k, q in enumerate(goals) if np.array_equal(q, goal))
            shorter = optimise(body, self.start, goals, path, row, effort, self.seed + rounds)
            path, goal = shorter.paths[-1], goals[shorter.goals[-1]]
            self.spent["optimise_iterations"] += shorter.iterations
            self.spent["lines"] += shorter.lines
            self.spent["looks"] += shorter.looks
            self.spent["lower_bound"] = shorter.lower_bound
        return path

    def without_goals(self, result: IKResult) -> PosePlan:
        """Nothing to plan to: what the portfolio says."""
        if result.solved:
            reason = "every goal configuration found breaks the tool's orientation limit"
            return self.result(Status.NOT_FOUND, None, reason=reason)
        reason = f"no goal configuration: {result.status.sentence}"
        return self.result(result.status, None, reason=reason, ik=result)

    def proved(self, body: Body, path: Array) -> PosePlan:
        """The path with its margin, after one more proof of all of it."""
        out = np.empty(7)
        entries = kernels()
        code = entries.prove_lines(body, path, KEEP, 1e-7, 100_000, out)
        if code != entries.PROVED:
            # can't happen: every line was proved before
            return self.result(
                Status.SOLVER_ERROR, None, reason="the path that was found does not pass its proof"
            )
        return self.result(Status.SOLVED, path, proved=True, margin=float(out[2]))

    def result(
        self,
        status: Status,
        path: Array | None,
        *,
        proved: bool = False,
        margin: float = float("nan"),
        reason: str = "",
        ik: IKResult | None = None,
    ) -> PosePlan:
        stats = {
            **self.spent,
            "goals": float(len(self.goals.rows)),
            **({} if path is None else {"length": path_length(path)}),
            "cpu_s": clock.cpu_seconds() - self.cpu,
            "time_s": time.perf_counter() - self.wall,
        }
        return PosePlan(status, path, proved, margin, reason, ik, stats)
