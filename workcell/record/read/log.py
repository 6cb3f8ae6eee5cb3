"""The event log of a recording."""

from __future__ import annotations

from dataclasses import dataclass

from workcell.record.read.reader import Contents


@dataclass(frozen=True, slots=True)
class LogLine:
    """One line of the event log."""

    time: float
    level: str
    text: str


def log_lines(contents: Contents) -> tuple[LogLine, ...]:
    """All lines, in the order of time."""
    entity = contents.entities.get("log")
    if entity is None:
        return ()
    times, texts = entity.over_time("TextLog:text")
    levels = entity.over_time("TextLog:level")[1]
    levels += [["INFO"]] * (len(texts) - len(levels))
    return tuple(
        LogLine(float(t), str(level[0]), str(x[0])) for t, x, level in zip(times, texts, levels, strict=True)
    )
