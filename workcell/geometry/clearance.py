"""Signed distances of spheres, free or carried by a robot, to obstacle pieces, with gradients."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import ArrayLike, NDArray

from workcell.errors import InputError
from workcell.geometry.engine import ClearanceEngine
from workcell.geometry.obstacle_arrays import ObstacleArrays
from workcell.geometry.types import Piece, SphereCover
from workcell.model.robot import Robot
from workcell.pose import Array


def sphere_clearances(
    centres: ArrayLike, radii: ArrayLike, obstacles: ObstacleArrays | Sequence[Piece]
) -> Array:
    """Smallest signed distance (..., m) of each sphere to any obstacle; inf without obstacles.

    Args:
        centres: (..., m, 3) metres, in the obstacles' frame.
        radii: (m,) metres, or one for all.
        obstacles: pieces, or the same packed.

    Raises:
        InputError: centres or radii that are not finite, of the wrong shape, or negative radii.
    """
    packed = obstacles if isinstance(obstacles, ObstacleArrays) else ObstacleArrays(obstacles)
    smallest: Array = packed.nearest(centres)[0] - _checked_radii(centres, radii)
    return smallest


def sphere_clearance_gradients(
    centres: ArrayLike, radii: ArrayLike, obstacles: ObstacleArrays | Sequence[Piece]
) -> tuple[Array, Array, NDArray[np.int64]]:
    """As `sphere_clearances`, with the gradients (..., m, 3) and the index (..., m) of the nearest piece.

    Without obstacles the distances are inf, the gradients zero and the indices -1.
    """
    packed = obstacles if isinstance(obstacles, ObstacleArrays) else ObstacleArrays(obstacles)
    distance, gradient, nearest = packed.nearest(centres)
    return distance - _checked_radii(centres, radii), gradient, nearest


def _checked_radii(centres: ArrayLike, radii: ArrayLike) -> Array:
    r = np.asarray(radii, dtype=float)
    if r.ndim > 1 or (r.ndim == 1 and np.shape(centres)[:-1][-1:] != r.shape):
        raise InputError(
            f"{r.shape} radii for centres of shape {np.shape(centres)}",
            where="radii",
            remedy="one a sphere (m,)",
        )
    if not np.all(np.isfinite(r)) or np.any(r < 0):
        raise InputError("radii must be finite and not negative", where="radii")
    return r


def robot_clearance(
    robot: Robot, cover: SphereCover, obstacles: ObstacleArrays | Sequence[Piece], q: ArrayLike
) -> Array:
    """Signed distances (..., m) of a robot's spheres to the nearest obstacle at configurations q (..., n)."""
    return ClearanceEngine(robot, cover, obstacles).sphere_clearances(q)


def robot_clearance_gradient(
    robot: Robot, cover: SphereCover, obstacles: ObstacleArrays | Sequence[Piece], q: ArrayLike
) -> tuple[Array, Array]:
    """Signed distances (m,) of a robot's spheres to the nearest obstacle at q (n,), and their Jacobian (m, n)."""
    return ClearanceEngine(robot, cover, obstacles).sphere_clearances_and_gradients(q)[:2]
