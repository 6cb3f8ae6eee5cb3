"""Sphere covers of large pieces: the piece's own box cut into cells, small ones only where they must be.

A ball around each cell sticks out of the piece by its radius plus the signed distance of its centre. Cells that
stick out too far are cut across their longest side; deep inside, big balls do. A board becomes a lattice of equal
balls at once: with half edges (a, b, h) of its cells, h being the board's half thickness and the least of the
three, a ball sticks out by `|(a, b, h)| - h`. A cylinder is cut around its axis: its cells are sectors of rings.
"""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

from workcell.geometry.obstacle_arrays import ObstacleArrays
from workcell.geometry.pieces import move_piece
from workcell.geometry.separation import bounding_box
from workcell.geometry.types import Piece
from workcell.pose import Array

_PAD = 5e-4
"""Metres by which balls exceed their cells, so that the proof has something to go by."""

_COARSE = np.geomspace(1.0, 2.0, 5)[:-1]
_FINE = np.geomspace(0.8, 1.0, 6)
"""First cells tried: shares of the piece's length, and of the edge at which one layer of cells fits a slab."""

_SECTORS = (1, 6, 8, 10, 12, 14, 16, 20, 24)
"""Numbers of sectors that a cylinder is first cut into."""

Balls = Callable[[Array, Array], tuple[Array, Array, Array]]
"""Cells' centres and half extents (k, 3) in their own coordinates, to balls around them: centres (k, 3) in space, radii
(k,), and the cells' extents in metres (k, 3), of which the longest is cut."""


def expected_count(piece: Piece, overshoot: float) -> float:
    """Roughly how many balls a piece takes: its bounding box's surface over the discs that such a ball cuts out."""
    lower, upper = bounding_box(piece)
    x, y, z = sorted(upper - lower)
    disc = np.pi * (overshoot**2 + overshoot * x)
    return float(2 * (x * y + y * z + z * x) / disc)


def cover_by_cells(piece: Piece, overshoot: float, *, of: Piece | None = None) -> tuple[Array, Array]:
    """Centres (m, 3) and radii (m,) of balls that hold the piece; the best of several ways to cut it.

    Args:
        piece: bounded convex piece.
        overshoot: metres that a ball may stick out.
        of: what balls may not stick out of, where `piece` is only the part of it to be held; None: the piece itself.
    """
    to_local = piece.pose.inverse()
    local = move_piece(piece, to_local)
    shape = ObstacleArrays([local if of is None else move_piece(of, to_local)])
    lower, upper = bounding_box(local)
    extent = upper - lower
    slab = np.sqrt(2 * (overshoot**2 + overshoot * extent.min()))
    starts = [np.ceil(extent / (extent.max() / share)) for share in _COARSE]
    starts += [np.where(extent > extent.min(), np.ceil(extent / (slab * share)), 1) for share in _FINE]
    found = [_cut(_box_balls, shape, lower, upper, counts, overshoot - _PAD) for counts in starts]
    if piece.kind == "cylinder":
        lower, upper = np.array([0, 0, lower[2]]), np.array([piece.size[0], 2 * np.pi, upper[2]])
        layers = np.unique(np.ceil(extent[2] / (extent[0] * np.geomspace(0.1, 1.0, 6))))
        starts = [np.array([1, sectors, count]) for sectors in _SECTORS for count in layers]
        found += [_cut(_sector_balls, shape, lower, upper, counts, overshoot - _PAD) for counts in starts]
    centres, radii = min(found, key=lambda balls: len(balls[1]))
    return piece.pose.apply(centres), radii + _PAD


def _cut(
    balls: Balls, shape: ObstacleArrays, lower: Array, upper: Array, counts: Array, overshoot: float
) -> tuple[Array, Array]:
    """Balls around cells, starting from `counts` (3,) cells along each coordinate and cutting where needed."""
    half = (upper - lower) / (2 * counts)
    grid = np.meshgrid(*(np.arange(n) for n in counts), indexing="ij")
    cells = lower + half + 2 * half * np.stack([g.reshape(-1) for g in grid], axis=1)
    halves = np.repeat(half[None], len(cells), axis=0)
    centres, radii = [], []
    while len(cells):
        centre, radius, extent = balls(cells, halves)
        depth = shape.nearest(centre)[0]
        done = radius + depth <= overshoot
        centres.append(centre[done])
        radii.append(radius[done])
        cut = ~done & (depth <= radius)
        cells, halves = _halved(cells[cut], halves[cut], extent[cut])
    return np.concatenate(centres), np.concatenate(radii)


def _box_balls(cells: Array, halves: Array) -> tuple[Array, Array, Array]:
    return cells, np.linalg.norm(halves, axis=1), halves


def _sector_balls(cells: Array, halves: Array) -> tuple[Array, Array, Array]:
    """For cells in (distance from the axis, angle, height); the farthest points of a sector are its corners.

    The centre lies on the axis where the sector is half a turn or more.
    """
    (rho, angle, height), (width, turn, half) = cells.T, halves.T
    inner, outer = rho - width, rho + width
    at = np.where(turn < 0.5 * np.pi, rho, 0.0)
    c = np.cos(np.minimum(turn, np.pi))
    square = np.maximum(
        outer**2 + at**2 - 2 * outer * at * c,
        inner**2 + at**2 - 2 * inner * at * c,
    )
    centres = np.stack([at * np.cos(angle), at * np.sin(angle), height], axis=1)
    return centres, np.sqrt(square + half**2), np.stack([width, outer * turn, half], axis=1)


def _halved(cells: Array, halves: Array, extent: Array) -> tuple[Array, Array]:
    rows, longest = np.arange(len(cells)), np.argmax(extent, axis=1)
    smaller = halves.copy()
    smaller[rows, longest] /= 2
    shift = np.zeros_like(cells)
    shift[rows, longest] = smaller[rows, longest]
    return np.vstack([cells - shift, cells + shift]), np.vstack([smaller, smaller])
