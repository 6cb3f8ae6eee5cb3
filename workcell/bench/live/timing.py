"""What live IK costs: CPU time of a frame on one core, and of what is made before the first."""

from __future__ import annotations

import json
import os
import subprocess
import sys
import tempfile
import time
from pathlib import Path

import numpy as np

from workcell.bench.live.arms import SETUPS, arms_of
from workcell.bench.live.cases import case_of
from workcell.bench.live.followers import Live, drive
from workcell.bench.rows import Bench, Row
from workcell.errors import WorkcellError

_TASK = "circle"
_TIMEOUT_S = 1800.0


def prepare(robot: str) -> tuple[float, float]:
    """CPU and wall seconds from an arm's scene to the end of its first frame, in this process."""
    setup = next(one for one in SETUPS if one.robot == robot)
    arms = arms_of(setup)
    spent, began = time.process_time(), time.perf_counter()
    follower = Live(arms, {})
    follower.step([arms.robots[0].fk(arms.robots[0].home)])
    return time.process_time() - spent, time.perf_counter() - began


def _prepared(robot: str, places: dict[str, str]) -> list[float]:
    """What `prepare` says in a process of its own, with caches somewhere else."""
    code = (
        f"import json; from workcell.bench.live.timing import prepare; print(json.dumps(prepare({robot!r})))"
    )
    done = subprocess.run(
        [sys.executable, "-c", code],
        env={**os.environ, **places},
        capture_output=True,
        text=True,
        timeout=_TIMEOUT_S,
        check=False,
    )
    if done.returncode:
        raise WorkcellError(f"nothing was prepared: {done.stderr.strip()[-300:]}", where=robot)
    found: list[float] = json.loads(done.stdout.splitlines()[-1])
    return found


def kernels_row(robot: str) -> Row:
    """What a machine's first process takes, whose kernels are compiled."""
    with tempfile.TemporaryDirectory() as caches:
        cpu, wall = _prepared(robot, {"NUMBA_CACHE_DIR": caches})
    return {"row": f"{robot}/first process of a machine", "prepare_cold_cpu_s": cpu, "prepare_cold_s": wall}


def robot_row(robot: str, n: int, seed: int) -> Row:
    """An arm: preparation without and with its cover in the cache, and n frames of its circle."""
    with tempfile.TemporaryDirectory() as caches:
        cold, cached = (_prepared(robot, {"WORKCELL_CACHE_DIR": caches}) for _ in range(2))
    case = case_of(next(one for one in SETUPS if one.robot == robot), _TASK)
    follower, seconds, unanswered = Live(case.arms, {}), np.zeros(0), 0
    start = case.way.start
    drive(follower, case.trace, start)
    while len(seconds) < n:
        run = drive(follower, case.trace, start)
        seconds, unanswered = np.concatenate([seconds, run.seconds]), unanswered + run.unanswered
    seconds = seconds[:n]
    return {
        "row": robot,
        "n": n,
        "frame_ms_mean": 1e3 * float(seconds.mean()),
        "frame_ms_p50": 1e3 * float(np.median(seconds)),
        "frame_ms_p99.9": 1e3 * float(np.quantile(seconds, 0.999)),
        "frame_ms_max": 1e3 * float(seconds.max()),
        "unanswered": unanswered,
        "prepare_cold_cpu_s": cold[0],
        "prepare_cold_s": cold[1],
        "prepare_cached_cpu_s": cached[0],
        "prepare_cached_s": cached[1],
    }


def live_time(n: int, seed: int, sets: Path | None) -> list[Row]:
    """Every arm, and the first process of a machine."""
    return [*(robot_row(setup.robot, n, seed) for setup in SETUPS), kernels_row("sawyer")]


BENCHES = [
    Bench(
        "live-time",
        10_000,
        "CPU time of n frames of live IK, and of preparing it, cold and cached",
        live_time,
    )
]
