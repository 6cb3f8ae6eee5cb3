"""Height fields that are too large, refused by name before anything of their size is allocated."""

from __future__ import annotations

import re
import struct
from pathlib import Path
from typing import TYPE_CHECKING
from xml.etree import ElementTree

from workcell.errors import ModelError
from workcell.model.loading.limits import texts_of

if TYPE_CHECKING:
    import mujoco

MAX_POINTS = 1_000_000
"""Points of the grid of one height field."""
_ELEMENT = re.compile(r"<hfield\b[^>]*>")
_ATTRIBUTE = re.compile(r"(\w+)\s*=\s*[\"']([^\"']*)[\"']")
_NUMBER = re.compile(r"\s*\+?\d{1,18}\s*", re.ASCII)
_PNG = b"\x89PNG\r\n\x1a\n"


def refuse_large_grids(path: Path) -> None:
    """Raise ModelError for a height field whose `nrow` and `ncol` in an MJCF file, or its includes, are too large.

    MuJoCo's parser already takes memory for its points.
    """
    try:
        texts = texts_of(path)
    except ElementTree.ParseError:
        return  # MuJoCo says better what is wrong with it
    for element in (found for text in texts for found in _ELEMENT.findall(text)):
        given = dict(_ATTRIBUTE.findall(element))
        rows, columns = (_count(given.get(name, "")) for name in ("nrow", "ncol"))
        _check(rows, columns, given.get("name") or given.get("file", ""), path)


def _count(text: str) -> int:
    """A whole number as MuJoCo reads it; 0 where it is none."""
    return int(text) if _NUMBER.fullmatch(text) else 0


def _check(rows: int, columns: int, name: str, where: str | Path) -> None:
    if rows * columns > MAX_POINTS:
        raise ModelError(
            f"the height field {name!r} has {rows} x {columns} points",
            where=where,
            remedy=f"use a coarser one, of {MAX_POINTS:,} points at most (1000 x 1000)",
        )


def check_field_sizes(spec: mujoco.MjSpec, where: str | Path) -> None:
    """Raise ModelError for a height field of more than `MAX_POINTS` points: its numbers, or the head of its file."""
    for field in spec.hfields:
        rows, columns = int(field.nrow), int(field.ncol)
        if field.file:
            rows, columns = _size_of_file(_path_of(spec, str(field.file), where)) or (rows, columns)
        _check(rows, columns, str(field.name or field.file), where)


def _path_of(spec: mujoco.MjSpec, file: str, where: str | Path) -> Path:
    """Where a height field's file is: like meshes, in the folder that the compiler's `meshdir` names."""
    return Path(where).parent / (spec.meshdir or "") / file


def _size_of_file(path: Path) -> tuple[int, int] | None:
    """Rows and columns by the head of an image or of MuJoCo's own binary format; None: there is no such head."""
    try:
        with path.open("rb") as file:
            head = file.read(24)
        length = path.stat().st_size
    except OSError:
        return None
    if len(head) < 24:
        head += bytes(24 - len(head))
    if head.startswith(_PNG):
        columns, rows = struct.unpack(">II", head[16:24])
    else:
        rows, columns = struct.unpack("<ii", head[:8])
        if length != 8 + 4 * rows * columns:
            return None
    return (int(rows), int(columns)) if rows > 0 and columns > 0 else None
