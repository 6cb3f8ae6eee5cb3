"""Polytopes of convex pieces: corners, edges and facet planes in the world, exact or circumscribed."""

from __future__ import annotations

import functools
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from workcell.errors import ModelError
from workcell.geometry.types import Piece
from workcell.pose import Array

CORNERS = np.array([[x, y, z] for x in (-1.0, 1.0) for y in (-1.0, 1.0) for z in (-1.0, 1.0)])
"""Of the cube with half edges of 1."""
_SIDES = 48
"""Sides of the prism around a cylinder: it sticks out by 0.2 % of the radius."""


@dataclass(frozen=True, slots=True)
class Polytope:
    """A bounded convex polytope.

    Attributes:
        vertices: (v, 3).
        edges: (e, 2) pairs of vertex indices.
        planes: (f, 4) outward unit normal n and offset d: inside where `n . x + d <= 0`.
        triangles: (t, 3) vertex indices of a triangulated surface.
    """

    vertices: Array
    edges: NDArray[np.int64]
    planes: Array
    triangles: NDArray[np.int64]

    def placed(self, rotation: Array, position: Array) -> Polytope:
        """The polytope turned by `rotation` (3, 3) and moved by `position` (3,)."""
        normals = self.planes[:, :3] @ rotation.T
        offsets = self.planes[:, 3] - normals @ position
        vertices = self.vertices @ rotation.T + position
        return Polytope(vertices, self.edges, np.column_stack([normals, offsets]), self.triangles)


def polytope_of(piece: Piece) -> Polytope:
    """The piece itself where it is a box or a hull; else a polytope around it, in the piece's outer frame.

    The polytope around a curved piece contains all of it: what is disjoint from the one is disjoint from the other.

    Raises:
        ModelError: a half-space (unbounded), or a hull without volume.
    """
    if piece.kind == "halfspace":
        raise ModelError("a half-space has no corners", where=piece.name)
    local = _local_polytope(piece.kind, piece.size.tobytes(), _bytes(piece.vertices), piece.name)
    return local.placed(piece.pose.rotation, piece.pose.position)


def _bytes(vertices: Array | None) -> bytes:
    return b"" if vertices is None else vertices.tobytes()


@functools.lru_cache(maxsize=1024)
def _local_polytope(kind: str, size_bytes: bytes, vertex_bytes: bytes, name: str) -> Polytope:
    size = np.frombuffer(size_bytes)
    if kind == "hull":
        return hull_of(np.frombuffer(vertex_bytes).reshape(-1, 3), name)
    if kind == "box":
        return hull_of(CORNERS * size, name)
    if kind == "cylinder":
        ring = _ring(_SIDES) * size[0] / np.cos(np.pi / _SIDES)
        return hull_of(
            np.vstack([np.column_stack([ring, np.full(_SIDES, z)]) for z in (-size[1], size[1])]), name
        )
    ball = _ball_around()
    if kind == "capsule":
        end = np.array([0.0, 0.0, size[1]])
        return hull_of(np.vstack([ball * size[0] - end, ball * size[0] + end]), name)
    axes = np.full(3, size[0]) if kind == "sphere" else size
    return hull_of(ball * axes, name)


def hull_of(points: Array, name: str = "hull") -> Polytope:
    """Convex hull of points (k, 3) with merged facets; raises ModelError when it has no volume."""
    from scipy.spatial import ConvexHull, QhullError

    try:
        hull = ConvexHull(points)
    except QhullError:
        raise ModelError("the hull is flat", where=name, remedy="give the mesh a thickness") from None
    renumber = np.full(len(points), -1)
    renumber[hull.vertices] = np.arange(len(hull.vertices))
    triangles = renumber[hull.simplices]
    _, first, facet = np.unique(np.round(hull.equations, 9), axis=0, return_index=True, return_inverse=True)
    return Polytope(
        points[hull.vertices],
        _facet_edges(triangles, facet.reshape(-1), hull.neighbors),
        hull.equations[first],
        triangles,
    )


def _facet_edges(
    triangles: NDArray[np.int64], facet: NDArray[np.int64], neighbours: NDArray[np.int32]
) -> NDArray[np.int64]:
    """Edges between different facets; the diagonals inside one facet are not edges."""
    edges = set()
    for t, triangle in enumerate(triangles):
        for k in range(3):
            other = int(neighbours[t, k])  # shares the edge opposite corner k
            if facet[t] != facet[other]:
                a, b = sorted((int(triangle[(k + 1) % 3]), int(triangle[(k + 2) % 3])))
                edges.add((a, b))
    return np.array(sorted(edges), dtype=np.int64).reshape(-1, 2)


def _ring(sides: int) -> Array:
    angle = 2 * np.pi * (np.arange(sides) + 0.5) / sides
    return np.column_stack([np.cos(angle), np.sin(angle)])


@functools.cache
def _ball_around() -> Array:
    """Corners of a polytope around the unit ball: an icosahedron's faces split in four twice, pushed out."""
    from scipy.spatial import ConvexHull

    golden = (1 + np.sqrt(5)) / 2
    base = [[0, a, b * golden] for a in (-1, 1) for b in (-1, 1)]
    points = np.array([np.roll(p, k) for p in base for k in range(3)], dtype=float)
    points /= np.linalg.norm(points, axis=1, keepdims=True)
    for _ in range(2):
        triangles = ConvexHull(points).simplices
        middles = np.concatenate(
            [points[triangles[:, i]] + points[triangles[:, (i + 1) % 3]] for i in range(3)]
        )
        middles /= np.linalg.norm(middles, axis=1, keepdims=True)
        points = np.unique(np.round(np.vstack([points, middles]), 12), axis=0)
    inner = -ConvexHull(points).equations[:, 3].max()
    around: Array = points / inner
    return around
