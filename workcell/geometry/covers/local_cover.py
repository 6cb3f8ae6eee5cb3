"""An outer cover of one convex piece of which only the balls that are asked for are ever made.

The piece's own box is cut in two across its longest side, its halves likewise, and so on, until a cell is held by a
ball that sticks out of the piece by no more than asked. A ball need not stand in the middle of its cell: under a
surface it stands deeper, where it is larger and sticks out less. So every point of the piece lies in the ball of its
cell, and of a cover of any number of balls one is found by arithmetic alone.
"""

from __future__ import annotations

import numpy as np

from workcell.errors import InputError
from workcell.geometry.obstacle_arrays import ObstacleArrays
from workcell.geometry.pieces import move_piece
from workcell.geometry.separation import bounding_box
from workcell.geometry.types import Piece
from workcell.pose import Array

_DEEPER = (0.0, 1.0, 2.0)
"""How far under its cell's middle a ball may stand, in half diagonals of the cell."""

_PAD = 1e-9
"""Metres by which balls exceed their cells, for rounding."""

_SMALLEST = 0.49
"""Half diagonal of the smallest cells, in overshoots: any ball of such a cell that meets the piece will do."""


class LocalCover:
    """Balls that hold a bounded convex piece.

    Args:
        piece: what they hold.
        overshoot: metres that a ball may stick out of it.

    Raises:
        InputError: a half-space, or an overshoot that is not positive.
    """

    def __init__(self, piece: Piece, overshoot: float) -> None:
        if piece.kind == "halfspace":
            raise InputError("no finite number of spheres covers a half-space", where=piece.name)
        if not overshoot > 0:
            raise InputError(
                f"an overshoot of {overshoot} m makes no sense", where=piece.name, remedy="a positive one"
            )
        self._pose, self._overshoot = piece.pose, overshoot
        local = move_piece(piece, piece.pose.inverse())
        self._shape = ObstacleArrays([local])
        self._lower, upper = bounding_box(local)
        self._halves = _halves(0.5 * (upper - self._lower), _SMALLEST * overshoot)
        self._most = np.rint(0.5 * (upper - self._lower) / self._halves) - 1.0

    def holding(self, points: Array) -> tuple[Array, Array]:
        """Centres (m, 3) and radii (m,) of the balls of the cells that hold points (m, 3) of the piece.

        For a point outside it is the ball of the nearest cell of the piece's box, which need not meet the piece.
        """
        at = self._pose.inverse().apply(points)[:, None]
        places = np.floor((at - self._lower) / (2.0 * self._halves))
        middle = self._lower + self._halves * (2.0 * np.clip(places, 0.0, self._most) + 1.0)
        size = np.linalg.norm(self._halves, axis=-1)
        outwards = self._shape.nearest(middle)[1]
        sunk = np.multiply.outer(_DEEPER, size)[:, None, :, None]
        centre = middle - sunk * outwards
        radius = np.linalg.norm(np.abs(centre - middle) + self._halves, axis=-1) + _PAD
        sticks = radius + self._shape.nearest(centre)[0]
        # the coarsest cell that has a ball, and the ball of it that sticks out least
        level = np.argmax(sticks.min(axis=0) <= self._overshoot, axis=-1)
        rows = np.arange(len(level))
        best = sticks[:, rows, level].argmin(axis=0)
        return self._pose.apply(centre[best, rows, level]), radius[best, rows, level]


def _halves(half: Array, smallest: float) -> Array:
    """(levels, 3) half sides of cells, each cut from the one before; a ball around the last is below `smallest`."""
    found = [half]
    while np.linalg.norm(found[-1]) > smallest:
        cut = found[-1].copy()
        cut[int(cut.argmax())] *= 0.5
        found.append(cut)
    return np.array(found)
