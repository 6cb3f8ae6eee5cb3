"""The benches by name: a paper's table, or our own, measured again."""

from __future__ import annotations

import importlib
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from workcell.bench.problems import ProblemSet
from workcell.bench.reports import cpu_columns
from workcell.bench.runner import problem_seed
from workcell.errors import InputError, UnknownNameError
from workcell.ik.problem import Budget
from workcell.ik.result import IKResult, Status
from workcell.ik.solve import solve

Row = dict[str, Any]
BenchFunction = Callable[..., list[Row]]
"""Takes n problems a row, the seed and the folder of problem sets; returns rows as `row_of` makes them. One that `repeats`
also takes the numbers of seeds and of processes."""

_PROVIDERS = (
    "workcell.bench.sets",
    "workcell.bench.ikspark",
    "workcell.bench.cidgik",
    "workcell.bench.cidgik_scaling",
    "workcell.bench.cidgik_supplement",
    "workcell.bench.hjcd",
    "workcell.bench.hjcd_mmd",
    "workcell.bench.branch",
    "workcell.bench.plan",
    "workcell.bench.plan_optimal",
    "workcell.bench.retime",
    "workcell.bench.tasks",
    "workcell.bench.follow",
    "workcell.bench.clearance",
    "workcell.bench.covers",
    "workcell.bench.free_space",
)


@dataclass(frozen=True, slots=True)
class Bench:
    """A bench: its name, its own number of problems a row, what it measures, the function that does, and whether that can
    run several seeds, and in several processes."""

    name: str
    n: int
    description: str
    run: BenchFunction
    repeats: bool = False


def list_benches() -> tuple[Bench, ...]:
    """All benches, by name."""
    found: list[Bench] = []
    for provider in _PROVIDERS:
        found += importlib.import_module(provider).BENCHES
    return tuple(sorted(found, key=lambda bench: bench.name))


def run_bench(
    name: str,
    *,
    n: int | None = None,
    seed: int = 0,
    sets: Path | None = None,
    seeds: int = 1,
    jobs: int = 1,
) -> Row:
    """Measure a bench.

    Args:
        name: as `list_benches` names it.
        n: problems a row; None: the bench's own.
        seed: of problems and solvers.
        sets: folder of problem-set files, for the benches that need one.
        seeds: runs with as many seeds from `seed` on, of which the worst is reported; where the bench can.
        jobs: processes, where the bench can.

    Returns:
        `{"bench", "n", "seed", "rows"}`, ready for JSON.

    Raises:
        UnknownNameError: no such bench. InputError: `n`, `seeds` or `jobs` below 1, or more than the bench can; a folder is
            missing.
    """
    benches = {bench.name: bench for bench in list_benches()}
    if name not in benches:
        raise UnknownNameError("bench", name, benches, where="bench")
    bench = benches[name]
    count = bench.n if n is None else n
    if count < 1:
        raise InputError(f"{count} problems a row make no table", where="n", remedy="at least 1")
    if min(seeds, jobs) < 1:
        raise InputError(
            f"{seeds} seeds in {jobs} processes make no table", where="seeds", remedy="at least 1"
        )
    if bench.repeats:
        rows = bench.run(count, seed, sets, seeds, jobs)
    elif max(seeds, jobs) == 1:
        rows = bench.run(count, seed, sets)
    else:
        able = ", ".join(entry.name for entry in benches.values() if entry.repeats)
        raise InputError(f"{name} runs once, in one process", where="bench", remedy=f"several: {able}")
    return {"bench": name, "n": count, "seed": seed, "rows": rows}


def row_of(
    name: str,
    results: Sequence[IKResult],
    *,
    paper: float | None = None,
    extra: Mapping[str, Any] | None = None,
) -> Row:
    """One row of a bench.

    `success` counts problems that ended SOLVED at our tolerances (1e-4 m, 1e-3 rad, no penetration); what passes them
    passes the papers' looser ones (1e-2 m, 1e-2 rad), and nothing that fails them is kept. `decided` counts proofs as well.

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
