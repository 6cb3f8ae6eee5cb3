"""Where obstacles stop a growing cuboid's face: closed forms, for many cuboids at once.

For a face that moves along +x, an obstacle stops it at the smallest x of (obstacle and the column behind which the
cuboid stands). For a box along the axes, a ball and a half-space that is one formula. For a polytope the smallest x
is at one of its vertices inside the column, at an edge's crossing of a side of the column, or where one of the
column's four edges enters it. Other curved pieces stand as polytopes around them, hence on the safe side.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from workcell.geometry.polytope import Polytope, polytope_of
from workcell.geometry.types import Piece
from workcell.pose import Array


class Blockers:
    """Obstacle pieces packed for questions about axis-aligned cuboids.

    Args:
        pieces: convex pieces in the cuboids' frame.
    """

    def __init__(self, pieces: Sequence[Piece]) -> None:
        boxes, balls, planes, polytopes = [], [], [], []
        for piece in pieces:
            if piece.kind == "box" and _is_aligned(piece.pose.rotation):
                half = np.abs(piece.pose.rotation) @ piece.size
                boxes.append([piece.pose.position - half, piece.pose.position + half])
            elif piece.kind == "sphere":
                balls.append([*piece.pose.position, piece.size[0]])
            elif piece.kind == "halfspace":
                outward = piece.pose.rotation[:, 2]
                planes.append([*outward, outward @ piece.pose.position])
            else:
                polytopes.append(polytope_of(piece))
        self._boxes = np.array(boxes).reshape(-1, 2, 3)
        self._balls = np.array(balls).reshape(-1, 4)
        self._planes = np.array(planes).reshape(-1, 4)
        sizes = sorted({_size_class(p) for p in polytopes})
        self._packs = [_pack([p for p in polytopes if _size_class(p) == size]) for size in sizes]

    def contains(self, points: Array) -> NDArray[np.bool_]:
        """Whether points (s, 3) lie inside some obstacle, or inside the polytope that stands for it."""
        p = points[:, None, :]
        inside: NDArray[np.bool_] = np.all((p >= self._boxes[:, 0]) & (p <= self._boxes[:, 1]), axis=2).any(
            axis=1
        )
        inside |= (np.linalg.norm(p - self._balls[:, :3], axis=2) <= self._balls[:, 3]).any(axis=1)
        inside |= (points @ self._planes[:, :3].T <= self._planes[:, 3]).any(axis=1)
        for pack in self._packs:
            s, k = np.nonzero(np.all((p >= pack.lower) & (p <= pack.upper), axis=2))
            heights = np.einsum("rfi,ri->rf", pack.planes[k, :, :3], points[s]) + pack.planes[k, :, 3]
            inside[s[(heights <= 0).all(axis=1)]] = True
        return inside

    def limits(self, lower: Array, upper: Array, axis: int, sign: int, furthest: Array) -> Array:
        """How far one face of each cuboid may go.

        Args:
            lower, upper: (s, 3) corners of cuboids that no obstacle overlaps.
            axis: 0, 1 or 2; `sign`: +1 moves the upper face up, -1 the lower face down.
            furthest: (s,) coordinate where the face stops in any case.

        Returns:
            (s,) coordinates of the face, between where it is and `furthest`.
        """
        others = [i for i in range(3) if i != axis]
        face = sign * (upper if sign > 0 else lower)[:, axis]
        rect_low, rect_high = lower[:, others], upper[:, others]
        stop = sign * furthest
        stop = np.minimum(stop, self._box_stops(rect_low, rect_high, axis, others, sign, face))
        stop = np.minimum(stop, self._ball_stops(rect_low, rect_high, axis, others, sign, face))
        stop = np.minimum(stop, self._plane_stops(lower, upper, axis, sign))
        for pack in self._packs:
            _lower_to_stops(pack, rect_low, rect_high, axis, others, sign, face, stop)
        return sign * np.maximum(stop, face)

    def _box_stops(
        self, low: Array, high: Array, axis: int, others: list[int], sign: int, face: Array
    ) -> Array:
        first, last = self._boxes[:, 0], self._boxes[:, 1]
        near = first[:, axis] if sign > 0 else -last[:, axis]
        far = last[:, axis] if sign > 0 else -first[:, axis]
        meets = np.all(
            (high[:, None, :] > first[None, :, others]) & (low[:, None, :] < last[None, :, others]), axis=2
        )
        meets &= far > face[:, None]
        stops: Array = np.where(meets, near, np.inf).min(axis=1, initial=np.inf)
        return stops

    def _ball_stops(
        self, low: Array, high: Array, axis: int, others: list[int], sign: int, face: Array
    ) -> Array:
        centre = self._balls[:, others]
        aside = np.linalg.norm(centre - np.clip(centre, low[:, None, :], high[:, None, :]), axis=2)
        reach = np.sqrt(np.maximum(self._balls[:, 3] ** 2 - aside**2, 0.0))
        middle = sign * self._balls[:, axis]
        meets = (aside < self._balls[:, 3]) & (middle + reach > face[:, None])
        stops: Array = np.where(meets, middle - reach, np.inf).min(axis=1, initial=np.inf)
        return stops

    def _plane_stops(self, lower: Array, upper: Array, axis: int, sign: int) -> Array:
        normal, offset = self._planes[:, :3], self._planes[:, 3]
        deepest = np.minimum(lower[:, None, :] * normal, upper[:, None, :] * normal)
        rest = deepest.sum(axis=2) - deepest[:, :, axis]
        slope = sign * normal[:, axis]
        descending = slope < -1e-12
        room = (offset - rest) / np.where(descending, slope, -1.0)
        stops: Array = np.where(descending, room, np.inf).min(axis=1, initial=np.inf)
        return stops


@dataclass(frozen=True, slots=True)
class _Pack:
    """Polytopes of similar size, padded: vertices, edge ends, planes and bounds.

    Vertices (k, v, 3), edge ends (k, e, 3) each, planes (k, f, 4), bounds (k, 3).
    """

    vertices: Array
    start: Array
    end: Array
    planes: Array
    lower: Array
    upper: Array


def _pack(polytopes: list[Polytope]) -> _Pack:
    return _Pack(
        _padded([p.vertices for p in polytopes]),
        _padded([p.vertices[p.edges[:, 0]] for p in polytopes]),
        _padded([p.vertices[p.edges[:, 1]] for p in polytopes]),
        _padded([p.planes for p in polytopes]),
        np.array([p.vertices.min(axis=0) for p in polytopes]),
        np.array([p.vertices.max(axis=0) for p in polytopes]),
    )


def _padded(arrays: list[Array]) -> Array:
    """Stacked to one length by repeating each array's last row, which changes no minimum."""
    longest = max(len(a) for a in arrays)
    return np.stack([np.vstack([a, np.repeat(a[-1:], longest - len(a), axis=0)]) for a in arrays])


def _size_class(polytope: Polytope) -> int:
    return int(np.ceil(np.log2(len(polytope.edges))))


def _is_aligned(rotation: Array) -> bool:
    return bool(np.all(np.abs(rotation).max(axis=0) > 1 - 1e-15))


def _lower_to_stops(
    pack: _Pack, low: Array, high: Array, axis: int, others: list[int], sign: int, face: Array, stop: Array
) -> None:
    """Lower `stop` (s,), in place, to where the pack's polytopes stop each face."""
    near = pack.lower[:, axis] if sign > 0 else -pack.upper[:, axis]
    far = pack.upper[:, axis] if sign > 0 else -pack.lower[:, axis]
    meets = np.all(
        (high[:, None, :] > pack.lower[None, :, others]) & (low[:, None, :] < pack.upper[None, :, others]),
        axis=2,
    )
    s, k = np.nonzero(meets & (far > face[:, None]) & (near < stop[:, None]))
    if len(s) == 0:
        return
    first = _first_in_column(pack, k, low[s], high[s], axis, others, sign)
    # A polytope that does not overlap the cuboid is wholly ahead of the face, or wholly behind it.
    ahead = first >= face[s] - 1e-9
    np.minimum.at(stop, s[ahead], first[ahead])


def _first_in_column(
    pack: _Pack, k: NDArray[np.int64], low: Array, high: Array, axis: int, others: list[int], sign: int
) -> Array:
    """Smallest coordinate (r,) along the face's motion of polytopes `k` (r,) within columns (r, 2); inf if none."""
    vertices = pack.vertices[k]
    flat = vertices[:, :, others]
    inside = np.all((flat >= low[:, None, :]) & (flat <= high[:, None, :]), axis=2)
    first: Array = np.where(inside, sign * vertices[:, :, axis], np.inf).min(axis=1)
    start, end = pack.start[k], pack.end[k]
    for side, other in ((0, 1), (1, 0)):
        for wall in (low[:, side], high[:, side]):
            a, b = start[:, :, others[side]], end[:, :, others[side]]
            crosses = (a - wall[:, None]) * (b - wall[:, None]) < 0
            t = np.where(crosses, (wall[:, None] - a) / np.where(crosses, b - a, 1.0), 0.0)
            point = start + t[:, :, None] * (end - start)
            beside = point[:, :, others[other]]
            hit = crosses & (beside >= low[:, other, None]) & (beside <= high[:, other, None])
            first = np.minimum(first, np.where(hit, sign * point[:, :, axis], np.inf).min(axis=1))
    planes = pack.planes[k]
    for corner in (
        low,
        high,
        np.column_stack([low[:, 0], high[:, 1]]),
        np.column_stack([high[:, 0], low[:, 1]]),
    ):
        rest = planes[:, :, 3] + np.einsum("rfi,ri->rf", planes[:, :, others], corner)
        slope = sign * planes[:, :, axis]
        steep = np.abs(slope) > 1e-12
        at = -rest / np.where(steep, slope, 1.0)
        enter = np.where(steep & (slope < 0), at, -np.inf).max(axis=1)
        leave = np.where(steep & (slope > 0), at, np.inf).min(axis=1)
        hit_line = (enter <= leave) & np.all(steep | (rest <= 0), axis=1)
        first = np.minimum(first, np.where(hit_line, enter, np.inf))
    return first
