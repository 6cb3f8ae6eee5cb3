"""What the benches' tables are made of: a bench, a row of one, and the answers that a row sums up."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from workcell.ik.problem import Budget
from workcell.ik.result import IKResult, Status
from workcell.ik.solve import solve
from workcell.sets.problems import ProblemSet
from workcell.sets.reports import cpu_columns
from workcell.sets.solving import problem_seed

Row = dict[str, Any]

BenchFunction = Callable[..., list[Row]]
"""Takes n problems a row, the seed and the folder of problem sets; returns rows as `row_of` makes them. One that
`repeats` also takes the numbers of seeds and of processes."""


@dataclass(frozen=True, slots=True)
class Bench:
    """A bench: its name, its own number of problems a row, what it measures, and the function that does.

    Also whether that can run several seeds, and in several processes.
    """

    name: str
    n: int
    description: str
    run: BenchFunction
    repeats: bool = False


def row_of(
    name: str,
    results: Sequence[IKResult],
    *,
    paper: float | None = None,
    extra: Mapping[str, Any] | None = None,
) -> Row:
    """One row of a bench.

    `success` counts problems that ended SOLVED at our tolerances (1e-4 m, 1e-3 rad, no penetration); what passes them
    passes the papers' looser ones (1e-2 m, 1e-2 rad), and nothing that fails them is kept. `decided` counts proofs as
    well.

    Args:
        name: `<robot>/<environment>/<method>`.
        results: of the row's problems.
        paper: the published success rate, where there is one.
        extra: more columns.
    """
    solved = np.array([result.solved for result in results])
    proved = np.array([result.status.is_proof for result in results])
    return {
        "row": name,
        "n": len(results),
        "success": float(solved.mean()),
        "success_paper_tolerance": float(solved.mean()),
        "decided": float((solved | proved).mean()),
        "errors": sum(result.status is Status.SOLVER_ERROR for result in results),
        **cpu_columns([float(result.stats["cpu_s"]) for result in results]),
        "paper": paper,
        **(extra or {}),
    }


def solve_all(problem_set: ProblemSet, solver: str, budget: Budget, seed: int, n: int) -> list[IKResult]:
    """Results of the first `n` problems of a set, after one unmeasured problem that loads what is loaded lazily."""
    named = problem_set.problems[:n]
    solve(named[0].problem, solver, Budget(min(budget.cpu_s, 0.2)), seed)
    return [solve(item.problem, solver, budget, problem_seed(seed, item.id)) for item in named]
