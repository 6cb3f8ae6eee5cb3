"""Entity paths taken apart: names may hold slashes and spaces, which stand escaped in a path."""

from __future__ import annotations

import re

_PART = re.compile(r"(?:\\.|[^/\\])+")


def names_of(path: str) -> list[str]:
    """The names along a path, as they were before they were escaped."""
    return [re.sub(r"\\(.)", r"\1", part) for part in _PART.findall(path)]


def above(path: str) -> str:
    """The path of the entity above one; empty at the top."""
    parts = _PART.findall(path)
    return "/".join(parts[:-1])
