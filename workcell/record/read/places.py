"""Which of their ways the robots were on while they moved, and who had answered there."""

from __future__ import annotations

import itertools
import json
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from workcell.pose import Array
from workcell.record.read.paths import names_of
from workcell.record.read.reader import Contents
from workcell.record.write.cuboid_use import WAYS


@dataclass(frozen=True, slots=True)
class Places:
    """Where one robot was.

    Attributes:
        robot: its name.
        times: (T,) seconds at which it came to another place.
        ways: T names of ways; None: it was on none that anybody was asked for.
        by: T names of those who answered; empty where there is no way.
    """

    robot: str
    times: Array
    ways: tuple[str | None, ...]
    by: tuple[str, ...]

    def row_at(self, time: float) -> int:
        """The row that holds at a time; -1 before the first."""
        return int(np.searchsorted(self.times, time + 1e-9, side="right")) - 1


def robot_places(contents: Contents) -> tuple[Places, ...]:
    """Of every robot with answered queries, in the order of names; documents that make no sense name no way."""
    found = []
    for path, entity in sorted(contents.below(WAYS).items()):
        times, texts = entity.over_time("TextDocument:text")
        rows = [_place(text[0] if text else "") for text in texts]
        if len(rows):
            ways, by = zip(*rows, strict=True)
            found.append(Places(names_of(path)[-1], times, ways, by))
    return tuple(found)


def _place(text: str) -> tuple[str | None, str]:
    try:
        document = json.loads(text)
    except ValueError:
        return None, ""
    what, by = (document.get(key) if isinstance(document, dict) else None for key in ("what", "by"))
    return (what, by) if isinstance(what, str) and isinstance(by, str) else (None, "")


def shares_of_ways(places: Sequence[Places], duration: float) -> dict[str | None, float]:
    """For each way the share of the time, from 0 to `duration`, in which some robot was on it.

    None: in which all were on none. Empty where nothing moved or nobody tells.
    """
    if not places or duration <= 0.0:
        return {}
    cuts = np.unique(np.concatenate([[0.0, duration], *(one.times for one in places)]))
    shares: dict[str | None, float] = {}
    for begin, end in itertools.pairwise(cuts):
        rows = [(one, one.row_at(begin)) for one in places]
        ways = {one.ways[row] for one, row in rows if row >= 0} - {None}
        for way in ways or {None}:
            shares[way] = shares.get(way, 0.0) + float(end - begin) / duration
    return shares
