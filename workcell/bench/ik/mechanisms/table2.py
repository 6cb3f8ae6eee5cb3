"""Table II of IKSPARK: sizes of Baxter's closed chain in both forms, and errors of answers before the polish."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from types import MappingProxyType
from typing import Any, get_args

import numpy as np

from workcell.bench.ik.mechanisms.answers import worst
from workcell.bench.ik.mechanisms.baxter import BAR, goal_poses, problems_of
from workcell.bench.rows import Bench, Row
from workcell.ik.ikspark.mechanisms.blocks import linearise
from workcell.ik.ikspark.mechanisms.directions import Directions
from workcell.ik.ikspark.mechanisms.forms import FormName
from workcell.ik.ikspark.mechanisms.parts import Part, Parts
from workcell.ik.ikspark.mechanisms.plain.relaxation import plain_relaxation
from workcell.ik.ikspark.mechanisms.rank import ascend
from workcell.ik.ikspark.mechanisms.reading import off_rotations, read
from workcell.ik.ikspark.mechanisms.relaxation import Relaxation
from workcell.ik.ikspark.rank import RANK_GAP
from workcell.ik.mechanisms.problem import MechanismProblem
from workcell.model.mechanism.placing import missed, place
from workcell.pose import Array

FORMS: tuple[FormName, ...] = get_args(FormName)
STARTS = 40
"""Ascents of a part at most, before an example is given up."""
TIGHT = 1e-10
"""Clarabel's tolerance for the last point, as the solver has it."""


@dataclass(frozen=True, slots=True)
class Paper:
    """Rows and errors in Table II."""

    equalities: int
    inequalities: int
    rotation: float
    translation: float


PAPER: Mapping[FormName, Paper] = MappingProxyType(
    {
        "rotation": Paper(137, 6112, 0.0, 3.87e-9),
        "quaternion": Paper(92, 6112, 1.62e-16, 9.60e-9),
    }
)


def table2(n: int, seed: int, sets: Path | None = None) -> list[Row]:
    """For each form the sizes as the paper has it and as we solve it, and the worst errors of n answers."""
    problems = problems_of(goal_poses(20 * n, seed))
    rows = []
    for form in FORMS:
        rows += [_unreduced(problems[0], form), _reduced(problems[0], form)]
        rows.append(_examples(problems, form, n, seed))
    return rows


def _unreduced(problem: MechanismProblem, form: FormName) -> Row:
    """One block a link, nothing put in, and cones for the paper's tangent half-spaces."""
    import cvxpy as cp

    question, _ = plain_relaxation(problem, form)
    equalities = cones = inequalities = blocks = 0
    for row in question.constraints:
        if isinstance(row, cp.constraints.PSD):
            blocks += 1
        elif isinstance(row, cp.constraints.Equality | cp.constraints.Zero):
            equalities += row.size
        elif row.expr.is_affine():
            inequalities += row.size
        else:
            cones += 1
    variables = sum(_free_numbers(variable) for variable in question.variables())
    return _sizes(f"{form}/every link a block", form, variables, equalities, inequalities, cones, blocks)


def _free_numbers(variable: Any) -> int:
    rows = variable.shape[0] if variable.is_symmetric() and variable.ndim == 2 else 0
    return rows * (rows + 1) // 2 if rows else int(variable.size)


def _reduced(problem: MechanismProblem, form: FormName) -> Row:
    """What is solved: links that hang on known ones as discs, known ones put in, part by part."""
    relaxation = Relaxation.of(problem, form)
    parts = Parts.of(relaxation, None)
    A = np.vstack([one.rows for one in relaxation.rows if one.cone == "zero"])
    count = {cone: [r for r in relaxation.rows if r.cone == cone] for cone in ("nonneg", "soc", "psd")}
    row = _sizes(
        f"{form}/as it is solved",
        form,
        relaxation.lift.size,
        int(np.linalg.matrix_rank(A[:, :-1])),
        sum(len(one.rows) for one in count["nonneg"]),
        len(count["soc"]),
        len(count["psd"]),
    )
    return {**row, "parts": [len(part.columns) for part in parts.parts]}


def _sizes(
    name: str, form: FormName, variables: int, equalities: int, inequalities: int, cones: int, blocks: int
) -> Row:
    return {
        "row": f"baxter/{name}",
        "n": 1,
        "variables": variables,
        "equalities": equalities,
        "inequalities": inequalities,
        "second_order_cones": cones,
        "blocks": blocks,
        "parts": None,
        "paper": None,
        "paper_equalities": PAPER[form].equalities,
        "paper_inequalities": PAPER[form].inequalities,
    }


def _examples(problems: list[MechanismProblem], form: FormName, n: int, seed: int) -> Row:
    """Errors of the first n questions of a list that are answered, before the polish."""
    found: list[tuple[float, ...]] = []
    for problem in problems:
        relaxation = Relaxation.of(problem, form)
        x = rank_one_point(relaxation, seed)
        if x is not None:
            found.append(_errors(relaxation, x))
        if len(found) == n:
            break
    columns = list(zip(*found, strict=True)) or [()] * 5
    names = ("err_R", "err_T", "off_rotations", "rank_gap", "loop_residual")
    return {
        "row": f"baxter/{form}/answers before the polish",
        "n": len(found),
        **{name: worst(column) for name, column in zip(names, columns, strict=True)},
        "paper": None,
        "paper_err_R": PAPER[form].rotation,
        "paper_err_T": PAPER[form].translation,
    }


def rank_one_point(relaxation: Relaxation, seed: int) -> Array | None:
    """A point (N,) at which all blocks have rank 1, before any polish; None: no part's ascents came to one."""
    parts = Parts.of(relaxation, None)
    if parts.whole.contradiction is not None:
        return None
    directions = Directions(relaxation.lift, parts, np.random.default_rng(seed))
    x = np.nan_to_num(parts.fixed)
    for part in parts.parts:
        found = _part_of_rank_one(part, directions)
        if found is None:
            return None
        x[part.columns] = found
    return x


def _part_of_rank_one(part: Part, directions: Directions) -> Array | None:
    for _ in range(STARTS):
        for step in ascend(part.blocks, part.program, directions.of(part)):
            if step.empty or step.x is None:
                return None
            if step.rank_one:
                along = linearise(part.blocks, step.x)[1]
                last = part.program.solve(-along, tolerance=TIGHT)
                tight = last.usable and linearise(part.blocks, last.x)[0].max(initial=0.0) < RANK_GAP
                return last.x if tight else step.x
        directions.draw()
    return None


def _errors(relaxation: Relaxation, x: Array) -> tuple[float, ...]:
    """Of the bar's pose as the variables have it, of rotations and ranks, and of the loops that are read off."""
    problem, lift = relaxation.problem, relaxation.lift
    goal, one = problem.goals[0], np.append(x, 1.0)
    link = problem.mechanism.frame(BAR).link
    assert goal.rotation is not None and goal.position is not None
    R = lift.rotations[link] @ one
    p = lift.point(link, np.zeros(3)) @ one
    placed = place(problem.mechanism, read(relaxation, x))
    return (
        float(np.linalg.norm(R - goal.rotation)),
        float(np.linalg.norm(p - goal.position)),
        off_rotations(lift, x),
        float(linearise(lift.blocks, x)[0].max(initial=0.0)),
        float(np.abs(missed(placed)[0]).max(initial=0.0)),
    )


BENCHES = (
    Bench(
        "ikspark-table2",
        1,
        "Baxter's closed chain: sizes in both forms, errors before the polish (IKSPARK, Table II)",
        table2,
    ),
)
