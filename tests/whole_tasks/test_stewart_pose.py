"""The whole task: a platform on six legs goes through poses; six loops, nineteen passive joints."""

import pytest

from workcell.record.read.review import review
from workcell.task.run import run_task


@pytest.fixture(scope="module")
def outcome(tmp_path_factory):
    story = []
    out = tmp_path_factory.mktemp("stewart")
    result = run_task("stewart_pose", planner="auto", seed=1, out=out, say=story.append)
    return result, "\n".join(story)


def test_the_platform_holds_every_pose(outcome):
    summary = outcome[0].summary
    assert outcome[0].achieved, outcome[0].sentence
    assert summary["poses"] == 4 and summary["robot"] == "stewart"
    assert summary["pose_error_m"] < 1e-4 and summary["pose_error_rad"] < 1e-3


def test_the_loops_hold_and_legs_keep_apart(outcome):
    summary = outcome[0].summary
    assert summary["max_closure_error_m"] < 1e-4 and summary["max_tracking_error_m"] < 1e-3
    assert summary["min_clearance_m"] > 0.05 and summary["unintended_contacts"] == 0


def test_the_story_and_the_recording_tell_of_every_way(outcome):
    result, story = outcome
    seen = review(result.recording)
    assert seen.achieved, seen.reason
    rows = {row.what: row for row in seen.ways}
    for pose in range(1, 5):
        way = rows[f"way to pose {pose}"]
        assert way.steps and not way.unsolved and way.link_rotation.largest <= way.link_rotation.bound == 0.28
        assert f"motion to pose {pose}" in story
    assert len(seen.manifest["robots"]["stewart"]["closures"]) == 6
    assert set(seen.stage.traces) == {
        f"stewart/{name}" for name in ("platform", *(f"platform{k}" for k in (2, 4, 6)))
    }
    assert {check.name for check in seen.checks if check.passed} >= {
        "closure",
        "planner",
        "continuity",
        "clearance",
    }
