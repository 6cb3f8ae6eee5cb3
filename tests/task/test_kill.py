"""A run that is killed leaves a readable recording up to its last second, and touches no other file."""

import os
import random
import signal
import time

import pytest

from workcell.bench.runs.killed import EARLIER, begin_long_run
from workcell.record.read.review import review


@pytest.fixture
def running(tmp_path):
    """A run that lasts, and its output folder with an earlier run's files."""
    process, out = begin_long_run(tmp_path)
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
    assert {path.name for path in out.iterdir()} == {*EARLIER, "long.partial.rrd"}
    for name in EARLIER:
        assert (out / name).read_text() == name
