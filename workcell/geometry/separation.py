"""Proof that cuboids and convex pieces are disjoint: a separating direction, checked by exact support functions."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from workcell.errors import ModelError
from workcell.geometry.polytope import polytope_of
from workcell.geometry.types import Piece
from workcell.pose import Array


def support(piece: Piece, direction: Array) -> Array:
    """Largest `n . x` over the piece's points x, exactly, for directions n (..., 3); inf where it is unbounded."""
    n = np.asarray(direction, dtype=float)
    local = n @ piece.pose.rotation
    at = n @ piece.pose.position
    size = piece.size
    if piece.kind == "box":
        reach = np.abs(local) @ size
    elif piece.kind == "sphere":
        reach = size[0] * np.linalg.norm(local, axis=-1)
    elif piece.kind == "capsule":
        reach = size[0] * np.linalg.norm(local, axis=-1) + size[1] * np.abs(local[..., 2])
    elif piece.kind == "cylinder":
        reach = size[0] * np.hypot(local[..., 0], local[..., 1]) + size[1] * np.abs(local[..., 2])
    elif piece.kind == "ellipsoid":
        reach = np.linalg.norm(local * size, axis=-1)
    elif piece.kind == "halfspace":
        sideways = np.hypot(local[..., 0], local[..., 1]) > 1e-12 * np.linalg.norm(local, axis=-1)
        reach = np.where(sideways | (local[..., 2] < 0), np.inf, 0.0)
    else:
        assert piece.vertices is not None
        reach = (local @ piece.vertices.T).max(axis=-1)
    total: Array = at + reach
    return total


def support_point(piece: Piece, direction: Array) -> Array:
    """A point (3,) of a bounded piece that is farthest in a direction (3,)."""
    local = np.asarray(direction, dtype=float) @ piece.pose.rotation
    size = piece.size
    if piece.kind == "box":
        point = np.copysign(size, local)
    elif piece.kind in ("sphere", "capsule"):
        point = size[0] * local / max(float(np.linalg.norm(local)), 1e-300)
        if piece.kind == "capsule":
            point[2] += np.copysign(size[1], local[2])
    elif piece.kind == "cylinder":
        around = size[0] * local[:2] / max(float(np.hypot(local[0], local[1])), 1e-300)
        point = np.append(around, np.copysign(size[1], local[2]))
    elif piece.kind == "ellipsoid":
        point = size**2 * local / max(float(np.linalg.norm(local * size)), 1e-300)
    elif piece.kind == "hull":
        assert piece.vertices is not None
        point = piece.vertices[int(np.argmax(piece.vertices @ local))]
    else:
        raise ModelError("a half-space has no farthest point", where=piece.name)
    return np.asarray(piece.pose.apply(point))


def bounding_box(piece: Piece) -> tuple[Array, Array]:
    """Corners (3,), (3,) of the smallest axis-aligned box around the piece; infinite for a half-space."""
    return -support(piece, -np.eye(3)), support(piece, np.eye(3))


def separations(lower: Array, upper: Array, pieces: Sequence[Piece]) -> tuple[Array, Array]:
    """For every cuboid and piece a direction that separates them, and by how much.

    Args:
        lower, upper: (k, 3) corners of axis-aligned cuboids.
        pieces: p convex pieces in the same frame.

    Returns:
        margin (k, p) metres: smallest `n . x` over the piece minus largest over the cuboid, by exact support functions;
            >= 0 proves that their insides are disjoint. Negative: no direction was found that separates them, which
            for boxes, hulls, spheres and half-spaces means that they overlap (for the curved others: or nearly touch).
        normal (k, p, 3): the unit direction, from cuboid to piece.
    """
    lower, upper = np.asarray(lower, dtype=float), np.asarray(upper, dtype=float)
    margin = np.empty((len(lower), len(pieces)))
    normal = np.empty((len(lower), len(pieces), 3))
    axes = np.vstack([np.eye(3), -np.eye(3)])
    reach = np.hstack([upper, -lower])
    for column, piece in enumerate(pieces):
        nearest = -support(piece, -axes)
        gaps = nearest - reach
        best = np.argmax(gaps, axis=1)
        margin[:, column] = gaps[np.arange(len(lower)), best]
        normal[:, column] = axes[best]
        for row in np.flatnonzero(margin[:, column] < 0):
            direction = _best_direction(lower[row], upper[row], piece)
            gap = _gap(direction, lower[row], upper[row], piece)
            if gap > margin[row, column]:
                margin[row, column], normal[row, column] = gap, direction
    return margin, normal


def _best_direction(lower: Array, upper: Array, piece: Piece) -> Array:
    """The most separating direction among those that can be the best for this kind of piece."""
    if piece.kind == "halfspace":
        down: Array = -piece.pose.rotation[:, 2]
        return down
    if piece.kind == "sphere":
        offset = piece.pose.position - np.clip(piece.pose.position, lower, upper)
        length = np.linalg.norm(offset)
        return offset / length if length > 0 else np.array([0.0, 0.0, 1.0])
    polytope = polytope_of(piece)
    edges = polytope.vertices[polytope.edges[:, 1]] - polytope.vertices[polytope.edges[:, 0]]
    crossed = np.cross(edges[:, None, :], np.eye(3)).reshape(-1, 3)
    length = np.linalg.norm(crossed, axis=1)
    crossed = crossed[length > 1e-12] / length[length > 1e-12, None]
    candidates = np.vstack([-polytope.planes[:, :3], crossed, -crossed])
    nearest = (candidates @ polytope.vertices.T).min(axis=1)
    farthest = np.maximum(candidates * lower, candidates * upper).sum(axis=1)
    best: Array = candidates[np.argmax(nearest - farthest)]
    return best


def _gap(direction: Array, lower: Array, upper: Array, piece: Piece) -> float:
    farthest = np.maximum(direction * lower, direction * upper).sum()
    return float(-support(piece, -direction) - farthest)
