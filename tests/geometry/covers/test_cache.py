import json
import logging
from pathlib import Path

import numpy as np
import pytest

from workcell.geometry.covers.cache import cache_folder, cached_cover, content_key
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
    with pytest.MonkeyPatch.context() as patch:
        patch.setenv("WORKCELL_CACHE_DIR", "")
        return cover_pieces(PIECES, OVERSHOOT)


@pytest.fixture
def cover(truth):
    """Asks for the cover, and counts in `made` how often it had to be made."""

    def ask():
        return cached_cover(PIECES, OVERSHOOT, make)

    def make():
        ask.made += 1
        return tuple(array.copy() for array in truth)

    ask.made = 0
    return ask


def same(found, expected):
    return all(
        a.dtype == b.dtype and a.tobytes() == b.tobytes() for a, b in zip(found, expected, strict=True)
    )


def entry(folder):
    (note,) = (folder / "covers").glob("*.json")
    return note, note.with_suffix(".npz")


def test_covers_are_the_same_without_with_and_from_the_cache(folder, truth, cover):
    assert same(cover(), truth)
    note, arrays = entry(folder)
    assert sorted(path.name for path in note.parent.iterdir()) == [note.name, arrays.name]
    assert note.stem == content_key(PIECES, OVERSHOOT)
    found = cover()
    assert same(found, truth) and cover.made == 1 and not any(array.flags.writeable for array in found)
    assert json.loads(note.read_text())["spheres"] == len(truth[1])


def test_covers_of_pieces_are_kept_there_and_taken_from_there(folder):
    """What is found under a cover's key is believed, whatever it is; what was not found is kept."""
    balls = [(Piece("ball", "sphere", Pose.from_xyz([x, 0, 0]), np.array([0.1])),) for x in (0.2718, 0.3141)]
    planted = np.array([[0.1, 0.2, 0.3]]), np.array([0.4]), np.array([0.05])
    cached_cover(balls[0], OVERSHOOT, lambda: planted)
    assert same(cover_pieces(balls[0], OVERSHOOT), planted)
    made = cover_pieces(balls[1], OVERSHOOT)
    assert not any(array.flags.writeable for array in made)
    assert same(cached_cover(balls[1], OVERSHOOT, lambda: pytest.fail("it was not kept")), made)


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
def test_a_damaged_or_foreign_entry_is_reported_and_made_anew(folder, truth, cover, caplog, damage):
    cover()
    damage(*entry(folder))
    with caplog.at_level(logging.WARNING):
        assert same(cover(), truth)
    (record,) = caplog.records
    assert "damaged" in record.getMessage() and "made anew" in record.getMessage()
    caplog.clear()
    assert same(cover(), truth) and not caplog.records and cover.made == 2


def test_a_folder_that_can_not_be_written_does_no_harm(tmp_path, monkeypatch, truth, cover, caplog):
    blocked = tmp_path / "file"
    blocked.write_text("not a folder")
    monkeypatch.setenv("WORKCELL_CACHE_DIR", str(blocked))
    assert same(cover(), truth) and not caplog.records
    assert blocked.read_text() == "not a folder"


def test_where_the_folder_is(monkeypatch, tmp_path, truth, cover):
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
