"""How the tables put their cells to the solvers, and the columns that sum the answers up."""

from __future__ import annotations

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
UNMEASURED = 1
"""Cells solved before the clock starts: they import and compile what is loaded lazily."""
RECIPE = "the paper's recipe"
UNPRUNED = f"{RECIPE}, every pair kept"
ALONE = "ikspark in cuboids alone"
_GROWING = "cuboids grown"
"""The stage in which the solver adds regions."""
_BUILDERS = {"ikspark.sdps", "ikspark+lm.sdps"}
"""Counts by which a result is one of IKSPARK's."""


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


def _answer(problem: IKProblem, method: str, seed: int) -> IKResult:
    if method in (RECIPE, UNPRUNED):
        return solve_by_recipe(problem, seed, pruned=method == RECIPE)
    return _in_cuboids_alone(problem, seed) if method == ALONE else solve(problem, method, BUDGET, seed)


def _in_cuboids_alone(problem: IKProblem, seed: int) -> IKResult:
    """What the solver finds with every sphere in a region of free space, and nothing else to fall back on."""
    prepare(problem)
    began = clock.cpu_seconds()
    candidate = solve_ikspark(problem, BUDGET, seed, fallback=False)
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
        stages=candidate.stages,
        cuboids=candidate.cuboids,
        free_space=candidate.free_space,
    )


def cell_row(name: str, results: Sequence[IKResult], paper: Paper | None = None) -> Row:
    """A row of Table VI; means are over all cells, errors over those solved. None: the method has no such figure.

    `in_cuboids` is the share answered with every sphere in a region of free space, `in_given` in one of those that the
    problem brings, `cuboids` how many regions those cells have. The recipe builds before it solves; what the solver
    spends on regions as it goes along is its building.
    """
    build, cuboids = [_building(result) for result in results], [_regions(result) for result in results]
    spent = [float(result.stats["cpu_s"]) for result in results]
    solved = [result for result in results if result.solved]
    published = paper or Paper()
    columns = {
        "built": _mean([_counted(result, "built") for result in results]),
        "in_cuboids": None if None in build else float(np.mean([_is_in_cuboids(r) for r in results])),
        "in_given": _mean([_counted(result, "in_given") or 0.0 for result in results]) or None,
        "cuboids": _mean(cuboids),
        "programs": _mean([_counted(result, "sdps") for result in results]),
        "build_ms": _mean([None if b is None else 1e3 * b for b in build]),
        "solve_ms": _mean([1e3 * (s - (b or 0.0)) for s, b in zip(spent, build, strict=True)]),
        "position_error_m": _mean([result.position_error for result in solved]),
        "rotation_error_rad": _mean([result.rotation_error for result in solved]),
        "paper_solve_s": published.solve_s,
        "paper_built": published.built,
        "paper_build_s": published.build_s,
    }
    return row_of(name, results, paper=published.solved, extra=columns)


def _mean(values: Sequence[float | None]) -> float | None:
    """Of those that are known; None where none is."""
    known = [value for value in values if value is not None]
    return float(np.mean(known)) if known else None


def _counted(result: IKResult, count: str) -> float | None:
    """What a solver counted under a name, added up over those that took part; None where none did."""
    told = [value for name, value in result.stats.items() if name.endswith(f".{count}")]
    return sum(told) if told else None


def _is_in_cuboids(result: IKResult) -> bool:
    return result.solved and result.cuboids is not None


def _regions(result: IKResult) -> float | None:
    """Cuboids and polytopes of a cell; None where it was not answered among such."""
    space = result.free_space
    return None if space is None else float(len(space) + len(space.polytopes))


def _building(result: IKResult) -> float | None:
    """CPU seconds that went into regions of free space; None of a method that has none."""
    if result.stats.keys().isdisjoint(_BUILDERS):
        return None
    told = _counted(result, "build_cpu_s")
    return sum(stage.cpu_s for stage in result.stages if stage.name == _GROWING) if told is None else told
