"""Plans paths for whole problem sets."""

from __future__ import annotations

import time
from collections import Counter
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from workcell.errors import InputError
from workcell.ik.problem import Budget
from workcell.ik.result import Status
from workcell.model.robot import Robot
from workcell.motion.body import BodyClearance, pack_body
from workcell.motion.plans.compiled import Effort
from workcell.motion.plans.ends import checked_end
from workcell.motion.plans.to_pose import plan_to_pose
from workcell.motion.timing.phase_plane import rest_to_rest
from workcell.pose import Array
from workcell.sets.paths import path_line
from workcell.sets.problems import NamedProblem, ProblemSet
from workcell.sets.reports import cpu_columns, cpu_figures
from workcell.sets.solving import Progress, problem_seed
from workcell.sets.workers import output_file, run_lines, write_line


@dataclass(frozen=True, slots=True)
class PlanSummary:
    """What planning a problem set came to.

    Attributes:
        set, robot, seed: what was planned.
        statuses: how many problems ended with each status.
        proved: paths proved clear all along.
        cpu_s: (n,) CPU seconds a problem: goals, search and proof.
        length: (k,) of the paths found, radians (L2).
        first_length, lower_bound: (k,) where paths were optimised: their lengths before, and the lengths of the
            straight lines to the nearest goals known; else empty.
        wall_s: of the whole run.
    """

    set: str
    robot: str
    seed: int
    statuses: dict[str, int]
    proved: int
    cpu_s: tuple[float, ...]
    length: tuple[float, ...]
    first_length: tuple[float, ...]
    lower_bound: tuple[float, ...]
    wall_s: float

    def to_json(self) -> dict[str, Any]:
        """A plain dictionary."""
        return {
            "set": self.set,
            "robot": self.robot,
            "seed": self.seed,
            "n": len(self.cpu_s),
            "statuses": dict(self.statuses),
            "proved": self.proved,
            **cpu_columns(self.cpu_s),
            "cpu_ms_max": 1e3 * max(self.cpu_s, default=float("nan")),
            "mean_length_rad": _mean(self.length),
            "mean_first_length_rad": _mean(self.first_length),
            "mean_lower_bound_rad": _mean(self.lower_bound),
            "wall_s": self.wall_s,
        }

    def rows(self) -> list[tuple[str, object]]:
        """(label, value) for a table."""
        mean, median, p95 = cpu_figures(self.cpu_s)
        optimised: list[tuple[str, object]] = []
        if self.first_length:
            optimised = [
                ("mean length before optimising, rad", _mean(self.first_length)),
                ("straight lines to the nearest goals known, rad", _mean(self.lower_bound)),
            ]
        return [
            ("problems", len(self.cpu_s)),
            *((s.value, self.statuses[s.value]) for s in Status if s.value in self.statuses),
            ("paths proved", self.proved),
            ("CPU ms, mean", mean),
            ("CPU ms, median", median),
            ("CPU ms, 95 %", p95),
            ("CPU ms, largest", 1e3 * max(self.cpu_s, default=float("nan"))),
            ("mean length, rad", _mean(self.length)),
            *optimised,
            ("wall s", self.wall_s),
        ]


def _mean(values: tuple[float, ...]) -> float | None:
    return float(np.mean(values)) if values else None


def plan_set(
    problem_set: ProblemSet,
    *,
    budget: Budget | None = None,
    effort: Effort | None = None,
    seed: int = 0,
    jobs: int = 1,
    out: Path | None = None,
    progress: Progress | None = None,
) -> PlanSummary:
    """Plan a path from every problem's start to its target.

    Args:
        problem_set: as `load_problem_set` reads it; every problem has a start.
        budget: CPU seconds a problem.
        effort: of the search; its `optimise_s` comes on top of the budget.
        seed: of the run; each problem has its own, derived from it and the id.
        jobs: processes.
        out: JSON lines, one a problem in the set's order, written as `solve_set` writes answers.
        progress: called after every problem.

    Raises:
        InputError: a problem without a start, or one whose start is in collision: before anything is planned.
        OutputError: `out` can't be written.
        KeyboardInterrupt: interrupted; its message says where the paths so far are.
    """
    check_starts(problem_set)
    started = time.perf_counter()
    limits = motion_limits_of(problem_set.robot)
    task = _Task(problem_set.problems, budget or Budget(), effort or Effort(), seed, limits)
    statuses, cpu, proved = Counter[str](), [], 0
    lengths: dict[str, list[float]] = {"length_rad": [], "first_length_rad": [], "lower_bound_rad": []}
    with output_file(out) as file:
        for line in run_lines(task, jobs):
            if file is not None:
                write_line(file, line)
            statuses[line["status"]] += 1
            proved += bool(line["proved"])
            cpu.append(line["cpu_s"])
            for name, values in lengths.items():
                if line[name] is not None:
                    values.append(line[name])
            if progress is not None:
                progress()
    wall = time.perf_counter() - started
    return PlanSummary(
        problem_set.name,
        problem_set.robot.name,
        seed,
        dict(statuses),
        proved,
        tuple(cpu),
        tuple(lengths["length_rad"]),
        tuple(lengths["first_length_rad"]),
        tuple(lengths["lower_bound_rad"]),
        wall,
    )


def check_starts(problem_set: ProblemSet) -> None:
    """Raise InputError for the first problem whose start is missing or in collision (with a free one near by)."""
    for named in problem_set.problems:
        where = f"{problem_set.name}, problem {named.id!r}, start"
        if named.start is None:
            raise InputError(
                "the problem has no start", where=where, remedy=f"{problem_set.robot.dof} joint values"
            )
        problem = named.problem
        body = pack_body(problem.robot, problem.cover, problem.obstacles, self_pairs=problem.self_collision)
        clearance = BodyClearance(body, problem.cover, problem.obstacles)
        checked_end(problem.robot, named.start, clearance, where)


def motion_limits_of(robot: Robot) -> tuple[Array, Array] | None:
    """Velocity and acceleration limits: the robot's own, or those of the robot of that name here.

    Here are the robots that travel with workcell. None where neither is known: a problem-set file has no such limits.
    """
    if not np.all(np.isfinite(robot.velocity) & np.isfinite(robot.acceleration)):
        from workcell.model.loading.assets import list_assets
        from workcell.model.scene import robot_scene

        if robot.name not in list_assets("robots"):
            return None
        known = robot_scene(robot.name).robot().robot
        if known.dof != robot.dof or not np.all(
            np.isfinite(known.velocity) & np.isfinite(known.acceleration)
        ):
            return None
        return np.array(known.velocity), np.array(known.acceleration)
    return np.array(robot.velocity), np.array(robot.acceleration)


@dataclass(frozen=True, slots=True)
class _Task:
    """What a worker process needs."""

    problems: tuple[NamedProblem, ...]
    budget: Budget
    effort: Effort
    seed: int
    limits: tuple[Array, Array] | None

    def __len__(self) -> int:
        return len(self.problems)

    def line(self, index: int) -> dict[str, Any]:
        named = self.problems[index]
        assert named.start is not None  # `check_starts` saw to it
        plan = plan_to_pose(
            named.problem,
            named.start,
            budget=self.budget,
            seed=problem_seed(self.seed, named.id),
            effort=self.effort,
        )
        duration = None
        if plan.path is not None and self.limits is not None:
            duration = rest_to_rest(plan.path, *self.limits)
        return path_line(named.id, plan, duration)
