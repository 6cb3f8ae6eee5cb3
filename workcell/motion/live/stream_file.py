"""Files of recorded streams: CSV with a header, or JSON lines; docs/streams.md describes them.

What no stream could have said (a column that is missing, a word for a number) is refused with file and line.
"""

from __future__ import annotations

import csv
import json
import math
from collections.abc import Iterator, Mapping, Sequence
from pathlib import Path
from typing import Any

from workcell.errors import InputError, UnknownNameError
from workcell.files import parse_json, regular_text
from workcell.motion.live.stream import COLUMNS, TOOL, GoalStream, StreamRow, row_of


def read_stream(path: str | Path) -> GoalStream:
    """A stream of a CSV file with a header, or of JSON lines; what it is shows in its first character.

    Raises:
        InputError: the file can't be read, is no such text, or a line of it says what no stream could; with the line.
    """
    path = Path(path)
    try:
        text = regular_text(path)
    except OSError as error:
        raise InputError(f"can't be read: {error.strerror}", where=path) from None
    except UnicodeDecodeError:
        raise InputError(
            "is not a text file", where=path, remedy="CSV with a header, or JSON lines"
        ) from None
    lines = [
        (number, line)
        for number, line in enumerate(text.split("\n"), start=1)
        if line.strip() and not line.lstrip().startswith("#")
    ]
    if not lines:
        raise InputError("holds no rows", where=path, remedy=f"a header {','.join(COLUMNS)}, and rows")
    read = _json_rows if lines[0][1].lstrip().startswith("{") else _csv_rows
    rows = tuple(read(path, lines))
    if not rows:
        raise InputError("holds a header and no rows", where=path, remedy="one row at least")
    return GoalStream(str(path), rows)


def _csv_rows(path: Path, lines: list[tuple[int, str]]) -> Iterator[StreamRow]:
    number, head = lines[0]
    names = [name.strip() for name in _cells(path, number, head)]
    _check_names(f"{path}:{number}", names)
    for number, line in lines[1:]:
        at = f"{path}:{number}"
        cells = _cells(path, number, line)
        if len(cells) != len(names):
            raise InputError(f"has {len(cells)} cells, the header {len(names)}", where=at)
        told = dict(zip(names, (cell.strip() for cell in cells), strict=True))
        values = {name: _number(told[name], f"{at}: {name}") for name in COLUMNS}
        yield row_of(values, _tool(told, at))


def _cells(path: Path, number: int, line: str) -> list[str]:
    try:
        return next(csv.reader([line], strict=True))
    except csv.Error as error:
        raise InputError(f"is no line of CSV: {error}", where=f"{path}:{number}") from None


def _number(cell: str, at: str) -> float:
    try:
        return float(cell)
    except ValueError:
        raise InputError(f"{cell[:40]!r} is no number", where=at) from None


def _json_rows(path: Path, lines: list[tuple[int, str]]) -> Iterator[StreamRow]:
    for number, line in lines:
        at = f"{path}:{number}"
        try:
            told = parse_json(line)
        except json.JSONDecodeError as error:
            raise InputError(f"is not JSON ({error.msg}, column {error.colno})", where=at) from None
        except ValueError as error:
            raise InputError(str(error), where=at) from None
        if not isinstance(told, dict):
            raise InputError("is no JSON object", where=at, remedy=f"keys {', '.join(COLUMNS)}")
        _check_names(at, list(told))
        yield row_of({name: _json_number(told[name], f"{at}: {name}") for name in COLUMNS}, _tool(told, at))


def _json_number(value: Any, at: str) -> float:
    """A number; JSON has no nan and says null in its place."""
    if value is None:
        return math.nan
    if isinstance(value, bool) or not isinstance(value, (int, float)):
        raise InputError(f"{str(value)[:40]!r} is no number", where=at)
    try:
        return float(value)
    except OverflowError:
        return math.inf


def _check_names(at: str, names: Sequence[str]) -> None:
    missing = [name for name in COLUMNS if name not in names]
    if missing:
        raise InputError(f"lacks {', '.join(missing)}", where=at, remedy=f"columns {', '.join(COLUMNS)}")
    twice = next((name for k, name in enumerate(names) if name in names[:k]), None)
    if twice is not None:
        raise InputError(f"has {twice!r} twice", where=at)
    for name in names:
        if name not in (*COLUMNS, TOOL):
            raise UnknownNameError("column", name, (*COLUMNS, TOOL), where=at)


def _tool(told: Mapping[str, Any], at: str) -> str:
    """The tool that a row names; empty where the file names none."""
    tool = told.get(TOOL, "")
    if TOOL in told and (not isinstance(tool, str) or not tool):
        raise InputError("names no tool", where=at, remedy=f"a name in {TOOL!r}, or no such column")
    return str(tool)
