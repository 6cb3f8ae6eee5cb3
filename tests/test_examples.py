"""The examples: each runs from a checkout as its reader would run it, and prints what it is there to show."""

import os
import subprocess
import sys
from pathlib import Path

import pytest

ROOT = Path(__file__).parent.parent
SHOWN = {
    "ask_cidgik": ("SOLVED: ", "at [0.7 0.1 0.4]", "UNREACHABLE; the proof, checked again: it holds"),
    "ask_why_not": ("BLOCKED: ", "it would be possible without the obstacle beam", "in the way: beam"),
    "clear_by_gradient": ("of 2000 random configurations are clear", "up the gradient it ends "),
    "constrain_two_arms": (
        "SOLVED by ikspark",
        "both hands hold the crate within 1e-9 m: True",
        "the elbows are within 0.9 m: True, the left one low: True",
    ),
    "follow_a_circle": ("FOLLOWED: ", "radius 100.00 mm"),
    "keep_a_certificate": (
        "UNREACHABLE: ",
        "checked again: it holds",
        "the certificate belongs to another problem",
    ),
    "keep_a_table": (
        "63 spheres, 18 cuboids, 88% of the pairs are possible",
        "of other cuboids: ",
        "another robot, cover or free space",
        "asked with the table: SOLVED",
    ),
    "many_targets": ("100.0% of 2000 targets", "all within the joint limits: True"),
    "obstacles_in_python": ("a wall and a post: SOLVED", "a block as well: BLOCKED_IN_MODEL", "inside block"),
    "pose_a_platform": (
        "13 joints, 6 loops",
        "SOLVED: legs 0.945, 1.376, 1.547, 0.945, 1.376, 1.547 m",
        "by MuJoCo's measure: True",
        "UNREACHABLE: No configuration",
        "closest: cost 3.993, and none is below 3.99",
    ),
    "run_and_review": ("achieved: True", "review: achieved", "ok  tracking"),
    "several_solutions": ("4 solutions, every one verified",),
    "solve_a_pose": ("SOLVED by ", "the tool is at [0.6 0.2 0.5]"),
    "time_a_path": ("as fast as it goes", "tool up to 0.25 m/s", "joints up to 100%"),
    "your_own_cell": ("SOLVED: ", " mm clear, nearest: "),
}
"""What stands in the output of each."""


def test_every_example_is_looked_at():
    assert sorted(file.stem for file in (ROOT / "examples").glob("*.py")) == sorted(SHOWN)


@pytest.mark.parametrize("name", SHOWN)
def test_an_example_shows_what_it_is_about(name, tmp_path):
    command = [sys.executable, str(ROOT / "examples" / f"{name}.py")]
    environment = {**os.environ, "PYTHONPATH": str(ROOT)}
    run = subprocess.run(command, cwd=tmp_path, env=environment, capture_output=True, text=True, timeout=200)
    assert run.returncode == 0, run.stderr
    assert [words for words in SHOWN[name] if words not in run.stdout] == [], run.stdout
    assert not list(tmp_path.iterdir()), "an example leaves nothing behind"
