"""Inner sphere covers: balls inside a union of convex pieces, few of them, that fill as much of it as they can.

A ball of radius r around a point whose signed distance to a convex piece is s lies inside that piece exactly when
`r + s <= 0`: inside a convex set, -s is the distance to its surface. So every ball here lies in one piece by a closed
form, without any subdivision; among such balls a greedy choice takes the one that adds the most volume.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from workcell.errors import InputError
from workcell.geometry.covers.reach_ball import ReachBall, part_in_reach
from workcell.geometry.obstacle_arrays import ObstacleArrays
from workcell.geometry.pieces import move_piece
from workcell.geometry.separation import bounding_box
from workcell.geometry.types import Piece, SphereCover
from workcell.pose import Array

SHARE = 0.75
"""Of the volume that is filled where neither a count nor a share is asked for."""

MOST = 32
"""Balls of a link or piece that a share alone may ask for: the last percents of a plate take thousands."""

_SAMPLES, _CANDIDATES, _ASCENT = 3000, 500, 12
"""Points that stand for the volume, possible centres, and steps by which these move inwards."""

_ROUNDING = 1e-9
"""Metres by which balls are smaller than their centres' depth, for the rounding of the distance."""

_EXCHANGES = 2
"""Rounds in which every ball is chosen once more, given all others."""


@dataclass(frozen=True, slots=True)
class InnerBalls:
    """Balls inside pieces, most volume first.

    Attributes:
        centre, radius: (m, 3) and (m,) metres, in the pieces' frame.
        gain: (m,) m^3 that each ball adds to those before it, estimated.
        volume: m^3 of the pieces' union, estimated.
    """

    centre: Array
    radius: Array
    gain: Array
    volume: float


def inscribed_balls(
    pieces: Sequence[Piece],
    *,
    count: int | None = None,
    share: float | None = None,
    of: Sequence[Piece] | None = None,
) -> InnerBalls:
    """Balls that each lie inside one of the pieces: guaranteed, by exact distances and not by samples.

    Args:
        pieces: bounded convex pieces in one frame, which are filled.
        count: balls to place at most; None: as many as the share takes, `MOST` at most.
        share: of the union's volume, where to stop; None: `SHARE` without a count, else 1. It is not reached where
            `count`, or balls of a useful size, run out: the volumes say how far they went.
        of: what balls must lie inside of, where the pieces are only the parts of it to be filled.

    Raises:
        InputError: a count or share that makes no sense, or a half-space to be filled.
    """
    limit, target = check_budget(count, share)
    for piece in pieces:
        if piece.kind == "halfspace":
            raise InputError("a half-space can't be filled", where=piece.name, remedy="say which part of it")
    if not pieces:
        return InnerBalls(np.zeros((0, 3)), np.zeros(0), np.zeros(0), 0.0)
    samples, each = volume_samples(pieces)
    shape = ObstacleArrays(pieces if of is None else of)
    centres = _candidates(shape, samples)
    radii = -shape.nearest(centres)[0] - _ROUNDING
    centres, radii = centres[radii > 0], radii[radii > 0]
    chosen, gain = _fill(centres, radii, samples, limit, target)
    return InnerBalls(centres[chosen], radii[chosen], gain * each, each * len(samples))


def inner_link_cover(
    links: Sequence[Sequence[Piece]], *, count: int | None = None, share: float | None = None
) -> SphereCover:
    """Inner cover of a robot's links, from each link's pieces in its frame: the balls of all links that fill most.

    Guaranteed: every sphere lies inside one piece of the link that carries it, hence inside the link as MuJoCo collides
    it. What a configuration makes these spheres hit, it makes the robot hit.
    """
    _, target = check_budget(count, share)
    filled = [inscribed_balls(pieces, count=count, share=share) for pieces in links]
    gain = np.concatenate([balls.gain for balls in filled])
    link = np.repeat(np.arange(len(links)), [len(balls.gain) for balls in filled])
    order = np.argsort(-gain, kind="stable")[: count if count is not None else len(gain)]
    reached = np.cumsum(gain[order]) / sum(balls.volume for balls in filled)
    order = order[: int(np.searchsorted(reached, target)) + 1]
    numbers = np.bincount(link[order], minlength=len(links))
    return _joined(
        [
            (index, pieces, inscribed_balls(pieces, count=int(number)))
            for index, (pieces, number) in enumerate(zip(links, numbers, strict=True))
            if number
        ]
    )


def inner_obstacle_cover(
    pieces: Sequence[Piece],
    *,
    count: int | None = None,
    share: float | None = None,
    reach: ReachBall | None = None,
) -> SphereCover:
    """Inner cover of what stands still, piece by piece, `count` spheres at most in each; link 0 is the world.

    Guaranteed: every sphere lies inside the piece that `source` names. What meets these spheres meets the obstacles.

    Args:
        pieces: convex pieces in one frame.
        count, share: as `inscribed_balls`, of each piece.
        reach: fill only what `part_in_reach` says of each piece; None: all of it, half-spaces left out.
    """
    check_budget(count, share)
    parts = []
    for piece in pieces:
        part = part_in_reach(piece, reach) if reach else piece if piece.kind != "halfspace" else None
        if part is not None:
            parts.append((0, [piece], inscribed_balls([part], count=count, share=share, of=[piece])))
    return _joined(parts)


def _joined(parts: Sequence[tuple[int, Sequence[Piece], InnerBalls]]) -> SphereCover:
    """One cover of balls in links' frames, most volume first within each link."""
    names = [
        tuple(pieces[int(k)].name for k in ObstacleArrays(pieces).nearest(balls.centre)[2])
        for _, pieces, balls in parts
        if len(balls.radius)
    ]
    return SphereCover(
        np.repeat(
            np.array([link for link, _, _ in parts], dtype=np.int64), [len(b.radius) for *_, b in parts]
        ),
        np.concatenate([np.zeros((0, 3)), *(balls.centre for *_, balls in parts)]),
        np.concatenate([np.zeros(0), *(balls.radius for *_, balls in parts)]),
        "inner",
        source=tuple(name for part in names for name in part),
    )


def check_budget(count: int | None, share: float | None) -> tuple[int, float]:
    """The largest number of balls, and the share at which to stop; raises InputError for what makes no sense."""
    if count is not None and (int(count) != count or count < 1):
        raise InputError(f"{count} spheres make no sense", where="count", remedy="e.g. 22")
    if share is not None and not 0 < share <= 1:
        raise InputError(f"a share of {share} makes no sense", where="share", remedy="e.g. 0.75")
    limit = MOST if count is None else int(count)
    return limit, share if share is not None else SHARE if count is None else 1.0


def volume_samples(pieces: Sequence[Piece], count: int = _SAMPLES) -> tuple[Array, float]:
    """Evenly spread points (k, 3) of the pieces' union, about `count`, and the volume in m^3 that each stands for."""
    local = [move_piece(piece, piece.pose.inverse()) for piece in pieces]
    boxes = [bounding_box(piece) for piece in local]
    sizes = np.array([float(np.prod(upper - lower)) for lower, upper in boxes])
    wanted = np.ceil(1.5 * count * sizes / sizes.sum()).astype(int)
    kept = []
    for index, (piece, (lower, upper)) in enumerate(zip(pieces, boxes, strict=True)):
        points = lower + (upper - lower) * _spread(int(wanted[index]), seed=index)
        inside = piece.pose.apply(points[ObstacleArrays([local[index]]).floor(points) <= 0])
        kept.append(inside[ObstacleArrays(pieces[:index]).floor(inside) > 0] if index else inside)
    return np.vstack(kept), float(sizes.sum() / wanted.sum())


def _spread(count: int, seed: int) -> Array:
    """Points (count, 3) of the unit cube with low discrepancy: the recurrence of the generalised golden ratio."""
    ratio = 1.2207440846057596  # the real root of x^4 = x + 1
    steps = np.arange(1, count + 1)[:, None] * ratio ** -np.arange(1.0, 4.0)
    points: Array = np.mod(0.5 + 0.37 * seed + steps, 1.0)
    return points


def _candidates(shape: ObstacleArrays, samples: Array) -> Array:
    """Samples moved inwards, to where balls are largest, and where they stood on their way."""
    points = samples[:: max(1, len(samples) // _CANDIDATES)].copy()
    depth, slope, _ = shape.nearest(points)
    step = 0.4 * np.abs(depth)
    kept = [points.copy()]
    for turn in range(_ASCENT):
        moved = points - step[:, None] * slope
        deeper, turned, _ = shape.nearest(moved)
        better = deeper < depth
        points[better], depth[better], slope[better] = moved[better], deeper[better], turned[better]
        step = np.where(better, step, 0.5 * step)
        if turn in (1, 4, _ASCENT - 1):
            kept.append(points.copy())
    return np.vstack(kept)


def _fill(
    centres: Array, radii: Array, samples: Array, limit: int, share: float
) -> tuple[NDArray[np.int64], Array]:
    """Indices (m,) of balls, and how many samples (m,) each adds: greedily, then each exchanged for a better one."""
    holds = _holds(centres, radii, samples)
    chosen = _greedy(holds, limit, share)
    for _ in range(_EXCHANGES if 1 < len(chosen) < 60 else 0):
        count = holds[chosen].sum(axis=0)
        for place, index in enumerate(chosen):
            count -= holds[index]
            chosen[place] = int(np.argmax(holds @ (count == 0).astype(np.float32)))
            count += holds[chosen[place]]
    return _by_gain(holds, chosen)


def _holds(centres: Array, radii: Array, samples: Array) -> Array:
    """Which ball holds which sample, as 0 and 1: (k, s)."""
    squares = np.sum(centres**2, axis=1)[:, None] + np.sum(samples**2, axis=1) - 2 * centres @ samples.T
    held: Array = (squares <= radii[:, None] ** 2).astype(np.float32)
    return held


def _greedy(holds: Array, limit: int, share: float) -> list[int]:
    left = np.ones(holds.shape[1], dtype=np.float32)
    gain = holds.sum(axis=1)
    chosen: list[int] = []
    while len(chosen) < limit and left.sum() > (1 - share) * len(left):
        while True:  # gains only shrink: the best by its present gain is the best of all
            best = int(np.argmax(gain))
            gain[best], before = holds[best] @ left, gain[best]
            if gain[best] == before:
                break
        if gain[best] < 1:
            break
        chosen.append(best)
        left[holds[best] > 0] = 0.0
    return chosen


def _by_gain(holds: Array, chosen: list[int]) -> tuple[NDArray[np.int64], Array]:
    """The chosen balls in order of what they add to those before; such that add nothing fall away."""
    rows = holds[chosen]
    order = _greedy(rows, len(chosen), 1.0)
    left, gain = np.ones(rows.shape[1], dtype=np.float32), []
    for row in order:
        gain.append(float(rows[row] @ left))
        left[rows[row] > 0] = 0.0
    return np.array(chosen, dtype=np.int64)[order], np.array(gain)
