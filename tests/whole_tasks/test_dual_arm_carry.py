"""The whole task: two arms, one crate, a closed chain; planned, timed and executed together."""

import pytest

from tests.whole_tasks.planned import check_planned
from workcell.record.read.review import review
from workcell.task.run import run_task


@pytest.fixture(scope="module")
def outcome(tmp_path_factory):
    story = []
    result = run_task("dual_arm_carry", seed=3, out=tmp_path_factory.mktemp("dual"), say=story.append)
    return result, story


def test_the_crate_stands_on_the_platform(outcome):
    result, _ = outcome
    assert result.achieved, result.sentence
    assert result.summary["placed_error_m"] < 3e-3
    assert result.summary["robot"] == ["left", "right"]


def test_the_hands_work_together(outcome):
    summary = outcome[0].summary
    assert 0.0 < summary["max_internal_force_n"] < 40.0
    assert summary["max_tracking_error_m"] < 5e-4
    assert summary["min_clearance_m"] >= 0.0 and summary["unintended_contacts"] == 0


def test_the_story_and_the_recording_name_both_arms(outcome):
    result, story = outcome
    text = "\n".join(story)
    for words in (
        "left: way to the handle",
        "right: way to the handle",
        "2 arms together",
        "closed chain strained",
    ):
        assert words in text
    seen = review(result.recording)
    stretches = ["lifting the crate", "carrying the crate over the wall", "putting the crate down"]
    check_planned(seen, "ikspark", ["left: way to the handle", "right: way off the handle", *stretches])
    assert seen.achieved and set(seen.manifest["robots"]) == {"left", "right"}
    (crate,) = seen.objects
    assert crate.name == "crate" and crate.moved > 0.25 and crate.rose > 0.15
