"""Edges of boxes and polytopes as lines to draw: whole, or in dashes of several colours."""

from __future__ import annotations

import itertools
from collections.abc import Iterable, Sequence

import numpy as np

from workcell.pose import Array
from workcell.record.render.tessellate import Triangles
from workcell.record.show.canvas import Colour

CORNER_M = 1e-6
"""Corners that are nearer to each other are one."""
_EDGE_POINTS = 17
_FLAT = 1.0 - 1e-9
_BREAK = np.full((1, 3), np.nan)


def creases(mesh: Triangles) -> list[Array]:
    """Edges, as points (k, 3) each, at which triangles meet that are not in one plane."""
    corners = np.round(mesh.vertices / CORNER_M).astype(np.int64)
    sides: dict[frozenset[tuple[int, ...]], list[tuple[Array, Array]]] = {}
    for face in mesh.faces:
        points = mesh.vertices[face]
        normal = np.cross(points[1] - points[0], points[2] - points[0])
        normal /= max(float(np.linalg.norm(normal)), 1e-300)
        for a, b in itertools.pairwise([*face, face[0]]):
            ends = frozenset((tuple(corners[a].tolist()), tuple(corners[b].tolist())))
            sides.setdefault(ends, []).append(
                (normal, np.linspace(mesh.vertices[a], mesh.vertices[b], _EDGE_POINTS))
            )
    return [
        told[0][1]
        for told in sides.values()
        if any(normal @ told[0][0] < _FLAT for normal, _ in told) or len(told) == 1
    ]


def box_edges(low: Array, high: Array) -> list[Array]:
    """The twelve edges of an axis-aligned box, each as points (k, 3) on it."""
    corners = [np.where(side, high, low) for side in itertools.product((False, True), repeat=3)]
    pairs = itertools.combinations(corners, 2)
    return [np.linspace(a, b, _EDGE_POINTS) for a, b in pairs if np.count_nonzero(a != b) == 1]


def joined(edges: Iterable[Array]) -> Array:
    """Edges as one line with breaks (points that are no numbers): drawn at once, which is much quicker."""
    return np.concatenate([piece for edge in edges for piece in (edge, _BREAK)])


def dashes(edges: Sequence[Array], colours: Sequence[Colour]) -> list[tuple[Array, Colour]]:
    """Edges cut into dashes, each colour's turn after the other's, as one line with breaks for each colour."""
    count = len(colours)
    if count == 1:
        return [(joined(edges), colours[0])]
    pieces: list[list[Array]] = [[] for _ in colours]
    for edge in edges:
        for k in range(len(edge) - 1):
            pieces[k % count].append(edge[k : k + 2])
    return [(joined(mine), rgb) for mine, rgb in zip(pieces, colours, strict=True) if mine]
