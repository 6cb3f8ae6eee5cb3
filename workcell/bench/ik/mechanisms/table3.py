"""Table III of IKSPARK: goals of Baxter's closed chain, both forms, multi-start and the portfolio beside them.

The paper's success is of the goals that its relaxation has not certified to be out of reach. More of them are: the
solvers of serial chains decide each arm by itself. So there are three denominators: all goals, those not certified,
and those that both arms reach.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from types import MappingProxyType

import numpy as np

from workcell.bench.ik.mechanisms.answers import answers, counted, mean, mechanism_row, share
from workcell.bench.ik.mechanisms.baxter import FARTHER, goal_poses, problems_of, reachable
from workcell.bench.rows import Bench, Row
from workcell.ik.ikspark.mechanisms.forms import FormName
from workcell.ik.ikspark.mechanisms.parts import Parts
from workcell.ik.ikspark.mechanisms.relaxation import Relaxation
from workcell.ik.mechanisms.check import check_mechanism
from workcell.ik.mechanisms.problem import MechanismProblem
from workcell.ik.mechanisms.result import MechanismResult
from workcell.ik.problem import Budget

BUDGET = Budget(1.0)
"""CPU seconds a goal, building included, of every method."""
RESTARTS = (0, 1, 3, 10)
"""Ascents beyond the first of every part, by which successes are counted."""
METHODS: tuple[tuple[str, str, FormName], ...] = (
    ("quaternion", "ikspark", "quaternion"),
    ("rotation", "ikspark", "rotation"),
    ("multistart", "multistart", "quaternion"),
    ("auto", "auto", "quaternion"),
)
"""Name of the row, solver, form."""


@dataclass(frozen=True, slots=True)
class Paper:
    """Published: shares of those not certified without and with ten restarts, seconds, iterations, the last columns."""

    first: float
    success: float
    solve_s: float
    programs: float | None = None
    rotation: float | None = None
    translation: float | None = None
    off_rotations: float | None = None
    second_eigenvalue: float | None = None


PAPER: Mapping[str, Paper] = MappingProxyType(
    {
        "quaternion": Paper(0.886, 0.928, 0.2889, 3.64, 1.5e-16, 6.8e-9, 2.1e-5, 1.6e-8),
        "rotation": Paper(0.872, 0.923, 0.6399, 7.67, 1.7e-17, 2.7e-8, 9.0e-6, 2.2e-6),
        "multistart": Paper(0.900, 0.900, 0.1966, None, 1.3e-8, 5.9e-9),
    }
)
"""Beside multi-start stands the paper's local solver, BFGS on each arm from zero angles."""
PAPER_CERTIFIED = 69 / 500


def table3(n: int, seed: int, sets: Path | None = None) -> list[Row]:
    """A row for each method on n goals, and one of the same goals 2 m farther away, all of which are to be proved."""
    poses = goal_poses(n, seed)
    reached, problems = reachable(poses, seed), problems_of(poses)
    first = _ascents_of_one_start(problems[0])
    rows = [
        _row(
            name,
            answers(problems, solver, BUDGET, seed, form),
            reached,
            first if solver == "ikspark" else None,
        )
        for name, solver, form in METHODS
    ]
    away = problems_of(goal_poses(n, seed, farther=FARTHER))
    return [*rows, _farther(away, answers(away, "ikspark", BUDGET, seed))]


def _ascents_of_one_start(problem: MechanismProblem) -> int:
    """One for each part."""
    return len(Parts.of(Relaxation.of(problem), None).parts)


def _row(
    name: str, results: Sequence[MechanismResult], reached: Sequence[bool | None], ascents: int | None
) -> Row:
    """A method's row; `contradictions` counts goals where it and the solvers of serial chains disagree.

    `ascents`: how many there are before the first restart; None: restarts are not counted.
    """
    proved = [result.status.is_proof for result in results]
    paper = PAPER.get(name)
    both = list(zip(results, reached, strict=True))
    restarts = [
        (count - ascents, result.solved)
        for result in results
        if ascents is not None and (count := counted(result, "restarts")) is not None
    ]
    extra = {
        "success_not_certified": share(r.solved for r, p in zip(results, proved, strict=True) if not p),
        "success_reachable": share(r.solved for r, yes in both if yes),
        "reachable": share(yes is True for yes in reached),
        "out_of_reach": share(yes is False for yes in reached),
        "contradictions": sum(
            (r.solved and yes is False) or (r.status.is_proof and yes is True) for r, yes in both
        ),
        "solved_by_restarts": {
            str(most): sum(solved and extra <= most for extra, solved in restarts) for most in RESTARTS
        }
        if restarts
        else None,
        "restarts_mean": mean([extra for extra, solved in restarts if solved]),
    }
    published = {
        "paper_first": paper.first if paper else None,
        "paper_certified": PAPER_CERTIFIED if name in ("quaternion", "rotation") else None,
        "paper_solve_s": paper.solve_s if paper else None,
        "paper_programs": paper.programs if paper else None,
        "paper_err_R": paper.rotation if paper else None,
        "paper_err_T": paper.translation if paper else None,
        "paper_off_rotations": paper.off_rotations if paper else None,
        "paper_second_eigenvalue": paper.second_eigenvalue if paper else None,
    }
    return mechanism_row(
        f"baxter/{name}", results, paper=paper.success if paper else None, extra={**extra, **published}
    )


def _farther(problems: Sequence[MechanismProblem], results: Sequence[MechanismResult]) -> Row:
    """The goals that are out of reach: how many are proved, each proof checked once more from the problem alone."""
    checked = [
        result.certificate is not None and check_mechanism(problem, result.certificate) is None
        for problem, result in zip(problems, results, strict=True)
    ]
    margins = [result.certificate.margin for result in results if result.certificate is not None]
    extra = {"checked": int(np.sum(checked)), "margin_min": min(margins, default=None), "paper_proved": 1.0}
    return mechanism_row(f"baxter/{FARTHER:g} m farther", results, extra=extra)


BENCHES = (
    Bench(
        "ikspark-table3",
        500,
        "Baxter's closed chain at random goals, and at goals out of reach (IKSPARK, Table III)",
        table3,
    ),
)
