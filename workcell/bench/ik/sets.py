"""Benches of the solvers on problem sets: files in a folder, or generated ones for workcell's own robots."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

from workcell.bench.reference.generate import generate
from workcell.bench.reference.robots import ROBOTS, bench_robot
from workcell.bench.rows import Bench, Row, row_of, solve_all
from workcell.errors import InputError
from workcell.ik.problem import Budget
from workcell.sets.problems import ProblemSet, load_problem_set
from workcell.sets.workers import run_lines

BUDGET = Budget(1.0)
"""CPU seconds a problem."""
SOLVERS = ("auto", "multistart")
KINDS = ("free", "random", "workcell")


def _set_files(sets: Path | None) -> list[Path]:
    if sets is None or not sets.is_dir():
        raise InputError(
            "this bench needs a folder of problem sets" if sets is None else f"{sets} is not a folder",
            where="sets",
            remedy="--sets DIR with files <robot>_<set>.json of format workcell-ikset/1",
        )
    files = sorted(file for file in sets.glob("*.json") if not file.name.endswith(".answers.json"))
    if not files:
        raise InputError("the folder has no problem set", where=sets, remedy="files <robot>_<set>.json")
    return files


@dataclass(frozen=True, slots=True)
class _FileRows:
    """The rows of set files, for several processes: a line is one file, solved by one solver with one seed."""

    runs: tuple[tuple[Path, str, int], ...]
    n: int

    def __len__(self) -> int:
        return len(self.runs)

    def line(self, index: int) -> Row:
        """One row; none of a file without problems."""
        file, solver, seed = self.runs[index]
        return {"rows": _rows(load_problem_set(file), (solver,), self.n, seed)}


def _file_rows(n: int, seed: int, sets: Path | None, seeds: int = 1, jobs: int = 1) -> list[Row]:
    """Two rows a file.

    Of several seeds the smallest rates and the largest times are reported; the baseline, which spends its
    whole budget on everything that is impossible, runs once.
    """
    for file in (files := _set_files(sets)):
        load_problem_set(file)  # what is wrong in one is said before hours of work
    turns = {"auto": range(seed, seed + seeds), "multistart": range(seed, seed + 1)}
    runs = tuple((file, solver, each) for file in files for solver in SOLVERS for each in turns[solver])
    made: dict[tuple[Path, str], list[Row]] = {}
    for run, line in zip(runs, run_lines(_FileRows(runs, n), jobs), strict=True):
        made.setdefault(run[:2], []).extend(line["rows"])
    return [worst_row(rows) for rows in made.values() if rows]


def worst_row(rows: Sequence[Row]) -> Row:
    """Of rows of the same problems with different seeds: smallest rates, largest times; more than one says how many."""
    worst = dict(rows[0])
    if len(rows) == 1:
        return worst
    for key in ("success", "success_paper_tolerance", "decided"):
        worst[key] = min(row[key] for row in rows)
    for key in ("errors", "cpu_ms_mean", "cpu_ms_median", "cpu_ms_p95", "cpu_ms_max"):
        worst[key] = max(row[key] for row in rows)
    return {**worst, "seeds": len(rows)}


def _rows(problem_set: ProblemSet, solvers: Sequence[str], n: int, seed: int) -> list[Row]:
    if not problem_set.problems:
        return []
    label = f"{problem_set.robot.name}/{problem_set.name}"
    rows = []
    for solver in solvers:
        results = solve_all(problem_set, solver, BUDGET, seed, n)
        slowest = 1e3 * max(float(result.stats["cpu_s"]) for result in results)
        rows.append(row_of(f"{label}/{solver}", results, extra={"cpu_ms_max": slowest}))
    return rows


def _multistart(n: int, seed: int, sets: Path | None) -> list[Row]:
    rows = []
    for name in ROBOTS:
        robot, cover = bench_robot(name)
        for kind in KINDS:
            rows += _rows(generate(robot, cover, kind, n, seed), ("multistart",), n, seed)
    return rows


def _impossible(n: int, seed: int, sets: Path | None) -> list[Row]:
    rows = []
    for name in ROBOTS:
        robot, cover = bench_robot(name)
        rows += _rows(generate(robot, cover, "unreachable", n, seed), ("auto",), n, seed)
    return rows


BENCHES = (
    Bench(
        "sets",
        100,
        "problem-set files (--sets DIR): auto and multistart, 1 s CPU a problem; of --seeds N the worst",
        _file_rows,
        repeats=True,
    ),
    Bench(
        "multistart", 100, "generated sets: multi-start Levenberg-Marquardt, the honest baseline", _multistart
    ),
    Bench("impossible", 100, "generated targets out of reach or blocked: what auto proves", _impossible),
)
