"""Comparing two recordings."""

from __future__ import annotations

import json
from pathlib import Path

import mujoco
import numpy as np
import pytest

from tests.record.conftest import RESULT, record_toy, toy_motion
from workcell.cli import main
from workcell.files import to_json
from workcell.record.read.compare import compare
from workcell.record.read.review import review
from workcell.record.write.recording import Recording


def test_a_run_is_the_same_as_itself(toy_file: Path) -> None:
    found = compare(review(toy_file), review(toy_file))
    assert found.same
    assert not found.facts
    assert all(row.change == (0.0, 0.0) for row in found.metrics)


def test_what_differs_is_named(tmp_path: Path, toy: mujoco.MjModel) -> None:
    times, _ = toy_motion(toy)
    record_toy(tmp_path / "a.rrd", toy)
    failed = RESULT | {"achieved": False, "status": "FAILED", "seed": 4}
    record_toy(tmp_path / "b.rrd", toy, failed, clearance=0.04 + 0.04 * np.cos(times))
    found = compare(review(tmp_path / "a.rrd"), review(tmp_path / "b.rrd"))
    assert not found.same
    assert ("status", "ACHIEVED", "FAILED") in found.facts
    assert ("seed", "3", "4") in found.facts
    change = {row.name: row.change for row in found.metrics}
    assert change["clearance"] == pytest.approx((-0.01, -0.01))
    assert change["tracking_error"] == pytest.approx((0.0, 0.0))


def test_events_of_one_run_alone_are_listed(tmp_path: Path, toy: mujoco.MjModel, toy_file: Path) -> None:
    with Recording(tmp_path / "b.rrd", task="toy", seed=3) as recording:
        recording.log_model(toy, {1: "robots/arm"}, toy.qpos0)
        recording.event(0.0, "start")
        recording.event(0.5, "the box has fallen")
    found = compare(review(toy_file), review(tmp_path / "b.rrd"))
    assert found.events == ("- the box is held", "+ the box has fallen")
    lacking = {row.name: row for row in found.metrics}["clearance"]
    assert lacking.second is None
    assert lacking.change is None
    json.loads(to_json(found.to_json()))


def test_the_command_line_compares_two_and_only_two(
    toy_file: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    with pytest.raises(SystemExit) as done:
        main(["review", "--compare", str(toy_file), str(toy_file)])
    assert done.value.code == 0
    assert "the same run" in capsys.readouterr().out
    for wrong in (["--compare", str(toy_file)], [str(toy_file), str(toy_file)]):
        with pytest.raises(SystemExit) as done:
            main(["review", *wrong])
        assert done.value.code == 2
        assert "compare" in capsys.readouterr().err


def test_joints_are_compared_over_the_time_that_both_cover(tmp_path: Path, toy: mujoco.MjModel) -> None:
    times, _ = toy_motion(toy)
    way = np.stack([times, 0.5 * times], axis=1)
    record_toy(tmp_path / "a.rrd", toy, **{"joint_positions/arm": way})
    record_toy(
        tmp_path / "b.rrd", toy, **{"joint_positions/arm": way + [[0.0, 0.25]] * np.sin(times)[:, None]}
    )
    (motion,) = compare(review(tmp_path / "a.rrd"), review(tmp_path / "b.rrd")).motions
    assert (motion.robot, motion.joint) == ("arm", "1")
    assert motion.largest == pytest.approx(0.25 * np.sin(times).max())
    assert motion.at == pytest.approx(np.pi / 2, abs=0.011)
