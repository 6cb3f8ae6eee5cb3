"""Covers by number of spheres: the least overshoot at which that many hold a robot; and what a cover is worth."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np

from workcell.errors import InputError
from workcell.geometry.covers.inner import volume_samples
from workcell.geometry.obstacle_arrays import ObstacleArrays
from workcell.geometry.types import Piece, SphereCover
from workcell.pose import Pose

DENSITIES = {"low": 5, "mid": 10, "high": 22}
"""Numbers of spheres of IKSPARK's robot models (low, mid and high), or one a link where there are more links."""

_FINEST, _RATIO, _STEPS, _LOOKS = 0.005, 1.02, 220, 4
"""Overshoots tried: 5 mm to 39 cm, each 2 % above the last; and how many more below the one that bisection ends at."""


def sphere_budget(count: int | str, links: Sequence[Sequence[Piece]] = ()) -> int:
    """How many spheres `count` (a number, or low, mid, high) means, where every one of `links` needs one.

    Raises:
        InputError: an unknown density, or a number that leaves a link without a sphere.
    """
    least = sum(1 for pieces in links if pieces)
    if isinstance(count, str):
        if count not in DENSITIES:
            raise InputError(f"unknown density {count!r}", where="count", remedy=", ".join(DENSITIES))
        return max(DENSITIES[count], least)
    if int(count) != count or count < least:
        raise InputError(
            f"{count} spheres can't cover {least} links", where="count", remedy=f"{least} or more"
        )
    return int(count)


def by_count(budget: int, cover: Callable[[float], SphereCover]) -> SphereCover:
    """The cover with the least overshoot found, by bisection, that has `budget` spheres or fewer.

    Args:
        budget: number of spheres.
        cover: makes the cover for an overshoot in metres.

    Raises:
        InputError: none of the overshoots tried does.
    """
    low, high = 0, _STEPS
    found = None
    while low < high:
        middle = (low + high) // 2
        tried = cover(_FINEST * _RATIO**middle)
        if len(tried) <= budget:
            found, high = tried, middle
        else:
            low = middle + 1
    if found is None:
        raise InputError(f"no cover with {budget} spheres was found", where="count", remedy="allow more")
    for step in range(1, _LOOKS + 1):  # a smaller overshoot may happen to take no more spheres
        tried = cover(_FINEST * _RATIO ** (high - 2 * step))
        if len(tried) <= budget:
            found = tried
    return found


@dataclass(frozen=True, slots=True)
class CoverMetrics:
    """What a cover is worth; volumes are estimated from evenly spread points.

    Attributes:
        count: number of spheres.
        overshoot_max, overshoot_mean: metres by which spheres stick out; zero for an inner cover.
        volume: m^3 of the geometry.
        sphere_volume: m^3 of the spheres' union, overlaps counted once; between links they are counted twice.
        share: of the geometry's volume that lies in spheres: 1 for an outer cover, what is inscribed for an inner one.
    """

    count: int
    overshoot_max: float
    overshoot_mean: float
    volume: float
    sphere_volume: float
    share: float


def cover_metrics(links: Sequence[Sequence[Piece]], cover: SphereCover) -> CoverMetrics:
    """Metrics of a cover, given the pieces of each link in its frame (none for links that it is not meant for).

    For obstacles there is one link, the world.
    """
    volume = held = balls = 0.0
    for link, pieces in enumerate(links):
        if not pieces:
            continue
        points, each = volume_samples(pieces)
        volume += len(points) * each
        mine = cover.link == link
        if mine.any():
            spheres = [
                Piece(str(k), "sphere", Pose.from_xyz(cover.centre[k]), cover.radius[k : k + 1])
                for k in np.flatnonzero(mine)
            ]
            held += float((ObstacleArrays(spheres).floor(points) <= 0).sum()) * each
            points, each = volume_samples(spheres)
            balls += len(points) * each
    measured = np.zeros(1) if cover.overshoot is None or len(cover) == 0 else cover.overshoot
    return CoverMetrics(
        len(cover),
        float(measured.max()),
        float(measured.mean()),
        volume,
        balls,
        held / volume if volume else 1.0,
    )
