"""How the tables put their cells to the solvers, and the columns that sum the answers up."""

from __future__ import annotations

import inspect
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from workcell import clock
from workcell.bench.ik.ikspark_tables.cells import Cell
from workcell.bench.ik.ikspark_tables.recipe import solve_by_recipe
from workcell.bench.rows import Row, row_of
from workcell.ik.ikspark.solver import solve_ikspark
from workcell.ik.judge.verify import Verification, verify
from workcell.ik.problem import Budget, IKProblem
from workcell.ik.result import IKResult, Status
from workcell.ik.shared.convex import prepare
from workcell.ik.solve import solve
from workcell.sets.solving import problem_seed

BUDGET = Budget(1.0)
"""CPU seconds a cell, building included."""
UNMEASURED = 2
"""Cells solved before the clock starts: they import and compile what is loaded lazily."""
RECIPE = "the paper's recipe"
UNPRUNED = f"{RECIPE}, every pair kept"
ALONE = "ikspark in cuboids alone"


@dataclass(frozen=True, slots=True)
class Paper:
    """Published figures of a row: shares solved and built, and seconds of solving and building; None: there is none."""

    solved: float | None = None
    solve_s: float | None = None
    built: float | None = None
    build_s: float | None = None


def answers(cells: Sequence[Cell], method: str, seed: int) -> list[IKResult]:
    """Results of a method: a solver's name, or one of the above; each is a judged configuration, or none."""
    for cell in cells[:UNMEASURED]:
        _answer(cell.problem, method, seed)
    return [_answer(cell.problem, method, problem_seed(seed, str(k))) for k, cell in enumerate(cells)]


def is_known(method: str) -> bool:
    """Whether the solver can be told to work as the method does."""
    return method != ALONE or "fallback" in inspect.signature(solve_ikspark).parameters


def _answer(problem: IKProblem, method: str, seed: int) -> IKResult:
    if method in (RECIPE, UNPRUNED):
        return solve_by_recipe(problem, seed, pruned=method == RECIPE)
    return _in_cuboids_alone(problem, seed) if method == ALONE else solve(problem, method, BUDGET, seed)


def _in_cuboids_alone(problem: IKProblem, seed: int) -> IKResult:
    """What the solver finds with every sphere in a region of free space, and nothing else to fall back on."""
    prepare(problem)
    began, options = clock.cpu_seconds(), {"fallback": False}
    candidate = solve_ikspark(problem, BUDGET, seed, **options)
    verdict = verify(problem, candidate.q) if candidate.q is not None else Verification()
    stats = {f"ikspark.{name}": float(value) for name, value in candidate.stats.items()}
    return IKResult(
        Status.SOLVED if verdict.accepted else Status.NOT_FOUND,
        "ikspark",
        q=candidate.q if verdict.accepted else None,
        position_error=verdict.position_error,
        rotation_error=verdict.rotation_error,
        clearance=verdict.clearance,
        stats={**stats, "cpu_s": clock.cpu_seconds() - began},
        rejected=(*candidate.rejected, *verdict.reasons),
        cuboids=candidate.cuboids,
        free_space=candidate.free_space,
    )


def cell_row(name: str, results: Sequence[IKResult], paper: Paper | None = None) -> Row:
    """A row of Table VI; means are over all cells, errors over those solved. None: the method has no such figure."""
    build = _mean(results, "build_cpu_s")
    whole = float(np.mean([result.stats["cpu_s"] for result in results]))
    solved = [result for result in results if result.solved]
    published = paper or Paper()
    columns = {
        "built": _mean(results, "built"),
        "cuboids": _mean(results, "cuboids"),
        "programs": _mean(results, "sdps"),
        "build_ms": None if build is None else 1e3 * build,
        "solve_ms": 1e3 * (whole - (build or 0.0)),
        "position_error_m": float(np.mean([result.position_error for result in solved])) if solved else None,
        "rotation_error_rad": float(np.mean([result.rotation_error for result in solved]))
        if solved
        else None,
        "paper_solve_s": published.solve_s,
        "paper_built": published.built,
        "paper_build_s": published.build_s,
    }
    return row_of(name, results, paper=published.solved, extra=columns)


def _mean(results: Sequence[IKResult], count: str) -> float | None:
    """The mean of what the solvers counted under a name; None where none did."""
    told = [
        sum(value for name, value in result.stats.items() if name.endswith(f".{count}"))
        for result in results
        if any(name.endswith(f".{count}") for name in result.stats)
    ]
    return float(np.mean(told)) if told else None
