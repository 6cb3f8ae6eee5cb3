"""A mistake in a task script is one message with its line; what was recorded until then stays readable."""

import shutil
import subprocess
import sys

import pytest

from workcell.errors import ScriptError
from workcell.model.loading.assets import find_task
from workcell.record.read.review import review
from workcell.task.run import run_task


@pytest.fixture
def task(tmp_path):
    def write(script):
        source = find_task("shelf_grasp")
        path = tmp_path / "mine.toml"
        shutil.copy(source, path)
        path.with_suffix(".py").write_text(script)
        return path

    return write


def test_a_mistake_while_running_names_its_line_and_keeps_the_recording(task, tmp_path):
    path = task("def run(job):\n    job.say('begun')\n    {}['nothing']\n")
    with pytest.raises(ScriptError, match=r"mine\.py:3: KeyError: 'nothing', at: \{\}\['nothing'\]"):
        run_task(path, out=tmp_path / "out", say=lambda _: None)
    seen = review(tmp_path / "out" / "shelf_grasp.partial.rrd")
    assert not seen.achieved
    assert any("KeyError" in event.text for event in seen.events)


def test_a_mistake_below_the_script_names_the_line_of_the_script(task, tmp_path):
    path = task("import json\ndef run(job):\n    json.loads('{')\n")
    with pytest.raises(ScriptError, match=r"mine\.py:3: JSONDecodeError"):
        run_task(path, out=tmp_path / "out", say=lambda _: None)


def test_a_mistake_while_loading(task, tmp_path):
    path = task("x = 1 / 0\ndef run(job):\n    pass\n")
    with pytest.raises(ScriptError, match=r"mine\.py:1: ZeroDivisionError"):
        run_task(path, out=tmp_path / "out", say=lambda _: None)


def test_the_command_line_ends_with_one_message_and_code_2(task, tmp_path):
    path = task("def run(job):\n    job.nothing_of_that_name\n")
    command = [sys.executable, "-c", "from workcell.cli import main; main()", "run", str(path)]
    done = subprocess.run(
        [*command, "--out", str(tmp_path / "out")], capture_output=True, text=True, check=False
    )
    assert done.returncode == 2
    assert "Traceback" not in done.stderr and "mine.py:2: AttributeError" in done.stderr
