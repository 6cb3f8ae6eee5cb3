"""Strict reading of JSON (rule 2.1): no key twice, not too large, not too deep, and numbers that are finite."""

from __future__ import annotations

import json
import math
import stat
from pathlib import Path
from typing import Any

MOST_BYTES = 256 * 1024 * 1024
DEEPEST = 16
MOST_DIGITS = 308


class RefusedError(Exception):
    """Why a file or a proof is not accepted."""


def read_text(file: Path, most_bytes: int) -> str:
    """The text of a regular file.

    Raises:
        RefusedError: it is none, is too large, or is not UTF-8.
    """
    try:
        about = file.stat()
        if not stat.S_ISREG(about.st_mode):
            raise RefusedError(f"{file} is no regular file")
        if about.st_size > most_bytes:
            raise RefusedError(f"{file} is larger than {most_bytes} bytes")
        return file.read_text(encoding="utf-8")
    except (OSError, ValueError) as error:
        raise RefusedError(f"{file} can't be read: {error}") from None


def parse(text: str) -> Any:
    """The value of a JSON text (rule 2.1).

    Raises:
        RefusedError: it is no JSON of the strict sort.
    """
    if len(text) > MOST_BYTES:
        raise RefusedError(f"more than {MOST_BYTES} characters of JSON")
    try:
        value = json.loads(
            text,
            object_pairs_hook=_without_doubles,
            parse_int=_whole,
        )
    except (ValueError, RecursionError) as error:
        raise RefusedError(f"no JSON: {error}") from None
    level, depth = [value] if isinstance(value, dict | list) else [], 0
    while level:
        depth += 1
        inner = (v for n in level for v in (n.values() if isinstance(n, dict) else n))
        level = [v for v in inner if isinstance(v, dict | list)]
        if depth > DEEPEST:
            raise RefusedError(f"JSON nested more than {DEEPEST} deep")
    return value


def _without_doubles(pairs: list[tuple[str, Any]]) -> dict[str, Any]:
    found = dict(pairs)
    if len(found) != len(pairs):
        raise RefusedError("a JSON object has a key twice")
    return found


def _whole(text: str) -> int:
    if len(text.lstrip("-")) > MOST_DIGITS:
        raise RefusedError(f"a whole number of more than {MOST_DIGITS} digits")
    return int(text)


def double(value: Any, what: str) -> float:
    """A JSON number as the double nearest to it (rule 1.1).

    Raises:
        RefusedError: it is no number.
    """
    if isinstance(value, bool) or not isinstance(value, int | float):
        raise RefusedError(f"{what} is no number")
    try:
        nearest = float(value)
    except OverflowError:
        nearest = math.inf
    if not math.isfinite(nearest):
        raise RefusedError(f"{what} is no finite double")
    return nearest


def doubles(values: Any, count: int, what: str) -> tuple[float, ...]:
    """A JSON list of so many numbers.

    Raises:
        RefusedError: it is none.
    """
    if not isinstance(values, list) or len(values) != count:
        raise RefusedError(f"{what} is no list of {count} numbers")
    return tuple(double(value, what) for value in values)


def member(document: Any, key: str, kind: type, what: str) -> Any:
    """What an object has under a key.

    Raises:
        RefusedError: it is no object, or has no such member of that type.
    """
    if not isinstance(document, dict) or not isinstance(document.get(key), kind):
        raise RefusedError(f"{what} has no {key!r} of the type {kind.__name__}")
    return document[key]
