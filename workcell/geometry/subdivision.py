"""Sphere covers of large pieces: the piece's own box cut into cells, a ball around each, small ones only where they must be.

A ball around a cell sticks out of the piece by its radius plus the signed distance of its centre. Cells that stick out too
far are cut across their longest side; deep inside, big balls do.
"""

from __future__ import annotations

import numpy as np

from workcell.geometry.clearance import ObstacleArrays
from workcell.geometry.separation import bounding_box
from workcell.geometry.types import Piece
from workcell.pose import Array, Pose

_PAD = 5e-4
"""Metres by which balls exceed their cells, so that the proof has something to go by."""

_COARSE = np.geomspace(1.0, 2.0, 5)[:-1]
_FINE = np.geomspace(0.8, 1.0, 6)
"""First cells tried: shares of the piece's length, and of the edge at which one layer of cells fits a slab."""


def expected_count(piece: Piece, overshoot: float) -> float:
    """Roughly how many balls a piece takes: its bounding box's surface over the discs that a ball of its size cuts out."""
    lower, upper = bounding_box(piece)
    x, y, z = sorted(upper - lower)
    disc = np.pi * (overshoot**2 + overshoot * x)
    return float(2 * (x * y + y * z + z * x) / disc)


def cover_by_cells(piece: Piece, overshoot: float) -> tuple[Array, Array]:
    """Centres (m, 3) and radii (m,) of balls that hold the piece; the best of several ways to cut it."""
    local = Piece(piece.name, piece.kind, Pose.identity(), piece.size, piece.vertices)
    lower, upper = bounding_box(local)
    shape = ObstacleArrays([local])
    extent = upper - lower
    slab = np.sqrt(2 * (overshoot**2 + overshoot * extent.min()))
    best: tuple[Array, Array] | None = None
    coarse = [np.ceil(extent / (extent.max() / share)) for share in _COARSE]
    fine = [np.where(extent > extent.min(), np.ceil(extent / (slab * share)), 1) for share in _FINE]
    for counts in (*coarse, *fine):
        found = _cut(shape, lower, upper, counts, overshoot - _PAD)
        if best is None or len(found[1]) < len(best[1]):
            best = found
    assert best is not None
    return piece.pose.apply(best[0]), best[1] + _PAD


def _cut(
    shape: ObstacleArrays, lower: Array, upper: Array, counts: Array, overshoot: float
) -> tuple[Array, Array]:
    """Balls around cells, starting from `counts` (3,) cells along each side and cutting where needed."""
    half = (upper - lower) / (2 * counts)
    grid = np.meshgrid(*(np.arange(n) for n in counts), indexing="ij")
    cells = lower + half + 2 * half * np.stack([g.reshape(-1) for g in grid], axis=1)
    halves = np.repeat(half[None], len(cells), axis=0)
    centres, radii = [], []
    while len(cells):
        radius = np.linalg.norm(halves, axis=1)
        depth = shape.nearest(cells)[0]
        done = radius + depth <= overshoot
        centres.append(cells[done])
        radii.append(radius[done])
        cut = ~done & (depth <= radius)
        cells, halves = _halved(cells[cut], halves[cut])
    return np.concatenate(centres), np.concatenate(radii)


def _halved(cells: Array, halves: Array) -> tuple[Array, Array]:
    rows, longest = np.arange(len(cells)), np.argmax(halves, axis=1)
    smaller = halves.copy()
    smaller[rows, longest] /= 2
    shift = np.zeros_like(cells)
    shift[rows, longest] = smaller[rows, longest]
    return np.vstack([cells - shift, cells + shift]), np.vstack([smaller, smaller])
