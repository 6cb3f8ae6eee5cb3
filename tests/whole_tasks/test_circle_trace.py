"""The whole task: a circle that varies by seed, drawn by one arm, and refused where no arm can reach."""

import re
import shutil

import numpy as np
import pytest

from tests.whole_tasks.planned import check_planned
from workcell.model.loading.assets import find_task
from workcell.record.read.review import review
from workcell.record.read.stage import TRACE_RGB
from workcell.record.show.cameras import choose_cameras
from workcell.record.show.studio import Studio
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
    """What the tool did from the moment on at which it began to draw, and the picture of it."""
    result, story = outcome
    seen = review(result.recording)
    assert seen.achieved
    check_planned(seen, "ikspark", ["circle"])
    text = "\n".join(story)
    assert "circle of radius" in text and "drawing the circle" in text
    assert re.search(r"circle: \d+ waypoints, \d+ by ikspark .*, largest step .* of 0.200 rad", text)
    (begun,) = (line.time for line in seen.events if line.text.startswith("drawing the circle"))
    times, points = seen.stage.traces["sawyer"]
    drawn = points[times >= begun]
    assert len(drawn) > 100 and np.abs(off_circle(drawn, result.summary["radius_m"])).max() <= 5e-4

    studio = Studio(seen.stage, choose_cameras(seen.stage, 240, 180)[1], smooth=False)
    away = drawn[np.linalg.norm(drawn - drawn[0], axis=1) > 0.02]
    column, row = np.array([studio.place(point) for point in away]).T.astype(int)
    before, after = studio.picture(begun), studio.picture(seen.duration)
    orange = [np.abs(picture[row, column] - TRACE_RGB).max(axis=1) < 0.01 for picture in (before, after)]
    assert not orange[0].any() and np.mean(orange[1]) > 0.8


def off_circle(points, radius):
    """How far points are off the circle of a radius that fits them best, metres."""
    middle = points.mean(axis=0)
    axes = np.linalg.svd(points - middle)[2]
    flat, height = (points - middle) @ axes[:2].T, (points - middle) @ axes[2]
    # |p|^2 = 2 c . p + constant at every point p of a circle around c
    centre = np.linalg.lstsq(np.column_stack([2 * flat, np.ones(len(flat))]), (flat**2).sum(axis=1))[0][:2]
    return np.hypot(np.linalg.norm(flat - centre, axis=1) - radius, height)


def test_a_circle_out_of_reach_names_the_place(tmp_path):
    source = find_task("circle_trace")
    text = source.read_text().replace("centre = [0.56, 0.0, 0.32]", "centre = [1.6, 0.0, 0.32]")
    assert text != source.read_text()
    (tmp_path / "far.toml").write_text(text.replace('name = "circle_trace"', 'name = "far"'))
    shutil.copy(source.with_suffix(".py"), tmp_path / "far.py")
    result = run_task(tmp_path / "far.toml", planner="auto", out=tmp_path / "out", say=lambda _: None)
    assert not result.achieved and "at pose 0 (" in result.sentence
