"""Whole tasks from cold processes: planning, tracking, clearance, and what a user waits for."""

from __future__ import annotations

import json
import os
import subprocess
import sys
import tempfile
import time
from pathlib import Path
from typing import Any

import numpy as np

from workcell.bench import killed, recording, tracking
from workcell.bench.tables import Bench, Row
from workcell.errors import WorkcellError

_TIMEOUT_S = 900.0


def run_cold(task: str, seed: int) -> dict[str, Any]:
    """The summary of one run in a process of its own, without any cache; `cold_wall_s` is what the user waits."""
    with tempfile.TemporaryDirectory() as folder:
        command = [sys.executable, "-c", "from workcell.cli import main; main()"]
        arguments = ["run", task, "--seed", str(seed), "--out", folder, "--json"]
        environment = {**os.environ, "NUMBA_CACHE_DIR": str(Path(folder) / "numba"), "WORKCELL_CACHE_DIR": ""}
        began, spent = time.perf_counter(), _children_cpu()
        finished = subprocess.run(
            [*command, *arguments],
            env=environment,
            capture_output=True,
            text=True,
            timeout=_TIMEOUT_S,
            check=False,
        )
        wall = time.perf_counter() - began
        if not finished.stdout.strip():
            raise WorkcellError(f"the run left no summary: {finished.stderr.strip()[-300:]}", where=task)
        summary: dict[str, Any] = json.loads(finished.stdout)
        return summary | {
            "cold_wall_s": wall,
            "cold_cpu_s": _children_cpu() - spent,
            "recording_mb": (Path(folder) / f"{task}.rrd").stat().st_size / 1e6,
        }


def _children_cpu() -> float:
    """CPU seconds of the processes that have ended so far."""
    times = os.times()
    return times.children_user + times.children_system


TASKS = ("shelf_grasp", "machine_tending", "bin_picking", "dual_arm_carry")


def task_row(task: str, n: int, seed: int) -> Row:
    """Seeds `seed` to `seed + n - 1` of one task, each from a cold process."""
    runs = [run_cold(task, seed + k) for k in range(n)]

    def worst(key: str, sign: float = 1.0) -> float:
        values = [run.get(key) for run in runs]
        return float(sign * max(sign * np.nan if value is None else sign * float(value) for value in values))

    planning = [1e3 * float(run["planning_s"]) for run in runs]
    robots = runs[0]["robot"]
    return {
        "row": f"{robots if isinstance(robots, str) else '+'.join(robots)}/{task}/{runs[0]['planner']}",
        "n": n,
        "success": float(np.mean([run["achieved"] for run in runs])),
        "planning_ms_mean": float(np.mean(planning)),
        "planning_ms_max": float(np.max(planning)),
        "cold_wall_s_max": worst("cold_wall_s"),
        "cold_cpu_s_max": worst("cold_cpu_s"),
        "simulated_s_max": worst("simulated_s"),
        "max_tracking_error_mm": 1e3 * worst("max_tracking_error_m"),
        "min_clearance_mm": 1e3 * worst("min_clearance_m", -1.0),
        "recording_mb": worst("recording_mb"),
        "paper": None,
    }


def shelf_grasp(n: int, seed: int, sets: Path | None) -> list[Row]:
    """The shelf alone."""
    return [task_row("shelf_grasp", n, seed)]


def tasks(n: int, seed: int, sets: Path | None) -> list[Row]:
    """Every task that handles objects."""
    return [task_row(task, n, seed) for task in TASKS]


BENCHES = [
    Bench("shelf-grasp", 10, "the whole task from cold processes, one seed each", shelf_grasp),
    Bench("tasks", 20, "the tasks that handle objects, each seed from a cold process", tasks),
    *tracking.BENCHES,
    *killed.BENCHES,
    *recording.BENCHES,
]
