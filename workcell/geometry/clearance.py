"""Signed distances of spheres to obstacle pieces, in batches, with gradients with respect to centres and joints."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike, NDArray

from workcell.geometry.distance import KERNELS, closest_on_triangles
from workcell.geometry.polytope import polytope_of
from workcell.geometry.types import Piece, SphereCover
from workcell.model.robot import Robot
from workcell.pose import Array, quat_to_matrix


@dataclass(frozen=True, slots=True)
class _Group:
    """Pieces of one kind: their place in the list, rotation (k, 3, 3), position (k, 3) and sizes (k, s)."""

    kind: str
    index: NDArray[np.int64]
    rotation: Array
    position: Array
    size: Array


@dataclass(frozen=True, slots=True)
class _Hull:
    """One hull in the world: its place in the list, planes (f, 4), and triangle corners, each (t, 3)."""

    index: int
    planes: Array
    a: Array
    b: Array
    c: Array


class ObstacleArrays:
    """Obstacle pieces packed by kind, once, for many distance queries.

    Args:
        pieces: convex pieces, all in one frame.
    """

    def __init__(self, pieces: Sequence[Piece]) -> None:
        self.pieces = tuple(pieces)
        self._groups = [
            _Group(
                kind,
                np.array([i for i, piece in enumerate(self.pieces) if piece.kind == kind]),
                quat_to_matrix(np.array([p.pose.quat_wxyz for p in self.pieces if p.kind == kind])),
                np.array([p.pose.position for p in self.pieces if p.kind == kind]),
                np.array([p.size for p in self.pieces if p.kind == kind]),
            )
            for kind in sorted({piece.kind for piece in self.pieces} - {"hull"})
        ]
        self._hulls = [_hull(i, piece) for i, piece in enumerate(self.pieces) if piece.kind == "hull"]

    def __len__(self) -> int:
        return len(self.pieces)

    def distances(self, points: ArrayLike) -> Array:
        """Signed distances (..., k) in metres of points (..., 3) to the k pieces."""
        return self.distances_and_gradients(points)[0]

    def distances_and_gradients(self, points: ArrayLike) -> tuple[Array, Array]:
        """Signed distances (..., k), and their gradients (..., k, 3) with respect to the points (..., 3)."""
        x = np.asarray(points, dtype=float)
        flat = x.reshape(-1, 3)
        distance = np.empty((len(flat), len(self.pieces)))
        gradient = np.empty((len(flat), len(self.pieces), 3))
        for group in self._groups:
            local = np.einsum("kji,nkj->nki", group.rotation, flat[:, None, :] - group.position)
            found, direction = KERNELS[group.kind](local, group.size)
            distance[:, group.index] = found
            gradient[:, group.index] = np.einsum("kij,nkj->nki", group.rotation, direction)
        for hull in self._hulls:
            distance[:, hull.index], gradient[:, hull.index] = _hull_distances(hull, flat)
        batch = x.shape[:-1]
        return distance.reshape(*batch, -1), gradient.reshape(*batch, len(self.pieces), 3)


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
    distances = packed.distances(centres)
    smallest: Array = distances.min(axis=-1, initial=np.inf) - np.asarray(radii, dtype=float)
    return smallest


def sphere_clearance_gradients(
    centres: ArrayLike, radii: ArrayLike, obstacles: ObstacleArrays | Sequence[Piece]
) -> tuple[Array, Array, NDArray[np.int64]]:
    """As `sphere_clearances`, with the gradients (..., m, 3) and the index (..., m) of the nearest piece.

    Without obstacles the distances are inf, the gradients zero and the indices -1.
    """
    packed = obstacles if isinstance(obstacles, ObstacleArrays) else ObstacleArrays(obstacles)
    centres = np.asarray(centres, dtype=float)
    if len(packed) == 0:
        batch = centres.shape[:-1]
        return np.full(batch, np.inf), np.zeros(centres.shape), np.full(batch, -1)
    distances, gradients = packed.distances_and_gradients(centres)
    nearest = np.argmin(distances, axis=-1)
    smallest = np.take_along_axis(distances, nearest[..., None], axis=-1)[..., 0]
    direction = np.take_along_axis(gradients, nearest[..., None, None], axis=-2)[..., 0, :]
    return smallest - np.asarray(radii, dtype=float), direction, nearest


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


def _hull(index: int, piece: Piece) -> _Hull:
    polytope = polytope_of(piece)
    a, b, c = (polytope.vertices[polytope.triangles[:, k]] for k in range(3))
    return _Hull(index, polytope.planes, a, b, c)


def _hull_distances(hull: _Hull, x: Array) -> tuple[Array, Array]:
    """Inside: the nearest facet's plane; outside: the nearest point of the surface's triangles."""
    heights = x @ hull.planes[:, :3].T + hull.planes[:, 3]
    facet = np.argmax(heights, axis=1)
    distance = heights[np.arange(len(x)), facet]
    gradient = hull.planes[facet, :3].copy()
    outside = np.flatnonzero(distance > 0)
    for start in range(0, len(outside), 4096):
        rows = outside[start : start + 4096]
        nearest = closest_on_triangles(x[rows, None, :], hull.a, hull.b, hull.c)
        offset = x[rows, None, :] - nearest
        length = np.linalg.norm(offset, axis=-1)
        best = np.argmin(length, axis=1)
        picked = np.arange(len(rows)), best
        # Where the offset is tiny its direction is mostly rounding: the facet's normal is the better answer.
        clear = length[picked] > 1e-12
        distance[rows] = length[picked]
        gradient[rows[clear]] = offset[picked][clear] / length[picked][clear, None]
    return distance, gradient
