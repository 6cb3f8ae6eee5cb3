"""The whole task: a recorded stream of poses followed live; gaps, lost tracking and a clock that runs backwards."""

import json

import numpy as np
import pytest

from workcell.cli.main import main
from workcell.errors import InputError, UnknownNameError
from workcell.model.loading.assets import find_task
from workcell.motion.live.stream_file import read_stream
from workcell.record.read.review import review
from workcell.task.run import run_task

TRACE = find_task("teleop").with_suffix(".csv")


def silent(_):
    return


@pytest.fixture(scope="module")
def outcome(tmp_path_factory):
    story = []
    out = tmp_path_factory.mktemp("teleop")
    return run_task("teleop", seed=1, out=out, say=story.append), "\n".join(story)


def test_the_stream_is_followed_and_what_is_wrong_with_it_is_told(outcome):
    result, story = outcome
    summary = result.summary
    assert result.achieved, result.sentence
    assert (
        summary["stream"] == "teleop.csv" and summary["stream_rows"] == 277 and summary["stream_faults"] == 4
    )
    assert (
        summary["live_jumps"] == 0 and summary["min_clearance_m"] > 0 and summary["goal_error_mean_m"] < 0.02
    )
    for reason in ("position is not finite", "its clock runs backwards", "no new goal for"):
        assert story.count(f"NO_GOAL ({reason}") <= 2 and f"NO_GOAL ({reason}" in story


def test_the_recording_alone_bears_it_out(outcome):
    seen = review(outcome[0].recording)
    assert seen.achieved, seen.reason
    assert seen.live is not None and seen.live.clean and seen.live.robots[0].statuses["NO_GOAL"] > 20
    paused = seen.series["live/position_error/sawyer"]
    assert np.isnan(paused.values[(paused.times > 4.15) & (paused.times < 4.3)]).any()


def test_another_trace_takes_its_place(tmp_path):
    rows = [row for row in read_stream(TRACE).rows if row.pose is not None][:40]
    lines = [
        json.dumps(
            dict(zip(("t", "x", "y", "z"), (row.stamp, *row.pose.position), strict=True))
            | dict(zip(("qw", "qx", "qy", "qz"), row.pose.quat_wxyz, strict=True))
            | {"tool": "sawyer"}
        )
        for row in rows
    ]
    (tmp_path / "hand.jsonl").write_text("\n".join(lines))
    result = run_task("teleop", out=tmp_path / "out", trace=tmp_path / "hand.jsonl", say=silent)
    assert result.achieved and result.summary["stream_rows"] == 40 and result.summary["simulated_s"] < 3.5


def test_traces_that_cannot_be_followed(tmp_path, capsys):
    with pytest.raises(InputError, match="can't be read"):
        run_task("teleop", out=tmp_path, trace=tmp_path / "none.csv", say=silent)
    with pytest.raises(InputError, match="follows no recorded poses"):
        run_task("blocked", out=tmp_path, trace=TRACE, say=silent)
    (tmp_path / "left.csv").write_text("t,x,y,z,qw,qx,qy,qz,tool\n0,0.5,0,0.3,0,1,0,0,left\n")
    with pytest.raises(UnknownNameError, match="no tool named 'left'"):
        run_task("teleop", out=tmp_path, trace=tmp_path / "left.csv", say=silent)
    (tmp_path / "bad.csv").write_text("t,x,y,z\n0,0,0,0\n")
    with pytest.raises(SystemExit) as ended:
        main(["run", "teleop", "--trace", str(tmp_path / "bad.csv"), "--out", str(tmp_path)])
    assert ended.value.code == 2 and "bad.csv:1: lacks qw" in capsys.readouterr().err


def test_a_stream_without_a_goal_is_not_followed(tmp_path):
    (tmp_path / "lost.csv").write_text("t,x,y,z,qw,qx,qy,qz\n0,nan,0,0.3,0,1,0,0\n0.5,nan,0,0.3,0,1,0,0\n")
    result = run_task("teleop", out=tmp_path / "out", trace=tmp_path / "lost.csv", say=silent)
    assert not result.achieved and "not the stream is followed" in result.sentence
