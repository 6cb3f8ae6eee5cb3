"""Bench of IKSPARK on poses whose first answer hits the robot itself, with and without rows about that."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path

import numpy as np

from workcell import clock
from workcell.bench.rows import Bench, Row
from workcell.ik.ikspark.solver import solve_ikspark
from workcell.ik.problem import Budget, IKProblem
from workcell.sets.reports import cpu_columns
from workcell.sets.solving import problem_seed

BUDGET = Budget(20.0, effort=3.0)
"""Work ends a query: 900 cone programs."""
ROBOTS = ("sawyer", "ur10", "iiwa14")
MOST = 100
"""Random poses that are looked at for each one that is wanted."""
_CLEAR = 1e-3
"""Metres of clearance of the configurations whose tool poses are asked for."""


def entangled(robot: str, n: int, seed: int) -> list[tuple[IKProblem, int]]:
    """Poses of a robot alone whose first rank-1 point is refused, because it hits itself there, and their seeds.

    Each is the tool pose of a random configuration that is clear; poses that take another road are passed over.
    """
    from workcell.model.scene import robot_scene
    from workcell.world.planning_world import PlanningWorld

    world = PlanningWorld.of(robot_scene(robot))
    chain, rng = world.robot.robot, np.random.default_rng(seed)
    found: list[tuple[IKProblem, int]] = []
    for k in range(MOST * n):
        q = chain.random_configuration(rng)
        if world.clearance(q).distance <= _CLEAR:
            continue
        problem, start = world.problem(chain.fk(q)), problem_seed(seed, str(k))
        free = solve_ikspark(replace(problem, checker=None), BUDGET, start)
        if free.q is None or free.stats["restarts"] > 1 or world.clearance(free.q).distance >= 0.0:
            continue
        found.append((problem, start))
        if len(found) == n:
            break
    return found


def bench_ikspark_self(n: int, seed: int, robot: str) -> list[Row]:
    """The same poses and seeds: refused and tried again, and with the robot's own spheres apart."""
    problems = entangled(robot, n, seed)
    first, start = problems[0]
    solve_ikspark(first, BUDGET, start)  # makes the pairs of spheres, and imports what is imported lazily
    refused = _row(f"{robot}/self/refused", problems, apart=False)
    rows = _row(f"{robot}/self/apart", problems, apart=True)
    rows["ratio_to_refused"] = rows["cpu_ms_mean"] / refused["cpu_ms_mean"]
    return [refused, rows]


def _row(name: str, problems: Sequence[tuple[IKProblem, int]], *, apart: bool) -> Row:
    times, programs, ascents, solved = [], [], [], []
    for problem, start in problems:
        began = clock.cpu_seconds()
        candidate = solve_ikspark(problem, BUDGET, start, apart=apart)
        times.append(clock.cpu_seconds() - began)
        programs.append(candidate.stats["sdps"])
        ascents.append(candidate.stats["restarts"])
        solved.append(candidate.q is not None)
    return {
        "row": name,
        "n": len(problems),
        "success": float(np.mean(solved)),
        "programs_mean": float(np.mean(programs)),
        "programs_median": float(np.median(programs)),
        "programs_p90": float(np.percentile(programs, 90)),
        "ascents_mean": float(np.mean(ascents)),
        **cpu_columns(times),
        "paper": None,
    }


def _self(n: int, seed: int, sets: Path | None) -> list[Row]:
    return [row for robot in ROBOTS for row in bench_ikspark_self(n, seed, robot)]


BENCHES = (Bench("ikspark-self", 100, "IKSPARK on poses whose first answer hits the robot itself", _self),)
