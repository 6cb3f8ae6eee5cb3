"""Whole tasks, a process each: planning, tracking, clearance, and what a user waits for, at first and later."""

from __future__ import annotations

import json
import os
import subprocess
import sys
import tempfile
import time
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from workcell.bench.rows import Bench, Row
from workcell.bench.runs import killed, planners, recording, tracking
from workcell.errors import WorkcellError

_TIMEOUT_S = 900.0


@dataclass(frozen=True, slots=True)
class Entry:
    """One row: a task, the robot that takes the place of the task's own (None: its own), and what counts as success."""

    task: str
    robot: str | None = None
    proof: bool = False
    """Whether the task can't be done, and a run succeeds that proves so."""

    def succeeded(self, summary: dict[str, Any]) -> bool:
        """Whether a run with this summary did what is asked for."""
        return bool("proof" in summary if self.proof else summary["achieved"])


ENTRIES = (
    *(
        Entry(task)
        for task in (
            *("shelf_grasp", "machine_tending", "bin_picking", "dual_arm_carry", "keep_upright"),
            *("baxter_carry", "stewart_pose", "hand_grasp", "follow_target", "teleop"),
        )
    ),
    *(Entry(task, arm) for task in ("circle_trace", "square_trace") for arm in ("sawyer", "ur10", "iiwa14")),
    Entry("blocked", proof=True),
)


def run_process(entry: Entry, seed: int, caches: Path) -> dict[str, Any]:
    """The summary of one run in a process of its own, with what it cost as a whole.

    Args:
        entry: what to run.
        seed: of the task.
        caches: folder of compiled kernels and sphere covers, empty for a first run.
    """
    with tempfile.TemporaryDirectory() as folder:
        command = [sys.executable, "-c", "from workcell.cli import main; main()"]
        arguments = ["run", entry.task, "--seed", str(seed), "--out", folder, "--json"]
        arguments += [] if entry.robot is None else ["--robot", entry.robot]
        places = {"NUMBA_CACHE_DIR": str(caches / "kernels"), "WORKCELL_CACHE_DIR": str(caches / "covers")}
        began, spent = time.perf_counter(), _children_cpu()
        finished = subprocess.run(
            [*command, *arguments],
            env={**os.environ, **places},
            capture_output=True,
            text=True,
            timeout=_TIMEOUT_S,
            check=False,
        )
        wall = time.perf_counter() - began
        if not finished.stdout.strip():
            raise WorkcellError(
                f"the run left no summary: {finished.stderr.strip()[-300:]}", where=entry.task
            )
        summary: dict[str, Any] = json.loads(finished.stdout)
        return summary | {
            "process_s": wall,
            "process_cpu_s": _children_cpu() - spent,
            "recording_mb": (Path(folder) / f"{entry.task}.rrd").stat().st_size / 1e6,
        }


def _children_cpu() -> float:
    """CPU seconds of the processes that have ended so far."""
    times = os.times()
    return times.children_user + times.children_system


def task_row(entry: Entry, n: int, seed: int) -> Row:
    """Seeds `seed` to `seed + n - 1` of one task, each in a process of its own.

    The first seed runs once before, from empty caches: what a user waits who has just installed. That run compiles the
    kernels that the others then load.
    """
    with tempfile.TemporaryDirectory() as caches:
        first = run_process(entry, seed, Path(caches))
        runs = [run_process(entry, seed + k, Path(caches)) for k in range(n)]
    robots = first["robot"]
    return {
        "row": f"{robots if isinstance(robots, str) else '+'.join(robots)}/{entry.task}/{first['planner']}",
        "n": n,
        "success": float(np.mean([entry.succeeded(run) for run in runs])),
        "first_process_s": first["process_s"],
        "first_process_cpu_s": first["process_cpu_s"],
        "process_s_median": float(np.median([run["process_s"] for run in runs])),
        "process_s_max": largest(runs, "process_s"),
        "process_cpu_s_max": largest(runs, "process_cpu_s"),
        "planning_s_max": largest(runs, "planning_s"),
        "simulated_s_max": largest(runs, "simulated_s"),
        "max_tracking_error_mm": largest(runs, "max_tracking_error_m", 1e3),
        "min_clearance_mm": smallest(runs, "min_clearance_m", 1e3),
        "recording_mb": largest(runs, "recording_mb"),
        "paper": None,
    }


def largest(runs: Sequence[dict[str, Any]], key: str, scale: float = 1.0) -> float | None:
    """The largest figure of the runs that have it; None where none does, as when nothing moved."""
    return max((scale * float(run[key]) for run in runs if run.get(key) is not None), default=None)


def smallest(runs: Sequence[dict[str, Any]], key: str, scale: float = 1.0) -> float | None:
    """The smallest figure of the runs that have it, or None."""
    return min((scale * float(run[key]) for run in runs if run.get(key) is not None), default=None)


def shelf_grasp(n: int, seed: int, sets: Path | None) -> list[Row]:
    """The shelf alone."""
    return [task_row(Entry("shelf_grasp"), n, seed)]


def tasks(n: int, seed: int, sets: Path | None) -> list[Row]:
    """Every task, the traces by every arm; the one that can't be done has to be proved so."""
    return [task_row(entry, n, seed) for entry in ENTRIES]


BENCHES = [
    Bench("shelf-grasp", 10, "the whole task, one process a seed, the first from empty caches", shelf_grasp),
    Bench("tasks", 20, "every task and arm, one process a seed, the first from empty caches", tasks),
    *planners.BENCHES,
    *tracking.BENCHES,
    *killed.BENCHES,
    *recording.BENCHES,
]
