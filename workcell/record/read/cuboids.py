"""Which free-space cuboids a recording shows the links in, and for what share of the time."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from workcell.pose import Array
from workcell.record.read.paths import names_of
from workcell.record.read.reader import Contents, Entity
from workcell.record.write.cuboid_use import IN_USE

_LABELS, _OUTSIDE, _LINK = "Boxes3D:labels", "spheres_outside", "link"
_GREY = 0x888888FF
_TOLD = 6


@dataclass(frozen=True, slots=True)
class LinkUse:
    """The cuboids that one link is in, over time.

    Attributes:
        robot, link: names.
        rgb: the link's colour, in [0, 1].
        times: (T,) seconds at which something changes.
        numbers: T tuples, the cuboids from then on.
        outside: (T,) how many of the link's spheres are wholly inside no cuboid.
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
        """From when to when, up to `end`, the link is in a cuboid; None: with some sphere in none of them."""
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
    """A link's cuboids and the share of the time that it was in each; `outside`: the share with some sphere in none."""

    robot: str
    link: str
    shares: tuple[tuple[int, float], ...]
    outside: float

    @property
    def words(self) -> str:
        """The cuboids, the most used first, and how many there are besides."""
        told = [f"{number} ({share:.0%})" for number, share in self.shares[:_TOLD]]
        left = len(self.shares) - len(told)
        return ", ".join([*told, *([f"{left} more"] if left else [])]) or "none"

    def to_json(self) -> dict[str, Any]:
        """Plain values."""
        shares = [{"cuboid": number, "share": share} for number, share in self.shares]
        return {"robot": self.robot, "link": self.link, "cuboids": shares, "outside_share": self.outside}


def link_uses(contents: Contents) -> tuple[LinkUse, ...]:
    """What a recording holds about the cuboids in use, by robot, base to tool; without what can't be understood."""
    found = []
    for path, entity in sorted(contents.below(f"world/{IN_USE}").items()):
        names = names_of(path)
        if len(names) == 4 and (use := _use(names[2], names[3], entity)) is not None:
            found.append((names[2], int(entity.static.get(_LINK, [0])[0]), use))
    return tuple(use for _, _, use in sorted(found, key=lambda item: item[:2]))


def _use(robot: str, link: str, entity: Entity) -> LinkUse | None:
    times, labels = entity.over_time(_LABELS)
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
    """The share of the time, from the first row to `duration`, that each link was in each cuboid."""
    rows = []
    for use in uses:
        spans = np.diff(np.append(use.times, max(duration, float(use.times[-1]))))
        if not spans.sum() > 0:
            spans = (np.arange(len(spans)) == len(spans) - 1).astype(
                float
            )  # nothing moves: what holds at the end
        spans = spans / spans.sum()
        shares: dict[int, float] = {}
        for span, numbers in zip(spans, use.numbers, strict=True):
            for number in numbers:
                shares[number] = shares.get(number, 0.0) + float(span)
        told = sorted(shares.items(), key=lambda item: (-round(item[1], 6), item[0]))
        rows.append(CuboidRow(use.robot, use.link, tuple(told), float(spans[use.outside > 0].sum())))
    return tuple(rows)
