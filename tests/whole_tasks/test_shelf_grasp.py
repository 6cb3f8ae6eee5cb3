"""The whole task, as a user runs it: planned, executed, recorded, and reviewed from the recording alone."""

import json
import shutil

import numpy as np
import pytest

from workcell.model.loading.assets import find_task
from workcell.record.read.review import review
from workcell.task.run import run_task


@pytest.fixture(scope="module")
def outcome(tmp_path_factory):
    story = []
    result = run_task("shelf_grasp", seed=3, out=tmp_path_factory.mktemp("shelf_grasp"), say=story.append)
    return result, story


def test_the_mug_leaves_the_shelf(outcome):
    result, _ = outcome
    assert result.achieved and result.status == "ACHIEVED"
    conditions = result.summary["conditions"]
    assert conditions["the mug has left the shelf"] and conditions["the mug hangs in the hand alone"]
    assert all(conditions.values())


def test_tracking_and_clearance(outcome):
    summary = outcome[0].summary
    assert summary["max_tracking_error_m"] < 1e-3
    assert summary["min_clearance_m"] >= 0.0
    assert summary["unintended_contacts"] == 0


def test_the_summary_file_says_the_same(outcome):
    result, _ = outcome
    written = json.loads(result.summary_path.read_text())
    assert written["achieved"] is True and written["seed"] == 3 and written["planner"] == "ikspark"
    assert written["planning_s"] > 0 and written["wall_s"] > written["planning_s"]


def test_the_recording_alone_tells_it(outcome):
    result, _ = outcome
    seen = review(result.recording)
    assert seen.achieved
    moved = {row.name: row for row in seen.objects}
    assert "mug" in moved
    assert not result.recording.with_name("shelf_grasp.partial.rrd").exists()


def test_the_story_names_each_step(outcome):
    text = "\n".join(outcome[1])
    for words in (
        "grasp configuration",
        "way into the shelf",
        "way out with the mug",
        "held by both fingers",
    ):
        assert words in text


def test_the_same_seed_gives_the_same_plan(outcome, tmp_path):
    again = run_task("shelf_grasp", seed=3, out=tmp_path, say=lambda _: None)
    for key in ("simulated_s", "min_clearance_m", "max_tracking_error_m"):
        assert again.summary[key] == outcome[0].summary[key]


def test_a_goal_out_of_reach_ends_with_a_proof(tmp_path):
    source = find_task("shelf_grasp")
    goal = 'name = "grasp"                      # the mug between the fingers\n'
    where = 'robot = "sawyer"\nrelative_to = "mug/grasp"\n'
    above = f'name = "grasp"\n{where}xyz = [0.0, 0.0, 1.5]'
    text = source.read_text().replace(f"{goal}{where}xyz = [0.0, 0.0, 0.0]", above)
    assert text != source.read_text()
    (tmp_path / "far.toml").write_text(text.replace('name = "shelf_grasp"', 'name = "far"'))
    shutil.copy(source.with_suffix(".py"), tmp_path / "far.py")
    result = run_task(tmp_path / "far.toml", out=tmp_path / "out", say=lambda _: None)
    assert not result.achieved and result.impossible and result.status == "UNREACHABLE"
    assert json.loads(result.summary_path.read_text())["status"] == "UNREACHABLE"
    assert not review(result.recording).achieved
    assert np.isfinite(result.summary["wall_s"])
