"""The whole task: a target around posts, followed live, while a ball comes by."""

import numpy as np
import pytest

from workcell.record.read.review import review
from workcell.task.run import run_task


@pytest.fixture(scope="module")
def outcome(tmp_path_factory):
    story = []
    out = tmp_path_factory.mktemp("follow_target")
    return run_task("follow_target", seed=1, out=out, say=story.append), "\n".join(story)


@pytest.fixture(scope="module")
def seen(outcome):
    return review(outcome[0].recording)


def test_the_target_is_followed_clear_of_posts_and_ball(outcome):
    result, story = outcome
    summary = result.summary
    assert result.achieved, result.sentence
    assert summary["off_at_rest_m"] < 2e-3 and summary["goal_error_mean_m"] < 0.02
    assert summary["min_clearance_m"] > 0 and summary["unintended_contacts"] == 0
    assert summary["live_jumps"] == 0 and summary["live_frames"] > 700
    assert "a figure of eight" in story and "ON_GOAL" in story and "guard on" in story


def test_the_recording_alone_bears_it_out(outcome, seen):
    assert seen.achieved, seen.reason
    assert seen.live is not None and seen.live.clean
    (arm,) = seen.live.robots
    assert arm.robot == "sawyer" and arm.frames == outcome[0].summary["live_frames"]
    assert dict(arm.statuses) == outcome[0].summary["live_statuses"]
    assert all(0 < share <= 1 + 1e-6 for share in arm.largest.values())
    assert arm.position_mean == pytest.approx(outcome[0].summary["goal_error_mean_m"], abs=1e-12)


def test_goal_tool_and_terms_are_recorded_over_time(outcome, seen):
    series = seen.series
    assert series["live/terms"].values.shape == (outcome[0].summary["live_frames"], 7)
    assert series["live/terms"].columns[0] == "position"
    target, (times, points) = seen.stage.targets["sawyer"], seen.stage.traces["sawyer"]
    apart = [
        np.linalg.norm(target.at(t).position - p) for t, p in zip(times[10:-40], points[10:-40], strict=True)
    ]
    assert np.median(apart) < 2e-3
    assert np.ptp(target.positions, axis=0).max() > 0.5
    assert np.ptp(seen.stage.motions["world/objects/ball/visual/ball"].positions[:, 1]) > 0.5
