"""Reviews: the verdict follows from the file, and damaged files give what is left of them."""

from __future__ import annotations

import io
import json
from collections.abc import Callable
from pathlib import Path

import mujoco
import numpy as np
import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st
from rich.console import Console

from tests.record.conftest import RESULT, record_toy, toy_motion
from workcell.cli import main
from workcell.errors import RecordingError
from workcell.record.read.review import Review, review
from workcell.record.show.moments import key_moments
from workcell.record.show.terminal import review_table
from workcell.record.write.recording import Recording
from workcell.record.write.scene_log import FORMAT


def text_of(result: Review) -> str:
    console = Console(file=io.StringIO(), width=160)
    console.print(review_table(result))
    return console.file.getvalue()  # type: ignore[attr-defined]


def test_an_achieved_run(toy_file: Path) -> None:
    result = review(toy_file)
    assert result.achieved
    assert result.missing == ()
    assert [check.passed for check in result.checks] == [True] * 4
    row = next(row for row in result.metrics if row.name == "clearance")
    assert row.minimum == pytest.approx(0.05 + 0.04 * np.cos(2.0), abs=1e-12)
    assert (row.time_of_minimum, row.time_of_maximum) == pytest.approx((2.0, 0.0))
    assert row.final == row.minimum
    moved = next(row for row in result.objects if row.name == "box")
    assert moved.moved == pytest.approx(0.2, abs=1e-6)
    assert moved.rose == pytest.approx(0.2, abs=1e-6)
    assert [line.text for line in result.events] == ["start", "the box is held"]


def test_report_and_json_say_the_same(toy_file: Path) -> None:
    result = review(toy_file)
    text, document = text_of(result), json.loads(json.dumps(result.to_json()))
    assert document["verdict"] == "achieved"
    assert "toy: achieved" in text
    for line in document["events"]:
        assert line["text"] in text
    for row in document["metrics"]:
        assert row["name"] in text
    assert document["entities"]["metrics/clearance"]["rows"] == 101


def test_a_run_that_failed(tmp_path: Path, toy: mujoco.MjModel) -> None:
    result = {**RESULT, "achieved": False, "status": "FAILED", "sentence": "the box fell"}
    found = review(record_toy(tmp_path / "toy.rrd", toy, result))
    assert found.verdict == "not achieved"
    assert found.reason == "the box fell"


@pytest.mark.parametrize(
    ("result", "clearance", "check"),
    [
        ({}, -0.001, "clearance"),
        ({"min_clearance_m": 0.02}, 0.005, "claimed clearance"),
        ({"tracking_limit_m": 1e-4}, 0.005, "tracking"),
    ],
)
def test_a_claim_that_the_recording_contradicts(
    tmp_path: Path, toy: mujoco.MjModel, result: dict[str, float], clearance: float, check: str
) -> None:
    values = np.full(101, 0.03)
    values[50] = clearance
    found = review(record_toy(tmp_path / "toy.rrd", toy, {**RESULT, **result}, clearance=values))
    assert found.verdict == "not achieved"
    assert [c.name for c in found.checks if not c.passed] == [check]
    assert "claims" in found.reason


def test_a_grasp_that_moved_nothing_and_an_error_in_the_log(tmp_path: Path, toy: mujoco.MjModel) -> None:
    times, _ = toy_motion(toy)
    with Recording(tmp_path / "toy.rrd", task="toy") as recording:
        recording.log_model(toy, {2: "objects/box"}, toy.qpos0)
        recording.log_states(times, np.tile(toy.qpos0, (len(times), 1)), {"clearance": np.ones(len(times))})
        recording.event(1.0, "grasp the box")
        recording.event(1.5, "unintended contact: arm and shelf", "ERROR")
        recording.set_result(RESULT)
    found = review(tmp_path / "toy.rrd")
    assert found.verdict == "not achieved"
    assert {c.name for c in found.checks if not c.passed} == {"grasp", "errors"}


def test_without_a_result_the_verdict_is_open(tmp_path: Path, toy: mujoco.MjModel) -> None:
    with Recording(tmp_path / "toy.rrd", task="toy") as recording:
        recording.log_model(toy, {}, toy.qpos0)
    found = review(tmp_path / "toy.rrd")
    assert found.verdict == "incomplete"
    assert "no result" in found.missing
    assert "no metrics" in found.missing
    assert "missing: no result" in text_of(found)


@pytest.fixture(scope="module")
def toy_bytes(tmp_path_factory: pytest.TempPathFactory) -> bytes:
    from tests.record.conftest import TOY

    folder = tmp_path_factory.mktemp("toy")
    return record_toy(folder / "toy.rrd", mujoco.MjModel.from_xml_string(TOY)).read_bytes()


@settings(max_examples=25, deadline=None, suppress_health_check=[HealthCheck.function_scoped_fixture])
@given(share=st.floats(0.0, 0.999))
def test_a_file_cut_anywhere_gives_what_is_left_or_a_clear_error(
    tmp_path: Path, toy_bytes: bytes, share: float
) -> None:
    path = tmp_path / "cut.rrd"
    path.write_bytes(toy_bytes[: int(share * len(toy_bytes))])
    try:
        found = review(path)
    except RecordingError as error:
        assert "cut.rrd" in str(error)
        assert share < 0.2
    else:
        assert any("not finished" in text for text in found.missing)


@settings(max_examples=25, deadline=None, suppress_health_check=[HealthCheck.function_scoped_fixture])
@given(share=st.floats(0.05, 0.95), seed=st.integers(0, 1000))
def test_a_damaged_file_gives_the_rest(tmp_path: Path, toy_bytes: bytes, share: float, seed: int) -> None:
    damaged = bytearray(toy_bytes)
    start = int(share * len(damaged))
    damaged[start : start + 30] = np.random.default_rng(seed).bytes(30)
    path = tmp_path / "damaged.rrd"
    path.write_bytes(damaged)
    try:
        found = review(path)
    except RecordingError as error:
        assert "nothing in this recording can be read" in str(error)
    else:
        assert found.inventory


def test_half_a_stopped_recording_has_its_scene_and_says_what_is_missing(
    tmp_path: Path, toy: mujoco.MjModel
) -> None:
    times, qpos = toy_motion(toy, count=1001, seconds=20.0)
    with Recording(tmp_path / "toy.rrd", task="toy") as recording:
        recording.log_model(toy, {}, toy.qpos0)
        for k in range(0, len(times), 10):
            recording.log_states(times[k : k + 10], qpos[k : k + 10], {"clearance": times[k : k + 10]})
        data = recording.partial_path.read_bytes()
        recording.set_result(RESULT)
    (tmp_path / "half.rrd").write_bytes(data[: len(data) // 2])
    found = review(tmp_path / "half.rrd")
    assert found.verdict == "incomplete"
    assert 2.0 < found.duration < 19.0
    assert any("cut off" in text for text in found.missing)
    assert "no result" in found.missing
    assert any(thing.path.endswith("box/wedge") for thing in found.stage.things)


def test_a_damaged_recording_of_an_achieved_run_is_not_called_achieved(toy_file: Path) -> None:
    data = toy_file.read_bytes()
    toy_file.write_bytes(data[: len(data) * 3 // 4])
    assert review(toy_file).verdict == "incomplete"


@pytest.mark.parametrize("content", [b"", b"RR", b"hello, this is no recording", b"PK\x03\x04" * 20])
def test_not_a_recording(tmp_path: Path, content: bytes) -> None:
    path = tmp_path / "x.rrd"
    path.write_bytes(content)
    with pytest.raises(RecordingError, match=r"x\.rrd: this is not an \.rrd recording"):
        review(path)


def test_a_missing_file_and_a_folder(tmp_path: Path) -> None:
    with pytest.raises(RecordingError, match="No such file"):
        review(tmp_path / "nothing.rrd")
    with pytest.raises(RecordingError, match="directory"):
        review(tmp_path)


def test_a_recording_of_another_version_says_which(tmp_path: Path, toy_bytes: bytes) -> None:
    """Only the header can be understood: the blocks of a later version are a closed book."""
    path = tmp_path / "later.rrd"
    path.write_bytes(b"RRF2" + bytes([0, 99, 2, 0]) + b"\xff" * (len(toy_bytes) // 4))
    with pytest.raises(RecordingError, match=r"written by Rerun 0\.99\.2"):
        review(path)


def test_a_recording_of_something_else(tmp_path: Path) -> None:
    import rerun as rr

    stream = rr.RecordingStream("kitchen_timer")
    stream.save(tmp_path / "other.rrd")
    stream.log("a", rr.TextLog("tick"))
    stream.disconnect()
    with pytest.raises(RecordingError, match="kitchen_timer"):
        review(tmp_path / "other.rrd")


def test_key_moments_are_the_start_the_events_and_the_end(toy_file: Path) -> None:
    moments = key_moments(review(toy_file))
    assert len(moments) == 6
    assert [m.time for m in moments] == sorted(m.time for m in moments)
    assert (moments[0].time, moments[-1].time) == (0.0, 2.0)
    assert any(m.caption == "the box is held" and m.time == 1.0 for m in moments)


@pytest.mark.parametrize(
    ("make", "code", "words"),
    [
        (lambda data: data, 0, "toy: achieved"),
        (lambda data: data[: len(data) * 3 // 4], 1, "missing: the file was not finished"),
        (lambda data: data[:200], 2, "nothing in this recording can be read"),
        (lambda data: b"", 2, "an empty file"),
        (lambda data: b"\x89PNG" + data[4:], 2, "this is not an .rrd recording"),
        (lambda data: b"RRF2" + bytes([0, 99, 2, 0]) + b"\xff" * 4000, 2, "written by Rerun 0.99.2"),
    ],
    ids=["whole", "cut", "header only", "empty", "a picture", "another version"],
)
def test_exit_code_and_words_of_the_command(
    tmp_path: Path,
    toy_bytes: bytes,
    capsys: pytest.CaptureFixture[str],
    make: Callable[[bytes], bytes],
    code: int,
    words: str,
) -> None:
    """0: achieved; 1: read, but not (known to be) achieved; 2: not a recording that can be read, in one message."""
    path = tmp_path / "x.rrd"
    path.write_bytes(make(toy_bytes))
    with pytest.raises(SystemExit) as done:
        main(["review", str(path)])
    told = capsys.readouterr()
    assert done.value.code == code
    assert words in " ".join((told.err if code == 2 else told.out).split())
    if code == 2:
        assert told.out == ""
        assert "x.rrd" in told.err


def test_a_later_layout_is_read_and_named(
    tmp_path: Path, toy: mujoco.MjModel, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr("workcell.record.write.scene_log.FORMAT", FORMAT + 1)
    found = review(record_toy(tmp_path / "toy.rrd", toy))
    assert any(f"version {FORMAT + 1}, this reads version {FORMAT}" in text for text in found.missing)
    assert found.metrics
    assert f"missing: the layout of this file is version {FORMAT + 1}" in text_of(found)
