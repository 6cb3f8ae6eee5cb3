"""Arms that are nearly special: poses that they reach, by every solver; and the boxes that prove solutions."""

from __future__ import annotations

import time
from collections.abc import Callable
from pathlib import Path

import numpy as np

from workcell.bench.reference.nearly import nearly_arm, planted, written_arm
from workcell.bench.rows import Bench, Row, row_of
from workcell.errors import InputError
from workcell.ik.cidgik.solver import prove_cidgik
from workcell.ik.problem import Budget, IKProblem
from workcell.ik.registry import solver_names
from workcell.ik.solution.issue import certify_solution
from workcell.ik.solve import solve
from workcell.model.robot import Robot
from workcell.pose import Array

_BANDS = (0.0, 1e-8, 1e-7, 1e-6, 1e-5, 1e-4, 1e-3, 1e-2, np.inf)
_MAKERS: dict[str, Callable[[np.random.Generator], Robot]] = {"nearly": nearly_arm, "written": written_arm}


def nearly_rows(n: int, seed: int, sets: Path | None = None) -> list[Row]:
    """A row for each solver and kind of arm: `false_no` counts poses that it proved impossible, all of them reached."""
    del sets
    rows = []
    for kind, make in _MAKERS.items():
        for solver in (name for name in solver_names() if not name.endswith("+lm")):
            rng = np.random.default_rng(seed)
            problems = [planted(make(rng), rng)[0] for _ in range(n)]
            results, refused = [], 0
            for k, problem in enumerate(problems):
                try:
                    results.append(solve(problem, solver, Budget(2.0), seed + k))
                except InputError:
                    refused += 1
            wrong = sum(result.status.is_proof for result in results)
            if solver == "cidgik":
                wrong += sum(_proved_alone(problem) for problem in problems)
            extra = {"false_no": wrong, "refused": refused}
            rows.append(row_of(f"{kind}/free/{solver}", results, extra=extra))
    return rows


def _proved_alone(problem: IKProblem) -> bool:
    """Whether one relaxation alone says that a pose can't be reached."""
    try:
        return prove_cidgik(problem) is not None
    except InputError:
        return False


def solution_rows(n: int, seed: int, sets: Path | None = None) -> list[Row]:
    """A row for each band of the Jacobian's least singular value: how many solutions get a box, and one in it.

    Configurations are off their targets by up to 1e-8 rad in each joint.
    """
    del sets
    rng = np.random.default_rng(seed)
    found: list[list[tuple[bool, bool, float]]] = [[] for _ in _BANDS[1:]]
    while sum(map(len, found)) < n:
        robot = nearly_arm(rng)
        q = _towards_singular(0.9 * robot.random_configuration(rng), rng)
        sizes = np.linalg.svd(robot.jacobian(q), compute_uv=False)
        problem = IKProblem(robot, robot.fk(q))
        near = q + 1e-8 * rng.uniform(-1.0, 1.0, robot.dof)
        started = time.process_time()
        box = certify_solution(problem, near)
        spent = time.process_time() - started
        band = int(np.searchsorted(_BANDS, sizes[min(5, len(sizes) - 1)], side="right")) - 1
        found[band].append((box is not None, box is not None and len(box.data["joints"]) == 6, spent))
    return [
        {
            "row": f"least singular value {low:g} to {high:g}",
            "n": len(rows),
            "certified": float(np.mean([row[0] for row in rows])),
            "solution_shown": float(np.mean([row[1] for row in rows])),
            "cpu_ms_median": 1e3 * float(np.median([row[2] for row in rows])),
        }
        for low, high, rows in zip(_BANDS, _BANDS[1:], found, strict=False)
        if rows
    ]


def _towards_singular(q: Array, rng: np.random.Generator) -> Array:
    """Half of the time some joints are brought near zero, where the axes of such arms line up."""
    if rng.random() < 0.5:
        return q
    shrunk: Array = np.where(rng.random(len(q)) < 0.5, q * 10.0 ** rng.uniform(-8.0, 0.0), q)
    return shrunk


BENCHES = (
    Bench("nearly", 50, "arms with nearly parallel and nearly meeting axes, by every solver", nearly_rows),
    Bench("solutions", 2000, "boxes that prove solutions, by distance from singularities", solution_rows),
)
