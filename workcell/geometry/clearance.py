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
    """One hull in the world: its place in the list, planes (f, 4), and triangle corners, each (t, 3).

    The ball around its `middle`, a point inside, with `radius` holds all of it.
    """

    index: int
    middle: Array
    radius: float
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
        return distance.reshape(*batch, len(self.pieces)), gradient.reshape(*batch, len(self.pieces), 3)

    def floor(self, points: ArrayLike) -> Array:
        """A lower bound (...) on the signed distance of points (..., 3) to the nearest piece, exact inside.

        Only outside of hulls is it not exact: there it is the largest distance from a facet's plane.
        """
        x = np.asarray(points, dtype=float)
        flat = x.reshape(-1, 3)
        distance = np.full(len(flat), np.inf)
        for group in self._groups:
            local = np.einsum("kji,nkj->nki", group.rotation, flat[:, None, :] - group.position)
            distance = np.minimum(distance, KERNELS[group.kind](local, group.size)[0].min(axis=1))
        for hull in self._hulls:
            heights = flat @ hull.planes[:, :3].T + hull.planes[:, 3]
            distance = np.minimum(distance, heights.max(axis=1))
        return distance.reshape(x.shape[:-1])

    def nearest(self, points: ArrayLike) -> tuple[Array, Array, NDArray[np.int64]]:
        """Signed distance (...) of points (..., 3) to the nearest piece, its gradient (..., 3), and the piece (...).

        The same as the smallest of `distances_and_gradients`, but hulls that can't be the nearest are passed over.
        """
        x = np.asarray(points, dtype=float)
        flat = x.reshape(-1, 3)
        distance, gradient = np.full(len(flat), np.inf), np.zeros((len(flat), 3))
        index = np.full(len(flat), -1)
        for group in self._groups:
            local = np.einsum("kji,nkj->nki", group.rotation, flat[:, None, :] - group.position)
            found, direction = KERNELS[group.kind](local, group.size)
            best = np.argmin(found, axis=1)
            picked = np.arange(len(flat)), best
            rows = np.flatnonzero(found[picked] < distance)
            distance[rows] = found[picked][rows]
            gradient[rows] = np.einsum("nij,nj->ni", group.rotation[best[rows]], direction[picked][rows])
            index[rows] = group.index[best[rows]]
        self._nearest_hulls(flat, distance, gradient, index)
        batch = x.shape[:-1]
        return distance.reshape(batch), gradient.reshape(*batch, 3), index.reshape(batch)

    def _nearest_hulls(self, x: Array, distance: Array, gradient: Array, index: NDArray[np.int64]) -> None:
        """Lower the distances of points (n, 3), in place, where a hull is nearer."""
        if not self._hulls or len(x) == 0:
            return
        middles = np.array([hull.middle for hull in self._hulls])
        away = np.linalg.norm(x[:, None, :] - middles, axis=2)
        ceiling = np.minimum(distance, away.min(axis=1) + 1e-9)
        floor = away - np.array([hull.radius for hull in self._hulls])
        for column in np.argsort(floor.min(axis=0)):
            hull = self._hulls[int(column)]
            rows = np.flatnonzero(floor[:, column] <= ceiling)
            if len(rows) == 0:
                continue
            heights = (x[rows] @ hull.planes[:, :3].T + hull.planes[:, 3]).max(axis=1)
            rows = rows[heights <= ceiling[rows]]
            found, direction = _hull_distances(hull, x[rows])
            nearer = found < distance[rows]
            rows = rows[nearer]
            distance[rows], gradient[rows], index[rows] = found[nearer], direction[nearer], hull.index
            ceiling[rows] = np.minimum(ceiling[rows], found[nearer])


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


def _hull(index: int, piece: Piece) -> _Hull:
    polytope = polytope_of(piece)
    a, b, c = (polytope.vertices[polytope.triangles[:, k]] for k in range(3))
    middle = polytope.vertices.mean(axis=0)
    radius = float(np.linalg.norm(polytope.vertices - middle, axis=1).max())
    return _Hull(index, middle, radius, polytope.planes, a, b, c)


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
