"""Which cuboids decided where the links could be, as a recording tells, and for what share of the time."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from workcell.pose import Array
from workcell.record.read.paths import names_of
from workcell.record.read.queries import Query
from workcell.record.read.reader import Contents, Entity
from workcell.record.write.cuboid_use import IN_USE

_CUBOIDS, _OUTSIDE, _LINK = "cuboids", "spheres_outside", "link"
_LABELS = "Boxes3D:labels"
"""Where the layouts before the third had the numbers."""
_GREY = 0x888888FF
_TOLD = 6


@dataclass(frozen=True, slots=True)
class LinkUse:
    """The cuboids and polytopes that the solver had one link in, over time; up to the second layout, that it was in.

    Attributes:
        robot, link: names.
        rgb: the link's colour, in [0, 1].
        times: (T,) seconds at which something changes.
        numbers: T tuples, the cuboids from then on; none: no cuboid decided where the link was.
        outside: (T,) how many of the link's spheres are not wholly inside their cuboid.
    """

    robot: str
    link: str
    rgb: tuple[float, float, float]
    times: Array
    numbers: tuple[tuple[int, ...], ...]
    outside: NDArray[np.int64]

    def row_at(self, time: float) -> int:
        """The row that holds at a time; -1 before the first."""
        return int(np.searchsorted(self.times, time + 1e-9, side="right")) - 1

    @property
    def distinct(self) -> list[int]:
        """Every cuboid that the link is ever in."""
        return sorted({number for numbers in self.numbers for number in numbers})

    def spans(self, cuboid: int | None, end: float) -> list[tuple[float, float]]:
        """From when to when, up to `end`, a cuboid held the link; None: with some sphere outside of its cuboid."""
        found: list[tuple[float, float]] = []
        rows = zip(self.times, [*self.times[1:], end], self.numbers, self.outside, strict=True)
        for begins, ends, numbers, outside in rows:
            if outside == 0 if cuboid is None else cuboid not in numbers:
                continue
            if ends == begins:
                continue
            if found and found[-1][1] == begins:
                begins = found.pop()[0]
            found.append((float(begins), float(ends)))
        return found


@dataclass(frozen=True, slots=True)
class CuboidRow:
    """A link's cuboids with their shares of the time.

    Attributes:
        robot, link: names.
        shares: cuboid and share, the longest first.
        undecided: share in which no cuboid decided.
        outside: share in which some sphere was not wholly inside its cuboid.
    """

    robot: str
    link: str
    shares: tuple[tuple[int, float], ...]
    undecided: float
    outside: float

    @property
    def cells(self) -> tuple[str, str, str]:
        """The row of a table below `CUBOID_HEAD`, behind the names."""
        shares = [f"{share:.0%}" if share else "never" for share in (self.undecided, self.outside)]
        return self.words, shares[0], shares[1]

    @property
    def words(self) -> str:
        """The cuboids, the most used first, and how many there are besides."""
        told = [f"{number} ({share:.0%})" for number, share in self.shares[:_TOLD]]
        left = len(self.shares) - len(told)
        return ", ".join([*told, *([f"{left} more"] if left else [])]) or "none"

    def to_json(self) -> dict[str, Any]:
        """Plain values."""
        shares = [{"cuboid": number, "share": share} for number, share in self.shares]
        rest = {"undecided_share": self.undecided, "outside_share": self.outside}
        return {"robot": self.robot, "link": self.link, "cuboids": shares, **rest}


CUBOID_HEAD = ("in cuboids (share of the time)", "undecided", "partly outside")


def link_uses(contents: Contents) -> tuple[LinkUse, ...]:
    """What a recording holds about the cuboids in use, by robot, base to tool; without what can't be understood."""
    found = []
    for path, entity in sorted(contents.below(f"world/{IN_USE}").items()):
        names = names_of(path)
        if len(names) == 4 and (use := _use(names[2], names[3], entity)) is not None:
            found.append((names[2], int(entity.static.get(_LINK, [0])[0]), use))
    return tuple(use for _, _, use in sorted(found, key=lambda item: item[:2]))


def _use(robot: str, link: str, entity: Entity) -> LinkUse | None:
    times, labels = entity.over_time(_CUBOIDS if entity.has(_CUBOIDS) else _LABELS)
    outside = entity.numbers(_OUTSIDE)[1].ravel()
    if not len(times) or len(times) != len(outside):
        return None
    try:
        numbers = tuple(tuple(int(label) for label in row) for row in labels)
    except ValueError:
        return None
    return LinkUse(robot, link, _rgb(entity), times, numbers, outside.astype(np.int64))


def _rgb(entity: Entity) -> tuple[float, float, float]:
    packed = int(np.asarray(entity.static.get("Boxes3D:colors", [_GREY]), dtype=np.uint32)[0])
    red, green, blue = ((packed >> shift & 0xFF) / 255.0 for shift in (24, 16, 8))
    return red, green, blue


def cuboid_rows(uses: Sequence[LinkUse], duration: float) -> tuple[CuboidRow, ...]:
    """The share of the time, from 0 to `duration`, in which each cuboid held each link."""
    rows = []
    for use in uses:
        begins = np.append(0.0, use.times)
        spans = np.diff(np.append(begins, max(duration, float(use.times[-1]))))
        if not spans.sum() > 0:
            spans = (np.arange(len(spans)) == len(use.times)).astype(
                float
            )  # nothing moves: what holds at the end
        spans = spans / spans.sum()
        shares: dict[int, float] = {}
        for span, numbers in zip(spans[1:], use.numbers, strict=True):
            for number in numbers:
                shares[number] = shares.get(number, 0.0) + float(span)
        told = sorted(shares.items(), key=lambda item: (-round(item[1], 6), item[0]))
        none = np.array([True, *(not numbers for numbers in use.numbers)])
        outside = float(spans[1:][use.outside > 0].sum())
        rows.append(CuboidRow(use.robot, use.link, tuple(told), float(spans[none].sum()), outside))
    return tuple(rows)


def deciding_cuboids(queries: Sequence[Query], planner: str) -> str:
    """Whose cuboids decided, in words, or that none did."""
    solvers = dict.fromkeys(query.solver for query in queries if query.solved and query.in_cuboids)
    if solvers:
        return f"cuboids that the planner, {' and '.join(solvers)}, had the links in"
    return f"no cuboid decided anything; planner: {planner or 'not named'}"
