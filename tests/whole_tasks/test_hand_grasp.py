"""The whole task: a hand of 24 joints takes a cube with five fingers, each on its own face, and lifts it."""

import pytest

from workcell.record.read.review import review
from workcell.task.run import run_task

FINGERS = ("ff", "mf", "rf", "lf", "th")


@pytest.fixture(scope="module")
def outcome(tmp_path_factory):
    story = []
    out = tmp_path_factory.mktemp("hand")
    result = run_task("hand_grasp", planner="ikspark", seed=0, out=out, say=story.append)
    return result, "\n".join(story)


def test_every_finger_touches_its_face_and_nothing_else(outcome):
    result, _ = outcome
    assert result.achieved, result.sentence
    touched = result.summary["contacts"]
    assert set(touched) == {f"hand/rh_{finger}distal_collision on cube" for finger in FINGERS}
    assert all(force > 0.1 for force in touched.values())
    assert result.summary["unintended_contacts"] == 0 and result.summary["min_clearance_m"] > 0.0


def test_the_cube_is_lifted(outcome):
    assert 0.02 < outcome[0].summary["rose_m"] < 0.04


def test_posture_and_contacts_are_the_planner_s(outcome):
    result, story = outcome
    seen = review(result.recording)
    assert seen.achieved, seen.reason
    (check,) = (check for check in seen.checks if check.name == "planner")
    assert check.passed and "ikspark's" in check.finding
    rows = {row.what: row for row in seen.ways}
    closing = rows["fingers to their faces"]
    assert closing.steps == closing.queries and not closing.unsolved and closing.sdps > 0
    assert closing.step.largest <= closing.step.bound == 0.15
    assert "way of the wrist: straight" in story
    assert len(seen.manifest["robots"]["hand"]["joints"]) == 24
