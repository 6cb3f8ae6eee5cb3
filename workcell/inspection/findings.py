"""What an inspection finds: facts, what to beware of, and what is wrong."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from dataclasses import dataclass
from typing import Any, Literal

Level = Literal["fact", "beware", "wrong"]


@dataclass(frozen=True, slots=True)
class Finding:
    """One line of an inspection.

    Attributes:
        level: a fact; `beware`: answers hold, but may not be about what was meant; `wrong`: has to be mended.
        about: the kind of finding, such as `joint`, `tool`, `touching`, `mesh`, for programs.
        text: in words, with the element's name and, where something is to be done, what.
        data: the same for programs.
    """

    level: Level
    about: str
    text: str
    data: Mapping[str, Any]

    def to_json(self) -> dict[str, Any]:
        """Plain values."""
        return {"level": self.level, "about": self.about, "text": self.text, **self.data}


def fact(about: str, text: str, **data: Any) -> Finding:
    """Something that an answer depends on."""
    return Finding("fact", about, text, data)


def beware(about: str, text: str, **data: Any) -> Finding:
    """Something that is honoured, but perhaps not what was meant."""
    return Finding("beware", about, text, data)


def wrong(about: str, text: str, **data: Any) -> Finding:
    """Something that has to be mended."""
    return Finding("wrong", about, text, data)


def texts(findings: Iterable[Finding], level: Level) -> list[str]:
    """The lines of one level."""
    return [finding.text for finding in findings if finding.level == level]
