"""Runs that are killed: how much of the recording is there, and whether anything else was touched."""

from __future__ import annotations

import os
import signal
import subprocess
import sys
import tempfile
from pathlib import Path

import numpy as np

from workcell.bench.rows import Bench, Row
from workcell.errors import WorkcellError
from workcell.record.read.review import review

_TASK = """format = "workcell-task/1"
name = "long"
cell = "shelf"
[[robots]]
name = "sawyer"
model = "sawyer"
mount = "robot_mount"
gripper = "parallel_gripper"
gripper_site = "right_hand"
start = [-0.2, -0.9, -0.1, 2.4, -0.6, -0.8, -1.25]
"""
_SCRIPT = """def run(job):
    simulation = job.simulation()
    while simulation.time < 600:
        simulation.hold(0.1)
        print(simulation.time, flush=True)
"""
EARLIER = ("long.rrd", "long.json", "notes.txt")
"""Files of an earlier run in the output folder; each holds its name."""


def begin_long_run(folder: Path) -> tuple[subprocess.Popen[str], Path]:
    """A run that lasts, told second by second on its standard output, and its output folder."""
    (folder / "long.toml").write_text(_TASK)
    (folder / "long.py").write_text(_SCRIPT)
    out = folder / "out"
    out.mkdir()
    for name in EARLIER:
        (out / name).write_text(name)
    task = str(folder / "long.toml")
    code = f"from workcell.task.run import run_task; run_task({task!r}, out={str(out)!r}, say=str)"
    return subprocess.Popen([sys.executable, "-c", code], stdout=subprocess.PIPE, text=True), out


def _one(folder: Path, until: float) -> tuple[bool, float, bool]:
    """Kill one run once it has simulated `until` s: readable, seconds lost, and whether other files are intact."""
    begun, out = begin_long_run(folder)
    told = 0.0
    with begun as process:
        assert process.stdout is not None
        for line in process.stdout:
            told = float(line)
            if told > until:
                break
        os.kill(process.pid, signal.SIGKILL)
    intact = all((out / name).read_text() == name for name in EARLIER)
    intact &= {path.name for path in out.iterdir()} == {*EARLIER, "long.partial.rrd"}
    try:
        seen = review(out / "long.partial.rrd")
    except WorkcellError:
        return False, told, intact
    return True, max(told - seen.duration, 0.0), intact


def killed_runs(n: int, seed: int, sets: Path | None) -> list[Row]:
    """`n` runs, each killed (SIGKILL) at a random moment of its first ten simulated seconds."""
    rng = np.random.default_rng(seed)
    found = []
    for _ in range(n):
        with tempfile.TemporaryDirectory() as folder:
            found.append(_one(Path(folder), rng.uniform(0.5, 10.0)))
    return [
        {
            "row": "sawyer/killed run",
            "n": n,
            "success": float(
                np.mean([readable and lost <= 1.0 and intact for readable, lost, intact in found])
            ),
            "readable": float(np.mean([readable for readable, _, _ in found])),
            "others_intact": float(np.mean([intact for _, _, intact in found])),
            "lost_s_mean": float(np.mean([lost for _, lost, _ in found])),
            "lost_s_max": float(np.max([lost for _, lost, _ in found])),
            "paper": None,
        }
    ]


BENCHES = [Bench("killed-runs", 20, "recordings of runs that are killed at a random moment", killed_runs)]
