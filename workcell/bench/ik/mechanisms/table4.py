"""Table IV of IKSPARK: the closest configuration to goals out of reach, by Problem 4 with fixed and adaptive c.

The goals are those of Table III, 2 m farther along x, all of them out of reach. As in the paper, a success is a rank-1
point (`success_first`: of the first descent, without a restart); ours are judged besides, on the ties and within the
limits, and come with a bound that is checked once more from the problem alone. The rise is of the cost (Eq. 36) over
the relaxation's minimum: at the rank-1 point, as the paper has it, and after going on downhill.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from types import MappingProxyType

import numpy as np

from workcell import clock
from workcell.bench.ik.mechanisms.answers import mean, share, worst
from workcell.bench.ik.mechanisms.baxter import FARTHER, goal_poses, problems_of
from workcell.bench.rows import Bench, Row
from workcell.ik.ikspark.mechanisms.forms import FormName
from workcell.ik.ikspark.mechanisms.minimising.closest import closest_mechanism
from workcell.ik.mechanisms.check import check_cost
from workcell.ik.mechanisms.judge import judge_mechanism
from workcell.ik.mechanisms.nearest import pose_cost, without_poses
from workcell.ik.mechanisms.problem import MechanismProblem
from workcell.ik.mechanisms.result import MechanismCandidate
from workcell.ik.multistart.closest import closest_multistart
from workcell.ik.problem import Budget
from workcell.sets.reports import cpu_columns
from workcell.sets.solving import problem_seed

BUDGET = Budget(1.0)
"""CPU seconds a goal, of every method."""
MULTISTART = "multistart"


@dataclass(frozen=True, slots=True)
class Paper:
    """Published: share that succeeds, seconds, iterations and mean rise of the cost."""

    success: float
    solve_s: float
    steps: float
    rise: float


PAPER: Mapping[tuple[FormName, float | None], Paper] = MappingProxyType(
    {
        ("quaternion", 0.05): Paper(0.622, 0.3623, 4.41, 0.0342),
        ("quaternion", 0.1): Paper(0.802, 0.4020, 5.07, 0.0521),
        ("quaternion", 0.2): Paper(0.676, 0.4886, 7.06, 0.0607),
        ("quaternion", None): Paper(0.970, 0.5170, 5.33, 0.0905),
        ("rotation", 0.2): Paper(0.296, 0.6429, 7.07, 0.0391),
        ("rotation", 0.4): Paper(0.550, 0.9548, 10.95, 0.0809),
        ("rotation", 0.8): Paper(0.288, 3.6441, 47.36, 0.1404),
        ("rotation", None): Paper(0.996, 1.6226, 7.83, 0.1239),
    }
)
"""By form and c; None: adaptive."""


@dataclass(frozen=True, slots=True)
class Found:
    """A candidate that was judged: whether it holds, its cost, the bound that is proved, CPU seconds."""

    candidate: MechanismCandidate
    holds: bool
    cost: float
    bound: float
    cpu_s: float


def table4(n: int, seed: int, sets: Path | None = None) -> list[Row]:
    """A row for each form and c, and one of multi-start."""
    problems = problems_of(goal_poses(n, seed, farther=FARTHER))
    rows = []
    for (form, c), paper in PAPER.items():
        found = _all(problems, seed, form, c)
        rows.append(_row(f"{form}/{'adaptive' if c is None else f'c = {c:g}'}", found, paper))
    return [*rows, _row(MULTISTART, _all(problems, seed, None, None), None)]


def _all(
    problems: Sequence[MechanismProblem], seed: int, form: FormName | None, c: float | None
) -> list[Found]:
    _one(problems[0], Budget(0.2), 0, form, c)  # imports and compiles what is loaded lazily
    return [_one(problem, BUDGET, problem_seed(seed, str(k)), form, c) for k, problem in enumerate(problems)]


def _one(
    problem: MechanismProblem, budget: Budget, seed: int, form: FormName | None, c: float | None
) -> Found:
    """One goal; without a form by multi-start."""
    began = clock.cpu_seconds()
    if form is None:
        candidate = closest_multistart(problem, budget, seed)
    else:
        candidate = closest_mechanism(problem, budget, seed, form=form, c=c)
    q, proof = candidate.q, candidate.bound_certificate
    holds = q is not None and judge_mechanism(without_poses(problem), q).accepted
    bound = None if proof is None else check_cost(problem, proof)
    spent = clock.cpu_seconds() - began
    cost = pose_cost(problem, q) if holds and q is not None else float("nan")
    return Found(candidate, holds, cost, 0.0 if bound is None else bound, spent)


def _row(name: str, found: Sequence[Found], paper: Paper | None) -> Row:
    """The gap is that of the cost over the bound that is proved: by so much at most is another one closer."""
    held = [one for one in found if one.holds]
    theirs = [one.candidate.stats for one in held] if paper is not None else []
    relaxed = [stats["cost_relaxed"] for stats in theirs]
    return {
        "row": f"baxter/{FARTHER:g} m farther/{name}",
        "n": len(found),
        "success": share(one.holds for one in found),
        "success_first": share(one.holds and one.candidate.stats["restarts"] == 1 for one in found)
        if paper is not None
        else None,
        **cpu_columns([one.cpu_s for one in found]),
        "steps_mean": mean([stats["steps"] for stats in theirs]),
        "programs_mean": mean([stats["sdps"] for stats in theirs]),
        "cost_mean": mean([one.cost for one in held]),
        "rise_rank_one_mean": mean(np.subtract([s["cost_rank_one"] for s in theirs], relaxed).tolist()),
        "rise_mean": mean(np.subtract([one.cost for one in held], relaxed).tolist()) if theirs else None,
        "proved": share(one.bound > 0.0 for one in found) if paper is not None else None,
        "gap_mean": mean([one.cost - one.bound for one in held]) if paper is not None else None,
        "rank_gap_max": worst([stats["rank_gap"] for stats in theirs]),
        "off_rotations_max": worst([stats["off_rotations"] for stats in theirs]),
        "moved_max": worst([stats["moved"] for stats in theirs]),
        "paper": paper.success if paper else None,
        "paper_solve_s": paper.solve_s if paper else None,
        "paper_steps": paper.steps if paper else None,
        "paper_rise": paper.rise if paper else None,
    }


BENCHES = (
    Bench(
        "ikspark-table4",
        100,
        "the closest configuration of Baxter's closed chain to goals out of reach (IKSPARK, Table IV)",
        table4,
    ),
)
