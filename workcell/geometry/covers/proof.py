"""Proof that spheres cover convex pieces: subdivision of the pieces' volume, no sampling.

A cell is done when one sphere holds all of it, or when it lies outside the piece by an exact distance; anything else is
split. A cell that is too small to split further is returned: there the cover has a hole, or no slack at all.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike, NDArray

from workcell.errors import InputError
from workcell.geometry.obstacle_arrays import ObstacleArrays
from workcell.geometry.polytope import CORNERS
from workcell.geometry.separation import bounding_box
from workcell.geometry.types import Piece
from workcell.pose import Array, read_only

RESOLUTION = 2e-5
"""Metres: half the edge of the smallest cell. Covers need about twice that as slack to be proved."""

_MOST = 64
"""Holes after which the search for more ends."""

_CHUNK = 50_000
"""Cells looked at together."""


@dataclass(frozen=True, slots=True)
class UncoveredCell:
    """A box in which a cover fails.

    Attributes:
        piece: name of the piece that is not covered there.
        centre, half: (3,) metres.
        gap: metres between the cell's centre and the nearest sphere; positive where the centre itself is outside.
        certain: the cell's centre is a point of the piece that no sphere holds. Else it is too thin to tell.
    """

    piece: str
    centre: Array
    half: Array
    gap: float
    certain: bool


def prove_cover(
    pieces: Sequence[Piece], centres: ArrayLike, radii: ArrayLike, *, resolution: float = RESOLUTION
) -> UncoveredCell | None:
    """None when every point of every piece lies in some sphere, proved; else a cell where that fails.

    Args:
        pieces: bounded convex pieces.
        centres, radii: (m, 3) and (m,) metres, in the pieces' frame.
        resolution: half the edge of the smallest cell looked at.

    Raises:
        InputError: a half-space, which no finite cover can hold.
    """
    c, r = np.asarray(centres, dtype=float).reshape(-1, 3), np.asarray(radii, dtype=float).reshape(-1)
    for piece in pieces:
        if piece.kind == "halfspace":
            raise InputError("no finite number of spheres covers a half-space", where=piece.name)
        lower, upper = bounding_box(piece)
        near = np.all((c + r[:, None] >= lower) & (c - r[:, None] <= upper), axis=1)
        if np.any(farthest_distance(piece, c[near]) <= r[near]) or _held(piece, c[near], r[near], resolution):
            continue
        failed = _search(piece, c[near], r[near], resolution)
        if failed is not None:
            return failed
    return None


def holes(pieces: Sequence[Piece], centres: Array, radii: Array, *, resolution: float = RESOLUTION) -> Array:
    """Points (k, 3) near which a cover fails, or has no slack; none just when `prove_cover` proves it.

    Where that function ends at the first such cell, this one goes on through all of the pieces.
    """
    missed: list[Array] = []
    for piece in pieces:
        if np.any(farthest_distance(piece, centres) <= radii):
            continue
        outside = _Outside(piece)
        for block, half, balls in _blocks(piece, centres, radii):
            missed += _block_holes(block, half, outside, centres[balls], radii[balls], resolution)
            if len(missed) > _MOST:
                break
    return np.array(missed).reshape(-1, 3)


def _block_holes(
    cells: Array, half: Array, outside: _Outside, c: Array, r: Array, resolution: float
) -> list[Array]:
    while len(cells):
        left, nearest = _not_covered(cells, half, c, r)
        depth = outside(cells[left])
        meets = depth <= np.linalg.norm(half)
        cells, nearest, depth = cells[left][meets], nearest[left][meets], depth[meets]
        lost = np.ones(len(cells), dtype=bool) if half.max() <= resolution else (depth <= 0) & (nearest > 0)
        if lost.any():
            return list(cells[lost][:4])
        cells, half = _split(cells, half)
    return []


def farthest_distance(piece: Piece, points: Array) -> Array:
    """Upper bound on the distance from points (m, 3) to the piece's farthest point; exact but for ellipsoids."""
    x = np.abs((points - piece.pose.position) @ piece.pose.rotation)
    size = piece.size
    if piece.kind == "hull":
        assert piece.vertices is not None
        local = (points - piece.pose.position) @ piece.pose.rotation
        distance: Array = np.linalg.norm(local[:, None, :] - piece.vertices, axis=2).max(axis=1)
    elif piece.kind == "box":
        distance = np.linalg.norm(x + size, axis=1)
    elif piece.kind == "cylinder":
        distance = np.hypot(np.hypot(x[:, 0], x[:, 1]) + size[0], x[:, 2] + size[1])
    elif piece.kind == "capsule":
        distance = np.hypot(np.hypot(x[:, 0], x[:, 1]), x[:, 2] + size[1]) + size[0]
    else:
        distance = np.linalg.norm(x, axis=1) + size.max()
    return distance


def _first_cells(piece: Piece, edge: float) -> tuple[Array, Array]:
    """Centres (k, 3) and half edges (3,) of cells of about `edge` metres that fill the piece's bounding box."""
    lower, upper = bounding_box(piece)
    counts = np.clip(np.ceil((upper - lower) / edge), 1, 64).astype(int)
    half = 0.5 * (upper - lower) / counts
    grid = np.meshgrid(*(np.arange(n) for n in counts), indexing="ij")
    return lower + half + 2 * half * np.stack([g.reshape(-1) for g in grid], axis=1), half


class _Outside:
    """A lower bound on the signed distance of points to one piece, which is exact inside and zero on its surface."""

    def __init__(self, piece: Piece) -> None:
        self._shape = ObstacleArrays([piece])

    def __call__(self, points: Array) -> Array:
        return self._shape.floor(points)


def _blocks(piece: Piece, c: Array, r: Array) -> Iterator[tuple[Array, Array, NDArray[np.int64]]]:
    """The first cells (1, 3) one by one, their half edges, and the balls that reach into each."""
    cells, half = _first_cells(piece, max(2.0 * float(np.median(r)), 0.01) if len(r) else 1.0)
    for cell in cells:
        apart = np.linalg.norm(np.maximum(np.abs(cell - c) - half, 0.0), axis=1)
        yield cell[None], half, np.flatnonzero(apart <= r)


def _split(cells: Array, half: Array) -> tuple[Array, Array]:
    return (cells[:, None, :] + CORNERS * (half / 2)).reshape(-1, 3), half / 2


def _held(piece: Piece, c: Array, r: Array, resolution: float) -> bool:
    """Whether every cell is held by the ball that its centre lies deepest in, or is split until it is.

    The same subdivision as `_search`, without its books: it looks at one ball a cell, the one of least power
    `|x - c|^2 - r^2`, which a k-d tree finds as the nearest of the points (c, sqrt(r_max^2 - r^2)) in four dimensions.
    False says that some cell is not held, or too small to tell, and nothing about where.
    """
    from scipy.spatial import cKDTree

    if len(r) == 0:
        return False
    tree = cKDTree(np.column_stack([c, np.sqrt(np.maximum(r.max() ** 2 - r**2, 0.0))]))
    outside = _Outside(piece)
    first, first_half = _first_cells(piece, max(2.0 * float(np.median(r)), 0.01))
    waiting = [(first, first_half)]
    while waiting:
        cells, half = waiting.pop()
        ball = np.asarray(tree.query(np.column_stack([cells, np.zeros(len(cells))]))[1])
        offset = np.abs(cells - c[ball])
        loose = ((offset + half) ** 2).sum(axis=1) > r[ball] ** 2
        cells, apart = cells[loose], (offset[loose] ** 2).sum(axis=1) - r[ball[loose]] ** 2
        depth = outside(cells)
        meets = depth <= np.linalg.norm(half)
        if np.any((depth <= 0) & (apart > 0)) or (meets.any() and half.max() <= resolution):
            return False
        smaller, half = _split(cells[meets], half)
        waiting += [(smaller[k : k + _CHUNK], half) for k in range(0, len(smaller), _CHUNK)]
    return True


def _search(piece: Piece, c: Array, r: Array, resolution: float) -> UncoveredCell | None:
    outside = _Outside(piece)
    for block, first_half, balls in _blocks(piece, c, r):
        cells, half = block, first_half
        while len(cells):
            left, nearest = _not_covered(cells, half, c[balls], r[balls])
            depth = outside(cells[left])
            meets = depth <= np.linalg.norm(half)
            cells, nearest, depth = cells[left][meets], nearest[left][meets], depth[meets]
            gap = np.where(depth <= 0, nearest, -np.inf)
            if len(cells) and (gap.max() > 0 or half.max() <= resolution):
                certain = bool(gap.max() > 0)
                worst = int(np.argmax(gap if certain else nearest))
                centre = cells[worst]
                away = float((np.linalg.norm(centre - c, axis=1) - r).min(initial=np.inf))
                return UncoveredCell(piece.name, read_only(centre), read_only(half), away, certain)
            cells, half = _split(cells, half)
    return None


def _not_covered(cells: Array, half: Array, c: Array, r: Array) -> tuple[NDArray[np.bool_], Array]:
    """Which cells (k, 3) no single ball holds; the signed distance of the cells' centres to the nearest ball (k,)."""
    offset = np.abs(cells[:, None, :] - c)
    farthest = np.sqrt(np.sum((offset + half) ** 2, axis=2))
    nearest = (np.sqrt(np.sum(offset**2, axis=2)) - r).min(axis=1, initial=np.inf)
    return ~(farthest <= r).any(axis=1), nearest
