"""Restarts of IKSPARK on mechanisms: lifts of configurations, random objectives, lines (Algorithm 2)."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

from workcell import clock
from workcell.bench.ik.mechanisms.answers import mean, share
from workcell.bench.ik.mechanisms.baxter import goal_poses, problems_of, reachable
from workcell.bench.rows import Bench, Row
from workcell.ik.ikspark.mechanisms.parts import Parts
from workcell.ik.ikspark.mechanisms.relaxation import Relaxation
from workcell.ik.ikspark.mechanisms.restart import RESTARTS, Restart
from workcell.ik.ikspark.mechanisms.solver import solve_mechanism_ikspark
from workcell.ik.mechanisms.problem import MechanismProblem
from workcell.ik.problem import Budget
from workcell.sets.reports import cpu_columns
from workcell.sets.solving import problem_seed

BUDGET = Budget(20.0, effort=1.0)
"""Work ends a query: 200 cone programs."""


def restarts(n: int, seed: int, sets: Path | None = None) -> list[Row]:
    """Those of the first n goals of Baxter's closed chain that both arms reach, the same for all kinds of restarts."""
    poses = goal_poses(n, seed)
    reached = reachable(poses, seed)
    problems = problems_of([pose for pose, yes in zip(poses, reached, strict=True) if yes])
    return [_row(kind, problems, seed) for kind in RESTARTS] if problems else []


def _row(kind: Restart, problems: Sequence[MechanismProblem], seed: int) -> Row:
    """`ascents_mean` counts those of all parts, `first_ascents` the share solved without a restart."""
    solve_mechanism_ikspark(problems[0], Budget(0.2), 0, restart=kind)  # imports what is imported lazily
    times, found = [], []
    for k, problem in enumerate(problems):
        began = clock.cpu_seconds()
        found.append(solve_mechanism_ikspark(problem, BUDGET, problem_seed(seed, str(k)), restart=kind))
        times.append(clock.cpu_seconds() - began)
    first = len(Parts.of(Relaxation.of(problems[0]), None).parts)
    solved = [candidate.stats for candidate in found if candidate.q is not None]
    return {
        "row": f"baxter/{kind}",
        "n": len(found),
        "success": share(candidate.q is not None for candidate in found),
        "first_ascents": share(c.q is not None and c.stats["restarts"] <= first for c in found),
        "ascents_mean": mean([stats["restarts"] for stats in solved]),
        "programs_mean": mean([stats["sdps"] for stats in solved]),
        **cpu_columns(times),
        "paper": None,
    }


BENCHES = (
    Bench(
        "ikspark-mechanism-restarts",
        100,
        "restarts on Baxter's closed chain: configurations, random objectives, lines (IKSPARK, Algorithm 2)",
        restarts,
    ),
)
