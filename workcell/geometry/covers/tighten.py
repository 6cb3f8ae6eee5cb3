"""Covers made tight: every ball as small as the others allow, such that nothing needs dropped.

For one ball after the other, the smallest radius that still covers is the largest distance from its centre to a point
of the pieces that no other ball holds. Subdivision bounds it from above: cells outside of the pieces, or inside one
other ball, fall away, and so do those nearer than a point already known to be needed. Balls only shrink, so what one
ball was found to be needed for stays its own: in the end any ball made smaller by more than the resolution leaves a
hole.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from workcell.geometry.obstacle_arrays import ObstacleArrays
from workcell.geometry.polytope import CORNERS
from workcell.geometry.types import Piece
from workcell.pose import Array

_CELLS = 100_000
"""Cells beyond which a radius is left as exact as it is: a whole sphere's surface is equally far from its centre."""


def tighten(
    pieces: Sequence[Piece], centres: Array, radii: Array, *, resolution: float
) -> tuple[Array, Array]:
    """Balls (m, 3), (m,) that cover the pieces, each shrunk as far as it goes and superfluous ones dropped.

    Args:
        pieces: bounded convex pieces.
        centres, radii: (k, 3) and (k,) metres of balls that cover them.
        resolution: half the edge of the smallest cells, hence about how exact the radii are, in metres.

    Returns:
        centres and radii of the balls that are left, in their order.
    """
    shape, radii = ObstacleArrays(pieces), radii.copy()
    for index in np.argsort(shape.nearest(centres)[0]):
        apart = np.linalg.norm(centres - centres[index], axis=1)
        others = np.flatnonzero((apart < radii + radii[index]) & (radii > 0))
        others = others[others != index]
        radii[index] = _needed(
            shape, centres[index], radii[index], centres[others], radii[others], resolution
        )
    left = radii > 0
    return centres[left], radii[left]


def _needed(
    shape: ObstacleArrays, centre: Array, radius: float, others: Array, reach: Array, resolution: float
) -> float:
    """The smallest radius of a ball that holds what no other ball does, from above; 0 where that is nothing."""
    cells, half = centre[None], radius
    known = 0.0
    while True:
        cells = (cells[:, None, :] + CORNERS * half).reshape(-1, 3) if half < radius else cells
        farthest = np.linalg.norm(np.abs(cells - centre) + half, axis=1)
        middle = np.linalg.norm(cells - centre, axis=1)
        # What lies beyond the ball is held by others, for the balls cover.
        keep = (farthest > known) & (middle <= radius + half * np.sqrt(3.0))
        cells, farthest, middle = cells[keep], farthest[keep], middle[keep]
        free = ~_held(cells, half, others, reach)
        cells, farthest, middle = cells[free], farthest[free], middle[free]
        depth = shape.floor(cells)
        meets = depth <= half * np.sqrt(3.0)
        cells, farthest, middle, depth = cells[meets], farthest[meets], middle[meets], depth[meets]
        if len(cells) == 0:
            return known
        if half <= resolution or len(cells) > _CELLS:
            return min(radius, float(farthest.max()))
        inside = depth <= 0
        needed = inside & (middle <= radius) & ~_held(cells, 0.0, others, reach)
        known = max(known, float(middle[needed].max(initial=0.0)))
        half /= 2


def _held(cells: Array, half: float, centres: Array, radii: Array) -> NDArray[np.bool_]:
    """Whether some single ball holds all of each cell (k, 3)."""
    if len(centres) == 0:
        return np.zeros(len(cells), dtype=bool)
    corner = np.abs(cells[:, None, :] - centres) + half
    held: NDArray[np.bool_] = (np.einsum("kmi,kmi->km", corner, corner) <= radii**2).any(axis=1)
    return held
