"""The bench `strangers`: random cells and tasks of other people's making, and how often plain MuJoCo disagrees."""

from __future__ import annotations

from collections.abc import Callable
from concurrent.futures import ProcessPoolExecutor
from functools import partial
from multiprocessing import get_context
from pathlib import Path

from workcell.bench.rows import Bench, Row
from workcell.bench.strangers.cells import Cell, random_cell
from workcell.bench.strangers.tasks import random_task
from workcell.bench.strangers.trial import Outcome, try_cell
from workcell.bench.strangers.urdf import random_urdf

QUERIES, PATHS = 5, 1
"""Questions of each arm of a cell."""
_KINDS: dict[str, Callable[[int], Cell]] = {"cells": random_cell, "tasks": random_task, "urdf": random_urdf}


def strangers(n: int, seed: int, sets: Path | None, seeds: int = 1, jobs: int = 1) -> list[Row]:
    """Rows of cell files that hold their arm, of task files, and of URDF files; `n` times `seeds` of each."""
    numbers = range(seed, seed + n * seeds)
    return [_row(kind, numbers, jobs) for kind in _KINDS]


def _row(kind: str, numbers: range, jobs: int) -> Row:
    ask = partial(outcome_of, kind)
    if jobs == 1:
        outcomes = [ask(number) for number in numbers]
    else:
        with ProcessPoolExecutor(jobs, mp_context=get_context("spawn")) as pool:
            outcomes = list(pool.map(ask, numbers))
    failures = [
        (number, *failure)
        for number, outcome in zip(numbers, outcomes, strict=True)
        for failure in outcome.failures
    ]
    asked = sum(outcome.queries for outcome in outcomes)
    return {
        "row": f"strangers/{kind}",
        "n": len(outcomes),
        "success": sum(outcome.solved for outcome in outcomes) / max(asked, 1),
        "multistart": sum(outcome.baseline for outcome in outcomes) / max(asked, 1),
        "queries": asked,
        "paths": sum(outcome.planned for outcome in outcomes),
        **{name: sum(kind == name for _, kind, _ in failures) for name in FAILURES},
        "refused": sum(bool(outcome.refused) for outcome in outcomes),
        "first": "; ".join(f"{kind} {number}: {words}" for number, kind, words in failures[:1]),
        "paper": None,
    }


FAILURES = ("lost", "impossible", "contradicted", "crash")
"""Joints or bodies that are lost; proofs against planted configurations; what MuJoCo contradicts; tracebacks."""


def outcome_of(kind: str, number: int) -> Outcome:
    """What came of one cell or task by its number."""
    return try_cell(_KINDS[kind](number), QUERIES, PATHS, baseline=True)


BENCHES = (
    Bench(
        "strangers",
        200,
        "Random cells and tasks of any make: planted configurations, paths and motions held against plain MuJoCo",
        strangers,
        repeats=True,
    ),
)
