"""Signed distances of spheres to obstacle pieces, in batches, with gradients with respect to centres and joints."""

from __future__ import annotations

import functools
import importlib
from collections.abc import Sequence
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from workcell.errors import InputError
from workcell.geometry.packing import pack_shapes
from workcell.geometry.types import Piece, SphereCover
from workcell.model.robot import Robot
from workcell.pose import Array


class ObstacleArrays:
    """Obstacle pieces packed once, for many distance queries by compiled kernels.

    Args:
        pieces: convex pieces, all in one frame.

    Raises:
        ModelError: a hull without volume; `where` names the piece.
    """

    def __init__(self, pieces: Sequence[Piece]) -> None:
        self.pieces = tuple(pieces)
        self.shapes = pack_shapes(self.pieces)
        self._packed_at = np.argsort(self.shapes.order)

    def __len__(self) -> int:
        return len(self.pieces)

    def distances(self, points: ArrayLike) -> Array:
        """Signed distances (..., k) in metres of points (..., 3) to the k pieces."""
        flat, batch = _flat_points(points)
        distance = np.empty((len(flat), len(self)))
        _kernels().all_distances(self.shapes, flat, distance, np.empty((0, 0, 0)))
        return distance.reshape(*batch, len(self))

    def distances_and_gradients(self, points: ArrayLike) -> tuple[Array, Array]:
        """Signed distances (..., k), and their gradients (..., k, 3) with respect to the points (..., 3)."""
        flat, batch = _flat_points(points)
        distance, gradient = np.empty((len(flat), len(self))), np.empty((len(flat), len(self), 3))
        _kernels().all_distances(self.shapes, flat, distance, gradient)
        return distance.reshape(*batch, len(self)), gradient.reshape(*batch, len(self), 3)

    def distances_to(self, points: ArrayLike, which: ArrayLike) -> tuple[Array, Array]:
        """Signed distances (p,) and gradients (p, 3) of points (p, 3), each to the piece whose number (p,) is beside it."""
        flat, _ = _flat_points(points)
        index = np.asarray(which, dtype=np.int64)
        if index.shape != (len(flat),) or np.any((index < 0) | (index >= len(self))):
            raise InputError(
                f"every point takes one piece from 0 to {len(self) - 1}",
                where="which",
                remedy="an array (p,)",
            )
        distance, gradient = np.empty(len(flat)), np.empty((len(flat), 3))
        _kernels().pair_distances(self.shapes, flat, self._packed_at[index], distance, gradient)
        return distance, gradient

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
def _kernels() -> Any:
    """Compiled kernels, imported on first use: numba takes half a second."""
    return importlib.import_module("workcell.geometry.kernels.shapes")


def _flat_points(points: ArrayLike) -> tuple[Array, tuple[int, ...]]:
    """Points (p, 3) as the kernels take them (writable, without gaps), and the shape they had before."""
    x = np.asarray(points, dtype=float)
    if x.ndim == 0 or x.shape[-1] != 3:
        raise InputError(f"points of shape {x.shape}", where="points", remedy="an array (..., 3)")
    if not np.isfinite(x).all():
        raise InputError("points that are not finite have no distance", where="points")
    flat = np.ascontiguousarray(x.reshape(-1, 3))
    return flat if flat.flags.writeable else flat.copy(), x.shape[:-1]


def sphere_clearances(
    centres: ArrayLike, radii: ArrayLike, obstacles: ObstacleArrays | Sequence[Piece]
) -> Array:
    """Smallest signed distance (..., m) of each sphere to any obstacle; inf without obstacles.

    Args:
        centres: (..., m, 3) metres, in the obstacles' frame.
        radii: (m,) metres.
        obstacles: pieces, or the same packed.
    """
    packed = obstacles if isinstance(obstacles, ObstacleArrays) else ObstacleArrays(obstacles)
    smallest: Array = packed.nearest(centres)[0] - np.asarray(radii, dtype=float)
    return smallest


def sphere_clearance_gradients(
    centres: ArrayLike, radii: ArrayLike, obstacles: ObstacleArrays | Sequence[Piece]
) -> tuple[Array, Array, NDArray[np.int64]]:
    """As `sphere_clearances`, with the gradients (..., m, 3) and the index (..., m) of the nearest piece.

    Without obstacles the distances are inf, the gradients zero and the indices -1.
    """
    packed = obstacles if isinstance(obstacles, ObstacleArrays) else ObstacleArrays(obstacles)
    distance, gradient, nearest = packed.nearest(centres)
    return distance - np.asarray(radii, dtype=float), gradient, nearest


def robot_clearance(
    robot: Robot, cover: SphereCover, obstacles: ObstacleArrays | Sequence[Piece], q: ArrayLike
) -> Array:
    """Signed distances (..., m) of a robot's spheres to the nearest obstacle at configurations q (..., n)."""
    centres = cover.centres_world(robot.link_transforms(q))
    return sphere_clearances(centres, cover.radius, obstacles)


def robot_clearance_gradient(
    robot: Robot, cover: SphereCover, obstacles: ObstacleArrays | Sequence[Piece], q: ArrayLike
) -> tuple[Array, Array]:
    """Signed distances (m,) of a robot's spheres to the nearest obstacle at q (n,), and their Jacobian (m, n)."""
    T = robot.link_transforms(np.asarray(q, dtype=float))
    centres = cover.centres_world(T)
    distances, gradients, _ = sphere_clearance_gradients(centres, cover.radius, obstacles)
    return distances, np.einsum("mi,min->mn", gradients, sphere_jacobians(robot, cover, T))


def sphere_jacobians(robot: Robot, cover: SphereCover, T: Array) -> Array:
    """Jacobians (m, 3, n) of the cover's centres in the world, given `T = link_transforms(q)` (n + 1, 4, 4)."""
    centres = cover.centres_world(T)
    axes = np.einsum("kij,kj->ki", T[1:, :3, :3], robot.axis)
    turning = np.cross(axes, centres[:, None, :] - T[1:, :3, 3])
    columns = np.where(robot.prismatic[:, None], axes, turning)
    moves = np.zeros((robot.dof + 1, robot.dof), dtype=bool)
    for link in range(1, robot.dof + 1):
        moves[link] = moves[int(robot.parents[link - 1])]
        moves[link, link - 1] = True
    jacobian: Array = np.swapaxes(np.where(moves[cover.link][..., None], columns, 0.0), -1, -2)
    return jacobian
