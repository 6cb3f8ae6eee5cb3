"""How short paths get with time: ours optimised, alone and with ever more goals, beside OMPL's optimal planners."""

from __future__ import annotations

import time
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from workcell.bench.motion.plans import path_row, problems_of
from workcell.bench.reference import ompl
from workcell.bench.rows import Bench, Row
from workcell.ik.hjcd.solver import collect_solutions
from workcell.ik.problem import Budget
from workcell.motion.body import BodyClearance, pack_body
from workcell.motion.plans.compiled import Effort, search
from workcell.motion.plans.goals import GOALS, ROOM
from workcell.motion.plans.optimise import optimise, prepare_optimising
from workcell.motion.plans.to_pose import plan_to_pose
from workcell.pose import Array
from workcell.sets.problems import NamedProblem
from workcell.sets.solving import problem_seed

if TYPE_CHECKING:
    from workcell.motion.kernels.body import Body

FILES = ("panda_mbm_box", "panda_mbm_cage", "panda_mbm_table_under_pick", "sawyer_shelf")
"""Problem-set files: an easy one, two hard ones and one of another robot."""
SECONDS = (0.1, 1.0)
"""CPU seconds for optimising a path."""
OMPL = (("RRTConnect", 1.0, True), ("AORRTC", 0.1, False), ("AORRTC", 1.0, False), ("BITstar", 1.0, False))
"""Planners of OMPL, the CPU seconds that they get, and whether their paths are simplified."""

Answer = tuple[Array | None, float]
"""A path, and the CPU seconds that it took."""
Method = Callable[[NamedProblem, Array, Array, int], Answer]
"""From a problem, its start, the goals that all methods share, and a seed."""


def optimal_rows(n: int, seed: int, sets: Path | None) -> list[Row]:
    """Mean lengths by file and method.

    `given` has the goals that OMPL's planners have; `workcell` looks for its own.
    """
    prepare_optimising()
    rows = []
    for name in FILES:
        starts = problems_of(name, n, sets)
        shared = [shared_goals(item, seed) for item, _ in starts]
        # goals of some problems may not be found; then nobody is asked
        asked = [k for k, goals in enumerate(shared) if len(goals)]
        for label, method in methods() if asked else ():
            answers = [method(*starts[k], shared[k], problem_seed(seed, starts[k][0].id)) for k in asked]
            row = path_row(
                f"{name}/{label}",
                [starts[k] for k in asked],
                [path for path, _ in answers],
                [cpu for _, cpu in answers],
            )
            nearest = [np.linalg.norm(shared[k] - starts[k][1], axis=1).min() for k in asked]
            rows.append(row | {"nearest_given_goal_rad": float(np.mean(nearest))})
    return rows


def methods() -> list[tuple[str, Method]]:
    """All methods with their labels; OMPL's where it is installed."""
    found: list[tuple[str, Method]] = [("given", _given(0.0))]
    found += [(f"given-optimised-{seconds:g}s", _given(seconds)) for seconds in SECONDS]
    found.append(("workcell", _whole(0.0)))
    found += [(f"workcell-optimised-{seconds:g}s", _whole(seconds)) for seconds in SECONDS]
    if ompl.installed():
        for planner, budget_s, simplify in OMPL:
            found.append((f"ompl-{planner.lower()}-{budget_s:g}s", _ompl(planner, budget_s, simplify)))
    return found


def shared_goals(item: NamedProblem, seed: int) -> Array:
    """Goal configurations (k, n) of a problem as the planner samples them first."""
    first = problem_seed(seed, item.id)
    found: Sequence[Array] = [
        q for k in range(first, first + GOALS) for q in collect_solutions(item.problem, 1, k, Budget(0.2))
    ]
    return np.array(found).reshape(-1, item.problem.robot.dof)


def _body(item: NamedProblem, start: Array, goals: Array) -> Body:
    """What all methods keep clear of, by as much as the planner does: its room, or half of what the ends have."""
    problem = item.problem
    body = pack_body(problem.robot, problem.cover, problem.obstacles)
    clearance = BodyClearance(body, problem.cover, problem.obstacles)
    ends = float(clearance.many(np.vstack([start, goals])).min())
    return body._replace(floor=min(ROOM, 0.5 * max(ends, 0.0)))


def _given(seconds: float) -> Method:
    """RRT-Connect and shortcuts to the given goals, then optimised."""

    def method(item: NamedProblem, start: Array, goals: Array, seed: int) -> Answer:
        body = _body(item, start, goals)
        began = time.process_time()
        effort = Effort(cpu_s=5.0, optimise_s=seconds)
        found = search(body, start, goals, effort, seed)
        path = found.path
        if path is not None and effort.optimises:
            path = optimise(body, start, goals, path, found.goal, effort, seed).paths[-1]
        return path, time.process_time() - began

    return method


def _whole(seconds: float) -> Method:
    """All of `plan_to_pose`: its own goals, ever more of them while it optimises."""

    def method(item: NamedProblem, start: Array, goals: Array, seed: int) -> Answer:
        effort = Effort(optimise_s=seconds)
        plan = plan_to_pose(item.problem, start, budget=Budget(5.0), seed=seed, effort=effort)
        return plan.path, plan.stats["cpu_s"]

    return method


def _ompl(planner: str, budget_s: float, simplify: bool) -> Method:
    """One of OMPL's, with our compiled proof as its motion validator."""

    def method(item: NamedProblem, start: Array, goals: Array, seed: int) -> Answer:
        body, limits = _body(item, start, goals), item.problem.robot.joint_limits
        # its random numbers take seeds of 32 bits
        found = ompl.plan_ompl(body, limits, start, goals, planner, budget_s, seed % 2**31, simplify)
        return found.path, found.cpu_s

    return method


BENCHES = (
    Bench(
        "plan-optimal",
        4,
        "how short paths get in 0.1 s and 1 s; OMPL's optimal planners beside it (extra: ompl)",
        optimal_rows,
    ),
)
"""How short paths get with time."""
