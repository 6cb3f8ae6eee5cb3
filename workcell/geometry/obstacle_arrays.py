"""Convex pieces packed once, for many distance queries of points by compiled kernels."""

from __future__ import annotations

import functools
import importlib
from collections.abc import Sequence
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from workcell.errors import InputError
from workcell.geometry.packing import NO_GRADIENT, pack_shapes
from workcell.geometry.types import Piece
from workcell.pose import Array, Pose


class ObstacleArrays:
    """Obstacle pieces packed once, for many distance queries by compiled kernels.

    Args:
        pieces: convex pieces, all in one frame.

    Attributes:
        pieces: the same.
        shapes: as the kernels take them.

    Raises:
        ModelError: a hull without volume; `where` names the piece.
    """

    def __init__(self, pieces: Sequence[Piece]) -> None:
        self.pieces = tuple(pieces)
        self.shapes = pack_shapes(self.pieces)

    def __len__(self) -> int:
        return len(self.pieces)

    def distances(self, points: ArrayLike) -> Array:
        """Signed distances (..., k) in metres of points (..., 3) to the k pieces."""
        flat, batch = _flat_points(points)
        distance = np.empty((len(flat), len(self)))
        _kernels().all_distances(self.shapes, flat, distance, NO_GRADIENT)
        return distance.reshape(*batch, len(self))

    def distances_and_gradients(self, points: ArrayLike) -> tuple[Array, Array]:
        """Signed distances (..., k), and their gradients (..., k, 3) with respect to the points (..., 3)."""
        flat, batch = _flat_points(points)
        distance, gradient = np.empty((len(flat), len(self))), np.empty((len(flat), len(self), 3))
        _kernels().all_distances(self.shapes, flat, distance, gradient)
        return distance.reshape(*batch, len(self)), gradient.reshape(*batch, len(self), 3)

    def floor(self, points: ArrayLike) -> Array:
        """A lower bound (...) on the signed distance of points (..., 3) to the nearest piece, exact inside.

        Only outside of hulls is it not exact: there it is the largest distance from a facet's plane.
        """
        flat, batch = _flat_points(points)
        distance = np.empty(len(flat))
        _kernels().floor_distances(self.shapes, flat, distance)
        return distance.reshape(batch)

    def nearest(self, points: ArrayLike) -> tuple[Array, Array, NDArray[np.int64]]:
        """Signed distance (...) of points (..., 3) to the nearest piece, its gradient (..., 3), and the piece (...).

        The same as the smallest of `distances_and_gradients`, but pieces that can't be the nearest are passed over.
        Without pieces: inf, zeros and -1.
        """
        flat, batch = _flat_points(points)
        distance, gradient = np.empty(len(flat)), np.empty((len(flat), 3))
        index = np.empty(len(flat), dtype=np.int64)
        _kernels().nearest_distances(self.shapes, flat, distance, gradient, index)
        return distance.reshape(batch), gradient.reshape(*batch, 3), index.reshape(batch)


@functools.cache
def prepare_distances() -> None:
    """Compile what asks for distances and their gradients, or load it from the cache, by asking about one ball."""
    ball = ObstacleArrays((Piece("ball", "sphere", Pose.identity(), np.array([0.1])),))
    ball.distances_and_gradients(np.zeros((1, 3)))


@functools.cache
def _kernels() -> Any:
    """Compiled kernels, imported on first use: numba takes half a second."""
    return importlib.import_module("workcell.kernels.shapes")


def _flat_points(points: ArrayLike) -> tuple[Array, tuple[int, ...]]:
    """Points (p, 3) as the kernels take them (writable, without gaps), and the shape they had before."""
    try:
        x = np.asarray(points, dtype=float)
    except (TypeError, ValueError):
        raise InputError("points are not an array of numbers", where="points") from None
    if x.ndim == 0 or x.shape[-1] != 3:
        raise InputError(f"points of shape {x.shape}", where="points", remedy="an array (..., 3)")
    if not np.isfinite(x).all():
        raise InputError("points that are not finite have no distance", where="points")
    flat = np.ascontiguousarray(x.reshape(-1, 3))
    return flat if flat.flags.writeable else flat.copy(), x.shape[:-1]
