"""How the tables about mechanisms put their questions to the solvers, and the columns that sum the answers up."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace
from typing import Any

import numpy as np

from workcell import clock
from workcell.bench.rows import Row
from workcell.errors import WorkcellError
from workcell.ik.ikspark.mechanisms.forms import FormName
from workcell.ik.mechanisms.problem import MechanismProblem, MechanismTolerances
from workcell.ik.mechanisms.result import MechanismResult
from workcell.ik.problem import Budget
from workcell.ik.result import Status
from workcell.ik.solve_mechanism import solve_mechanism
from workcell.sets.reports import cpu_columns
from workcell.sets.solving import problem_seed

TIGHT = MechanismTolerances(position=1e-6, rotation=1e-6)
"""What the tables ask of answers: a micrometre and a microradian, of ties as well."""


def answers(
    problems: Sequence[MechanismProblem],
    solver: str,
    budget: Budget,
    seed: int,
    form: FormName = "quaternion",
) -> list[MechanismResult]:
    """Results of a solver, after one unmeasured question that loads what is loaded lazily.

    CPU seconds (`cpu_s`) are of all that a question takes, building included.
    """
    solve_mechanism(problems[0], solver=solver, budget=replace(budget, cpu_s=0.2), form=form)
    return [
        answer(problem, solver, budget, problem_seed(seed, str(k)), form)
        for k, problem in enumerate(problems)
    ]


def answer(
    problem: MechanismProblem, solver: str, budget: Budget, seed: int, form: FormName = "quaternion"
) -> MechanismResult:
    """One result; a question that is refused is one that ends in SOLVER_ERROR, with the refusal's words."""
    began = clock.cpu_seconds()
    try:
        result = solve_mechanism(problem, solver=solver, budget=budget, seed=seed, form=form)
    except WorkcellError as error:
        result = MechanismResult(Status.SOLVER_ERROR, solver, rejected=(f"refused: {error}",))
    return replace(result, stats={**result.stats, "cpu_s": clock.cpu_seconds() - began})


def mechanism_row(
    name: str,
    results: Sequence[MechanismResult],
    *,
    paper: float | None = None,
    extra: Mapping[str, Any] | None = None,
) -> Row:
    """One row of a table about mechanisms.

    `success` is the share SOLVED, `proved` that of re-checked proofs that there is no answer. CPU times are over all
    questions, `cpu_ms_solved_mean` over those solved; so are errors, of which the worst is told. `programs_mean` counts
    cone programs of those solved, the last ones of high accuracy included, `off_rotations_max` is how far rotations
    are from SO(3) before the polish (Frobenius), `rank_gap_max` the largest trace less largest eigenvalue of a block,
    which no second eigenvalue exceeds. None: nothing was solved, or the solver has no such figure.
    """
    solved = [result for result in results if result.solved]
    measured = [result.measured for result in solved if result.measured is not None]
    return {
        "row": name,
        "n": len(results),
        "success": share(result.solved for result in results),
        "proved": share(result.status.is_proof for result in results),
        "errors": sum(result.status is Status.SOLVER_ERROR for result in results),
        **cpu_columns([float(result.stats["cpu_s"]) for result in results]),
        "cpu_ms_solved_mean": mean([1e3 * float(result.stats["cpu_s"]) for result in solved]),
        "programs_mean": mean([value for r in solved if (value := counted(r, "sdps")) is not None]),
        "position_error_max": worst([m.position_error for m in measured]),
        "rotation_error_max": worst([m.rotation_error for m in measured]),
        "closure_error_max": worst([m.closure_error for m in measured]),
        "off_rotations_max": worst([v for r in solved if (v := counted(r, "off_rotations")) is not None]),
        "rank_gap_max": worst([v for r in solved if (v := counted(r, "rank_gap")) is not None]),
        "paper": paper,
        **(extra or {}),
    }


def counted(result: MechanismResult, count: str) -> float | None:
    """What IKSPARK counted under a name, where the answer is its own; else None."""
    return None if not result.solver.startswith("ikspark") else result.stats.get(f"ikspark.{count}")


def share(values: Any) -> float | None:
    """The share of what is true; None of nothing."""
    found = [bool(value) for value in values]
    return float(np.mean(found)) if found else None


def mean(values: Sequence[float]) -> float | None:
    """None of nothing."""
    return float(np.mean(values)) if len(values) else None


def worst(values: Sequence[float]) -> float | None:
    """The largest; None of nothing."""
    return float(np.max(values)) if len(values) else None
