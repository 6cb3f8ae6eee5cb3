"""What the command line's options take: converters with one sentence for what they refuse."""

from __future__ import annotations

import argparse
from collections.abc import Callable


def file_name(text: str) -> str:
    """A file's name; an unset variable of the shell is none."""
    if not text.strip():
        raise argparse.ArgumentTypeError(f"{text!r} is not the name of a file")
    return text


def _number(text: str, kind: type, wanted: str, holds: Callable[[float], bool]) -> float:
    try:
        value: float = kind(text)
    except ValueError:
        value = float("nan")
    if not (value < float("inf") and holds(value)):
        raise argparse.ArgumentTypeError(f"{text!r} is not {wanted}")
    return value


def positive(text: str) -> float:
    """A number above zero."""
    return _number(text, float, "a positive number", lambda value: value > 0)


def seconds(text: str) -> float:
    """A number of seconds, zero or more."""
    return _number(text, float, "a number of seconds", lambda value: value >= 0)


def positive_int(text: str) -> int:
    """A whole number, one or more."""
    return int(_number(text, int, "a positive whole number", lambda value: value > 0))


def count(text: str) -> int:
    """A whole number, zero or more."""
    return int(_number(text, int, "a whole number, zero or more", lambda value: value >= 0))
