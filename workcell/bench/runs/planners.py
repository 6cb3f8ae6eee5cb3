"""Tasks planned by each planner: whose the configurations of the ways are, and what that takes against `auto`."""

from __future__ import annotations

import tempfile
from collections import Counter
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from workcell.bench.rows import Bench, Row
from workcell.ik.registry import AUTO, is_planned_by, planner_names
from workcell.record.read.queries import Query
from workcell.record.read.review import review
from workcell.task.run import run_task

TASKS = (
    "shelf_grasp",
    "machine_tending",
    "bin_picking",
    "dual_arm_carry",
    "baxter_carry",
    "keep_upright",
    "circle_trace",
    "square_trace",
)
"""Those in which arms move; mechanisms that are no arms are planned by IKSPARK and `auto` alone."""


@dataclass(frozen=True, slots=True)
class Run:
    """One run of a task: its summary, and the queries that its recording tells of."""

    summary: dict[str, Any]
    queries: tuple[Query, ...]


def run_once(task: str, planner: str, seed: int) -> Run:
    """Plan, execute and record a task in this process; the recording is read again, and thrown away."""
    with tempfile.TemporaryDirectory() as folder:
        result = run_task(task, planner=planner, seed=seed, out=Path(folder), say=lambda _: None)
        return Run(result.summary, review(result.recording).queries)


def rows_of(task: str, n: int, seed: int) -> list[Row]:
    """A row for each planner, of seeds `seed` to `seed + n - 1`, which all of them plan in turns.

    The first run of all is not counted: it is where kernels and covers are made that the others find made.
    """
    names = sorted(planner_names(), key=lambda name: name != AUTO)
    run_once(task, AUTO, seed)
    runs: dict[str, list[Run]] = {name: [] for name in names}
    for k in range(n):
        for name in names:
            runs[name].append(run_once(task, name, seed + k))
    return [row_of_planner(task, name, runs[name], runs[AUTO]) for name in names]


def row_of_planner(task: str, planner: str, runs: Sequence[Run], autos: Sequence[Run]) -> Row:
    """One row; `autos` are the runs of the same seeds by `auto`.

    `success` counts runs that were achieved with every configuration by the planner; `by_planner` and `in_cuboids` are
    shares of all configurations that were found, in queries of goals and of steps alike.
    """
    solved = [query for run in runs for query in run.queries if query.solved]
    own = [query for query in solved if is_planned_by(planner, query.solver)]
    achieved = [bool(run.summary["achieved"]) for run in runs]
    alone = [
        all(is_planned_by(planner, query.solver) for query in run.queries if query.solved) for run in runs
    ]
    spent, auto = ([float(run.summary["planning_s"]) for run in some] for some in (runs, autos))
    return {
        "row": f"{task}/{planner}",
        "n": len(runs),
        "success": float(np.mean([done and its for done, its in zip(achieved, alone, strict=True)])),
        "achieved": float(np.mean(achieved)),
        "queries": len(solved),
        "by_planner": len(own) / max(len(solved), 1),
        "in_cuboids": sum(query.in_cuboids is True for query in solved) / max(len(solved), 1),
        "by": dict(Counter(query.solver for query in solved).most_common()),
        "not_solved": sum(len(run.queries) for run in runs) - len(solved),
        "planning_s_median": float(np.median(spent)),
        "planning_s_max": max(spent),
        "planning_to_auto": float(np.median([own_s / s for own_s, s in zip(spent, auto, strict=True)])),
        "link_rotation_max": largest([query.link_rotation for query in own]),
        "step_max": largest([query.step for query in own]),
        "max_tracking_error_mm": largest([run.summary["max_tracking_error_m"] for run in runs], 1e3),
        "min_clearance_mm": smallest([run.summary["min_clearance_m"] for run in runs], 1e3),
        "paper": None,
    }


def largest(values: Sequence[float | None], scale: float = 1.0) -> float | None:
    """The largest of those that are known; None where none is."""
    return max((scale * value for value in values if value is not None), default=None)


def smallest(values: Sequence[float | None], scale: float = 1.0) -> float | None:
    """The smallest of those that are known; None where none is."""
    return min((scale * value for value in values if value is not None), default=None)


def planners(n: int, seed: int, sets: Path | None) -> list[Row]:
    """Every moving task by every planner."""
    del sets
    return [row for task in TASKS for row in rows_of(task, n, seed)]


BENCHES = [
    Bench("planners", 5, "every task by every planner: whose the ways are, and the time to auto's", planners)
]
