"""Random linkages with loops and joints that follow others, within reach and out of it.

Each has a question that it can answer and one that it can't. Every SOLVED answer is verified in MuJoCo by the judge;
questions out of reach are proved or left open, and an answer to one of them would be wrong.
"""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

from workcell.bench.ik.mechanisms.answers import answers, mechanism_row
from workcell.bench.ik.mechanisms.linkages import Linkage, linkage
from workcell.bench.rows import Bench, Row
from workcell.ik.problem import Budget
from workcell.sets.solving import problem_seed

BUDGET = Budget(1.0)
CYCLE = ("four-bar", "gripper", "four-bar", "gripper", "slider-crank", "spatial")
"""Kinds, in turn."""
METHODS = ("ikspark", "multistart", "auto")


def linkages(n: int, seed: int) -> list[Linkage]:
    """The first n linkages of a seed."""
    return [linkage(CYCLE[k % len(CYCLE)], problem_seed(seed, f"linkage {k}")) for k in range(n)]


def loops(n: int, seed: int, sets: Path | None = None) -> list[Row]:
    """Rows by kind and method within reach, and by kind out of reach."""
    drawn = linkages(n, seed)
    rows = []
    for kind in dict.fromkeys(CYCLE):
        of_kind = [one for one in drawn if one.kind == kind]
        if of_kind:
            rows += [_within(kind, method, of_kind, seed) for method in METHODS]
            rows.append(_without(kind, of_kind, seed))
    return rows


def _within(kind: str, method: str, drawn: Sequence[Linkage], seed: int) -> Row:
    results = answers([one.within_reach for one in drawn], method, BUDGET, seed)
    failed = [one.mechanism.name for one, r in zip(drawn, results, strict=True) if not r.solved]
    return mechanism_row(f"{kind}/{method}", results, extra={"asked": 1.0, "wrong": 0, "not_solved": failed})


def _without(kind: str, drawn: Sequence[Linkage], seed: int) -> Row:
    """`wrong`: how many were answered, which none can be."""
    results = answers([one.out_of_reach for one in drawn], "ikspark", BUDGET, seed)
    wrong = sum(result.solved for result in results)
    failed = [one.mechanism.name for one, r in zip(drawn, results, strict=True) if not r.status.is_proof]
    extra = {"asked": 0.0, "wrong": wrong, "not_solved": failed}
    return mechanism_row(f"{kind}/out of reach", results, extra=extra)


BENCHES = (
    Bench(
        "ikspark-loops",
        100,
        "random four-bars, grippers, slider-cranks and spatial linkages, within reach and out of it",
        loops,
    ),
)
