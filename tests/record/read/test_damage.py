"""Recordings changed after they were written: none is taken for whole, none takes the reader along."""

import os
import shutil
import signal
import subprocess
import sys
import tempfile
import time
from pathlib import Path

import mujoco
import numpy as np
import pytest

from tests.record.conftest import RESULT, TOY, toy_motion
from workcell.errors import RecordingError
from workcell.record.read import child
from workcell.record.read.reader import read
from workcell.record.read.review import review
from workcell.record.write.recording import Recording
from workcell.record.write.rrd_frames import DATA, HEADER_BYTES, Frames, split_frames
from workcell.record.write.seal import KEY

FAILED = {**RESULT, "achieved": False, "status": "FAILED", "sentence": "the box fell"}


def recorded(path: Path, result: dict, *, partial: Path | None = None) -> bytes:
    """A finished recording with errors in its log where it failed; its state while open goes to `partial`."""
    model = mujoco.MjModel.from_xml_string(TOY)
    times, qpos = toy_motion(model, count=401, seconds=8.0)
    with Recording(path, task="toy") as recording:
        recording.log_model(model, {2: "objects/box"}, model.qpos0)
        for k in range(0, 401, 40):
            part = slice(k, k + 40)
            size = len(times[part])
            recording.log_states(
                times[part], qpos[part], {"clearance": np.ones(size), "tracking_error": np.zeros(size)}
            )
            recording.event(times[k], "a line of the log")
        if not result["achieved"]:
            recording.event(7.0, "unintended contact: arm and shelf", "ERROR")
        if partial is not None:
            shutil.copy(recording.partial_path, partial)
        recording.set_result(result)
    return path.read_bytes()


@pytest.fixture(scope="module")
def files(tmp_path_factory) -> dict[str, bytes]:
    folder = tmp_path_factory.mktemp("whole")
    achieved = recorded(folder / "achieved.rrd", RESULT, partial=folder / "open.rrd")
    failed = recorded(folder / "failed.rrd", FAILED)
    return {"achieved": achieved, "failed": failed, "open": (folder / "open.rrd").read_bytes()}


def joined(whole: Frames, frames: list[tuple[int, bytes]]) -> bytes:
    return whole.header + b"".join(frame for _, frame in frames) + whole.index


def mutants(files: dict[str, bytes], rng: np.random.Generator, count: int):
    """Names and bytes: bits flipped, ends cut off, blocks dropped, doubled, put elsewhere, or from the other file."""
    kinds = ("flip", "cut", "drop", "double", "swap", "foreign", "append", "garble")
    for k in range(count):
        kind, name = kinds[k % len(kinds)], ("achieved", "failed")[k // len(kinds) % 2]
        data, other = files[name], files["failed" if name == "achieved" else "achieved"]
        whole, strange = split_frames(data), split_frames(other)
        frames, at = list(whole.frames), int(rng.integers(len(whole.frames)))
        foreign = strange.frames[int(rng.integers(len(strange.frames)))]
        if kind == "flip":
            damaged = bytearray(data)
            damaged[int(rng.integers(4, len(data)))] ^= 1 << int(rng.integers(8))
            yield kind, bytes(damaged)
        elif kind == "cut":
            yield kind, data[: int(rng.integers(len(data)))]
        elif kind == "drop":
            yield kind, joined(whole, frames[:at] + frames[at + 1 :])
        elif kind == "double":
            yield kind, joined(whole, [*frames[:at], frames[at], *frames[at:]])
        elif kind == "swap":
            to = (at + 1 + int(rng.integers(len(frames) - 1))) % len(frames)
            frames[at], frames[to] = frames[to], frames[at]
            yield kind, joined(whole, frames)
        elif kind == "foreign":
            yield kind, joined(whole, [*frames[:at], foreign, *frames[at + 1 :]])
        elif kind == "append":
            yield kind, joined(whole, [*frames, foreign])
        else:
            damaged = bytearray(data)
            start = int(rng.integers(HEADER_BYTES, len(data) - 40))
            damaged[start : start + 40] = rng.bytes(40)
            yield kind, bytes(damaged)


@pytest.mark.parametrize("seed", range(4))
def test_no_changed_recording_is_taken_for_whole(
    seed: int, files: dict[str, bytes], tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(tempfile, "tempdir", str(tmp_path / "scratch"))
    (tmp_path / "scratch").mkdir()
    for k, (kind, data) in enumerate(mutants(files, np.random.default_rng(seed), 24)):
        path = tmp_path / f"{k}.rrd"
        path.write_bytes(data)
        try:
            found = review(path)
        except RecordingError as error:
            assert str(path) in str(error)
            continue
        assert found.verdict == "incomplete", kind
        assert found.missing and not found.checked, kind
    assert not list((tmp_path / "scratch").iterdir())


def test_seals_are_read_as_they_were_written(tmp_path: Path) -> None:
    """Compression of random digits goes another way each time."""
    for k in range(12):
        recorded(tmp_path / f"{k}.rrd", RESULT, partial=tmp_path / f"{k}.open.rrd")
        assert read(tmp_path / f"{k}.rrd").missing == ()
        assert [text[:24] for text in read(tmp_path / f"{k}.open.rrd").missing] == [
            "the file was not finished"[:24]
        ]


def test_whole_recordings_are_checked(files: dict[str, bytes], tmp_path: Path) -> None:
    for name, verdict in (("achieved", "achieved"), ("failed", "not achieved")):
        path = tmp_path / f"{name}.rrd"
        path.write_bytes(files[name])
        found = review(path)
        assert (found.verdict, found.checked, found.missing) == (verdict, True, ())
        assert found.to_json()["checked"] is True


def test_a_failed_run_does_not_succeed_by_what_another_run_said(
    files: dict[str, bytes], tmp_path: Path
) -> None:
    """The result of a run that succeeded at the end, and the errors out of the log: the file says so."""
    failed, achieved = split_frames(files["failed"]), split_frames(files["achieved"])
    known = {frame for _, frame in failed.frames}
    claims = [f for f in achieved.frames if b"result" in f[1] and f[1] not in known]
    assert claims
    for frames in (
        [*failed.frames, *claims],
        [*failed.frames[:-1], *claims, failed.frames[-1]],
        [f for f in failed.frames if b"TextLog" not in f[1]] + claims,
        [f for f in failed.frames if KEY.encode() not in f[1]] + claims,
    ):
        path = tmp_path / "x.rrd"
        path.write_bytes(joined(failed, frames))
        found = review(path)
        assert found.verdict == "incomplete"
        assert "No seal" in str(found.missing) or found.missing


def test_what_is_damaged_is_counted_and_the_rest_is_read(files: dict[str, bytes], tmp_path: Path) -> None:
    whole = split_frames(files["achieved"])
    at = next(k for k, (_, f) in enumerate(whole.frames) if b"metrics/clearance" in f and b"Scalars" in f)
    frame = bytearray(whole.frames[at][1])
    frame[-5] ^= 255
    frames = [*whole.frames[:at], (DATA, bytes(frame)), *whole.frames[at + 1 :]]
    path = tmp_path / "x.rrd"
    path.write_bytes(joined(whole, frames))
    found = review(path)
    assert f"1 of {len(whole.frames) - 1} blocks are damaged or missing" in found.missing
    assert any("rows of metrics/clearance" in text for text in found.missing)
    assert {row.name for row in found.metrics} == {"tracking_error"}


@pytest.mark.parametrize("share", [0.3, 0.6, 1.0])
def test_a_run_that_was_killed_is_vouched_for_as_far_as_it_got(
    share: float, files: dict[str, bytes], tmp_path: Path
) -> None:
    path = tmp_path / "open.rrd"
    path.write_bytes(files["open"][: int(share * len(files["open"]))])
    contents, found = read(path), review(path)
    assert contents.sealed and found.verdict == "incomplete"
    assert any("not finished" in text for text in found.missing)
    assert not any("damaged or missing" in text for text in found.missing)
    assert found.duration > (7.0 if share == 1.0 else 0.5)


def test_blocks_out_of_an_open_recording_are_missed(files: dict[str, bytes], tmp_path: Path) -> None:
    whole = split_frames(files["open"])
    path = tmp_path / "open.rrd"
    for at in (2, len(whole.frames) // 2, len(whole.frames) - 3):
        path.write_bytes(joined(whole, [*whole.frames[:at], *whole.frames[at + 1 :]]))
        assert any("blocks are" in text for text in review(path).missing)


def test_a_recording_of_the_first_layout_is_read_and_said_to_be_unchecked(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr("workcell.record.write.scene_log.FORMAT", 1)
    whole = split_frames(recorded(tmp_path / "x.rrd", RESULT))
    (tmp_path / "x.rrd").write_bytes(joined(whole, [f for f in whole.frames if KEY.encode() not in f[1]]))
    found = review(tmp_path / "x.rrd")
    assert (found.verdict, found.checked) == ("achieved", False)
    assert "unchecked" in found.reason


def test_a_reader_that_aborts_ends_alone(files: dict[str, bytes], tmp_path: Path) -> None:
    """The child dies of a file, the next one reads on."""
    path = tmp_path / "x.rrd"
    path.write_bytes(files["achieved"])
    child.decode(path)
    process = child._CHILD._process
    assert process is not None
    os.kill(process.pid, signal.SIGABRT)
    process.wait()
    assert review(path).achieved
    process = child._CHILD._process
    assert process is not None
    os.kill(process.pid, signal.SIGSTOP)

    def abort() -> None:
        time.sleep(0.3)
        os.kill(process.pid, signal.SIGKILL)

    import threading

    threading.Thread(target=abort).start()
    with pytest.raises(child.UnreadableError, match=r"broke off \(exit -9\)"):
        child.decode(path)
    assert review(path).achieved


def test_a_pipe_in_place_of_a_recording_is_not_read_for_ever(tmp_path: Path) -> None:
    os.mkfifo(tmp_path / "pipe.rrd")
    with pytest.raises(RecordingError, match="a device or a pipe stands there"):
        read(tmp_path / "pipe.rrd")


def test_the_child_ends_with_the_process_that_asked(files: dict[str, bytes], tmp_path: Path) -> None:
    path = tmp_path / "x.rrd"
    path.write_bytes(files["achieved"])
    code = (
        "from workcell.record.read import child; from pathlib import Path; import sys, os;"
        "child.decode(Path(sys.argv[1])); print(child._CHILD._process.pid, flush=True); os._exit(1)"
    )
    done = subprocess.run(
        [sys.executable, "-c", code, str(path)], stdout=subprocess.PIPE, text=True, check=False
    )
    pid = int(done.stdout)
    for _ in range(100):
        if not Path(f"/proc/{pid}").exists() or "Z" in Path(f"/proc/{pid}/stat").read_text().split()[2]:
            break
        time.sleep(0.05)
    else:
        pytest.fail("the child lives on")
