"""The whole task: a circle that varies by seed, drawn by one arm, and refused where no arm can reach."""

import shutil

import numpy as np
import pytest

from workcell.model.loading.assets import find_task
from workcell.record.read.review import review
from workcell.task.run import run_task


@pytest.fixture(scope="module")
def outcome(tmp_path_factory):
    story = []
    out = tmp_path_factory.mktemp("circle_trace")
    return run_task("circle_trace", seed=2, out=out, say=story.append), story


def test_the_circle_is_drawn_to_half_a_millimetre(outcome):
    result, _ = outcome
    summary = result.summary
    assert result.achieved and all(summary["conditions"].values())
    assert summary["max_deviation_m"] <= 5e-4 and summary["max_tracking_error_m"] <= 5e-4
    assert summary["turned_rad"] == pytest.approx(2 * np.pi, abs=0.01)
    assert summary["min_clearance_m"] > 0 and summary["unintended_contacts"] == 0


def test_the_recording_holds_the_same_trace(outcome):
    result, story = outcome
    assert review(result.recording).achieved
    text = "\n".join(story)
    assert "circle of radius" in text and "waypoints, largest step" in text and "drawing the circle" in text


def test_a_circle_out_of_reach_names_the_place(tmp_path):
    source = find_task("circle_trace")
    text = source.read_text().replace("centre = [0.56, 0.0, 0.32]", "centre = [1.6, 0.0, 0.32]")
    assert text != source.read_text()
    (tmp_path / "far.toml").write_text(text.replace('name = "circle_trace"', 'name = "far"'))
    shutil.copy(source.with_suffix(".py"), tmp_path / "far.py")
    result = run_task(tmp_path / "far.toml", planner="auto", out=tmp_path / "out", say=lambda _: None)
    assert not result.achieved and "at pose 0 (" in result.sentence
