"""JSON summaries: whole or not at all."""

from __future__ import annotations

import json
from pathlib import Path

import numpy as np
import pytest

from workcell.errors import OutputError
from workcell.files import MOST_NESTED, parse_json, write_json_atomic


def test_values_come_back(tmp_path: Path) -> None:
    values = {
        "a": np.arange(3),
        "b": np.float64(0.25),
        "c": {"d": (1, None, True)},
        "path": Path("x"),
        "n": float("nan"),
    }
    written = write_json_atomic(tmp_path / "deep" / "er" / "s.json", values)
    assert json.loads(written.read_text()) == {
        "a": [0, 1, 2],
        "b": 0.25,
        "c": {"d": [1, None, True]},
        "path": "x",
        "n": None,
    }
    assert [p.name for p in written.parent.iterdir()] == ["s.json"]


def test_the_earlier_file_survives_a_failure(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    path = write_json_atomic(tmp_path / "s.json", {"run": 1})

    def full(_: int) -> None:
        raise OSError(28, "No space left on device")

    monkeypatch.setattr("os.fsync", full)
    with pytest.raises(OutputError, match=r"s\.json.*No space left on device"):
        write_json_atomic(path, {"run": 2})
    assert json.loads(path.read_text()) == {"run": 1}
    assert [p.name for p in tmp_path.iterdir()] == ["s.json"]


def test_a_folder_that_cannot_be_made(tmp_path: Path) -> None:
    (tmp_path / "file").write_text("in the way")
    with pytest.raises(OutputError, match="can't be written"):
        write_json_atomic(tmp_path / "file" / "s.json", {})


@pytest.mark.parametrize(
    ("text", "because"),
    [
        ('{"a": 1, "b": {"c": 1, "c": 2}}', "has the key 'c' twice"),
        ('{"\\ud800": 1, "\\ud800": 1}', "twice"),
        ("[" * (MOST_NESTED + 1) + "]" * (MOST_NESTED + 1), "nested too deeply"),
        ("[" * 100_000, "nested too deeply"),
        ("1" * 5000, "too many digits"),
        ('{"a": ', "Expecting value"),
    ],
)
def test_texts_that_say_two_things_or_have_no_end_are_refused(text: str, because: str) -> None:
    with pytest.raises(ValueError, match=because):
        parse_json(text)


def test_other_texts_are_read() -> None:
    nested = "[" * MOST_NESTED + "]" * MOST_NESTED
    assert json.dumps(parse_json(nested)) == nested
    assert parse_json('{"a": [1, 2.5, null, true], "b": {}}') == {"a": [1, 2.5, None, True], "b": {}}
