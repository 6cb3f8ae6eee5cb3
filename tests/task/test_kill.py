"""A run that is killed leaves a readable recording up to its last second, and touches no other file."""

import os
import random
import signal
import subprocess
import sys
import time

import pytest

from workcell.record.read.review import review

TASK = """
format = "workcell-task/1"
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
SCRIPT = """
def run(job):
    simulation = job.simulation()
    while simulation.time < 300:
        simulation.hold(0.1)
        print(simulation.time, flush=True)
"""


@pytest.fixture
def running(tmp_path):
    """A run that lasts, and its output folder with an earlier run's files."""
    (tmp_path / "long.toml").write_text(TASK)
    (tmp_path / "long.py").write_text(SCRIPT)
    out = tmp_path / "out"
    out.mkdir()
    for name in ("long.rrd", "long.json", "notes.txt"):
        (out / name).write_text(f"an earlier {name}")
    task = str(tmp_path / "long.toml")
    code = f"from workcell.task.run import run_task; run_task({task!r}, out={str(out)!r}, say=lambda _: None)"
    process = subprocess.Popen([sys.executable, "-c", code], stdout=subprocess.PIPE, text=True)
    yield process, out
    process.kill()
    process.wait()


@pytest.mark.parametrize("seed", [0, 1])
def test_what_a_killed_run_recorded_is_there_up_to_its_last_second(running, seed):
    process, out = running
    until = random.Random(seed).uniform(1.5, 5.0)
    told = 0.0
    for line in process.stdout:
        told = float(line)
        if told > until:
            break
    os.kill(process.pid, signal.SIGKILL)
    process.wait(timeout=10)
    time.sleep(0.1)
    seen = review(out / "long.partial.rrd")
    assert not seen.achieved
    assert seen.duration >= told - 1.0
    assert {path.name for path in out.iterdir()} == {"long.rrd", "long.json", "notes.txt", "long.partial.rrd"}
    for name in ("long.rrd", "long.json", "notes.txt"):
        assert (out / name).read_text() == f"an earlier {name}"
