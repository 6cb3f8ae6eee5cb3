"""Bench of IKSPARK's restarts: at the ends of random directions, and by line search (the paper's Algorithm 2)."""

from __future__ import annotations

from pathlib import Path
from typing import get_args

import numpy as np

from workcell import clock
from workcell.bench.ik.ikspark import reachable_problems
from workcell.bench.rows import Bench, Row
from workcell.ik.ikspark.solver import Restart, solve_ikspark
from workcell.ik.problem import Budget
from workcell.sets.reports import cpu_columns
from workcell.sets.solving import problem_seed

BUDGET = Budget(20.0, effort=1.0)
"""Work ends a query: 300 cone programs."""
ROBOTS = ("sawyer", "ur10", "iiwa14")
PAPER = 10
"""Restarts at most, in the paper (section X-A)."""


def bench_restarts(n: int, seed: int, robot: str) -> list[Row]:
    """Random reachable poses without obstacles, the same and with the same first ascents for both kinds."""
    problems = reachable_problems(robot, n, seed)
    rows: list[Row] = []
    for restart in get_args(Restart):
        solve_ikspark(problems[0], BUDGET, 0, restart=restart)  # imports what is imported lazily
        times, found = [], []
        for k, problem in enumerate(problems):
            began = clock.cpu_seconds()
            found.append(solve_ikspark(problem, BUDGET, problem_seed(seed, str(k)), restart=restart))
            times.append(clock.cpu_seconds() - began)
        solved = np.array([candidate.q is not None for candidate in found])
        ascents = np.array([candidate.stats["restarts"] for candidate in found])
        programs = np.array([candidate.stats["sdps"] for candidate in found])
        again = ascents > 1
        rows.append(
            {
                "row": f"{robot}/free/{restart}",
                "n": n,
                "success": float(np.mean(solved & (ascents <= 1 + PAPER))),
                "success_in_300_programs": float(np.mean(solved)),
                "first_ascent": float(np.mean(solved & ~again)),
                "programs_mean": float(programs.mean()),
                "programs_mean_restarted": float(programs[again].mean()) if again.any() else None,
                "ascents_mean_restarted": float(ascents[again].mean()) if again.any() else None,
                **cpu_columns(times),
                "paper": None,
            }
        )
    return rows


def _restarts(n: int, seed: int, sets: Path | None) -> list[Row]:
    return [row for robot in ROBOTS for row in bench_restarts(n, seed, robot)]


BENCHES = (
    Bench("ikspark-restarts", 200, "restarts of IKSPARK: random directions against line search", _restarts),
)
