"""The whole task: fetched, loaded through the door, clamped, left; a blank too heavy is named before motion."""

import json
import shutil

import pytest

from tests.whole_tasks.planned import check_planned
from workcell.model.loading.assets import find_asset, find_task
from workcell.record.read.review import review
from workcell.task.run import run_task


@pytest.fixture(scope="module")
def outcome(tmp_path_factory):
    story = []
    result = run_task("machine_tending", seed=4, out=tmp_path_factory.mktemp("machine"), say=story.append)
    return result, story


def test_the_chuck_is_loaded(outcome):
    result, _ = outcome
    assert result.achieved, result.sentence
    assert set(result.summary["conditions"]) >= {
        "the blank sits in the chuck",
        "all jaws hold it",
        "the hand has left the machine",
    }
    assert result.summary["seat_error_m"] < 1e-3


def test_tracking_and_clearance(outcome):
    summary = outcome[0].summary
    assert summary["max_tracking_error_m"] < 5e-4
    assert summary["min_clearance_m"] >= 0.0 and summary["unintended_contacts"] == 0


def test_the_recording_alone_tells_it(outcome):
    result, story = outcome
    seen = review(result.recording)
    check_planned(
        seen,
        "ikspark",
        ["way to the blank", "way off the rack", "way into the chuck", "way out of the machine"],
    )
    (blank,) = seen.objects
    assert seen.achieved and blank.name == "blank"
    assert blank.moved > 1.0 and blank.rose > 0.15
    assert blank.final_position == pytest.approx((1.15, 0.095, 0.27), abs=1e-3)
    assert result.recording.stat().st_size < 5e6
    assert "way into the chuck" in "\n".join(story)


def test_a_blank_that_is_too_heavy_is_named_before_anything_moves(tmp_path):
    source = find_task("machine_tending")
    text = source.read_text().replace('model = "blank"', 'model = "heavy.xml"')
    (tmp_path / "heavy.toml").write_text(text)
    shutil.copy(source.with_suffix(".py"), tmp_path / "heavy.py")
    blank = find_asset("objects", "blank").read_text()
    (tmp_path / "heavy.xml").write_text(blank.replace('mass="0.407"', 'mass="60"'))
    result = run_task(tmp_path / "heavy.toml", out=tmp_path / "out", say=lambda _: None)
    assert not result.achieved and result.status == "TORQUE" and not result.impossible
    assert "blank, 60.0 kg, is too heavy to be held there even at rest" in result.sentence
    written = json.loads(result.summary_path.read_text())
    assert "simulated_s" not in written and written["max_tracking_error_m"] is None
