import json
import logging
from pathlib import Path

import numpy as np
import pytest

from workcell.geometry.covers import outer as spheres
from workcell.geometry.covers.cache import cache_folder, content_key
from workcell.geometry.covers.outer import cover_pieces
from workcell.geometry.types import Piece
from workcell.pose import Pose

PIECES = (
    Piece("can", "cylinder", Pose.from_xyz([0.1, 0, 0]), np.array([0.04, 0.05])),
    Piece("lid", "box", Pose.from_xyz([0.1, 0, 0.06]), np.array([0.05, 0.05, 0.01])),
)
OVERSHOOT = 0.03


@pytest.fixture
def folder(tmp_path, monkeypatch):
    monkeypatch.setenv("WORKCELL_CACHE_DIR", str(tmp_path))
    return tmp_path


@pytest.fixture(scope="module")
def truth():
    return spheres._cover(PIECES, OVERSHOOT)


def cover():
    """As in a new process."""
    spheres._covers.clear()
    return cover_pieces(PIECES, OVERSHOOT)


def same(found, expected):
    return all(
        a.dtype == b.dtype and a.tobytes() == b.tobytes() and not a.flags.writeable
        for a, b in zip(found, expected, strict=True)
    )


def entry(folder):
    (note,) = (folder / "covers").glob("*.json")
    return note, note.with_suffix(".npz")


def test_covers_are_the_same_without_with_and_from_the_cache(folder, truth, monkeypatch):
    assert same(cover(), truth)
    note, arrays = entry(folder)
    assert sorted(path.name for path in note.parent.iterdir()) == [note.name, arrays.name]
    assert note.stem == content_key(PIECES, OVERSHOOT)
    monkeypatch.setattr(spheres, "_cover", lambda *_: pytest.fail("the cover was made again"))
    assert same(cover(), truth)
    assert json.loads(note.read_text())["spheres"] == len(truth[1])


def truncate(note, arrays):
    arrays.write_bytes(arrays.read_bytes()[:100])


def empty(note, arrays):
    arrays.write_bytes(b"")


def lose(note, arrays):
    arrays.unlink()


def garble(note, arrays):
    note.write_bytes(b"\xff{")


def shrink(note, arrays):
    with np.load(arrays) as file:
        values = dict(file)
    values["radius"] = values["radius"] - 1e-3
    np.savez(arrays, **values)


def pickle(note, arrays):
    with np.load(arrays) as file:
        values = dict(file)
    np.savez(arrays, **{**values, "radius": np.array([{}], dtype=object)})


def reshape(note, arrays):
    with np.load(arrays) as file:
        values = dict(file)
    np.savez(arrays, **{**values, "radius": np.float64(1.0)})


def replace(note, arrays):
    note.write_text(json.dumps({**json.loads(note.read_text()), "key": "0" * 64}))


def listed(note, arrays):
    note.write_text("[]")


@pytest.mark.parametrize(
    "damage",
    [truncate, empty, lose, garble, shrink, pickle, reshape, replace, listed],
    ids=lambda f: f.__name__,
)
def test_a_damaged_or_foreign_entry_is_reported_and_made_anew(folder, truth, caplog, damage):
    cover()
    damage(*entry(folder))
    with caplog.at_level(logging.WARNING):
        assert same(cover(), truth)
    (record,) = caplog.records
    assert "damaged" in record.getMessage() and "made anew" in record.getMessage()
    caplog.clear()
    assert same(cover(), truth) and not caplog.records


def test_a_folder_that_can_not_be_written_does_no_harm(tmp_path, monkeypatch, truth, caplog):
    blocked = tmp_path / "file"
    blocked.write_text("not a folder")
    monkeypatch.setenv("WORKCELL_CACHE_DIR", str(blocked))
    assert same(cover(), truth) and not caplog.records
    assert blocked.read_text() == "not a folder"


def test_where_the_folder_is(monkeypatch, tmp_path, truth):
    monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path))
    monkeypatch.setenv("WORKCELL_CACHE_DIR", "")
    assert cache_folder() is None
    assert same(cover(), truth) and not list(tmp_path.iterdir())
    monkeypatch.delenv("WORKCELL_CACHE_DIR")
    assert cache_folder() == tmp_path / "workcell"
    monkeypatch.setenv("XDG_CACHE_HOME", "relative")
    monkeypatch.setattr(Path, "home", lambda: tmp_path / "home")
    assert cache_folder() == tmp_path / "home" / ".cache" / "workcell"


def test_the_key_tells_contents_apart():
    can, lid = PIECES
    longer = Piece("can", "cylinder", can.pose, np.array([0.04, 0.051]))
    moved = Piece("can", "cylinder", Pose.from_xyz([0.1, 0, 1e-12]), can.size)
    capsule = Piece("can", "capsule", can.pose, can.size)
    renamed = Piece("tin", "cylinder", can.pose, can.size)
    keys = [
        content_key(pieces, 0.03) for pieces in ([can], [longer], [moved], [capsule], [can, lid], [lid, can])
    ]
    assert len({*keys, content_key([can], 0.02)}) == 7
    assert content_key([renamed], 0.03) == keys[0]
