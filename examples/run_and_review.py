"""Run a task, and look at its recording: what it reports is read from the file alone, without a screen.

A task is a script of 34 to 80 lines and a scene (`tasks/`); it plans, proves, executes in MuJoCo and records.
"""

import tempfile
from pathlib import Path

from workcell import review, run_task

with tempfile.TemporaryDirectory() as folder:
    outcome = run_task("circle_trace", planner="auto", seed=1, out=folder)
    recording = Path(folder) / "circle_trace.rrd"
    print(f"achieved: {outcome.achieved}, {recording.stat().st_size / 1e6:.1f} MB recorded")

    seen = review(recording)
    print(f"review: {seen.verdict}: {seen.reason}")
    for check in seen.checks:
        print(f"  {'ok' if check.passed else 'NO':3} {check.name}: {check.finding}")
    print(
        f"{len(seen.queries)} queries of inverse kinematics, {len(seen.events)} events, {seen.duration:.1f} s simulated"
    )
