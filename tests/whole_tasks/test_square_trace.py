"""The whole task, by another arm than the task file names, and by the other convex solver."""

import json

import pytest

from tests.whole_tasks.planned import check_planned
from workcell.record.read.review import review
from workcell.task.run import run_task


@pytest.fixture(scope="module")
def outcome(tmp_path_factory):
    out = tmp_path_factory.mktemp("square_trace")
    return run_task("square_trace", planner="cidgik", robot="iiwa14", seed=1, out=out, say=lambda _: None)


def test_the_square_is_drawn_to_half_a_millimetre(outcome):
    summary = outcome.summary
    assert outcome.achieved and all(summary["conditions"].values())
    assert summary["max_deviation_m"] <= 5e-4 and summary["corners_missed_by_m"] <= 5e-4
    assert summary["max_tracking_error_m"] <= 5e-4 and summary["min_clearance_m"] > 0


def test_the_square_is_cidgiks(outcome):
    check_planned(review(outcome.recording), "cidgik", ["square"])


def test_the_summary_names_the_arm_that_drew(outcome):
    written = json.loads(outcome.summary_path.read_text())
    assert written["robot"] == "iiwa14" and written["task"] == "square_trace"
