"""An independent oracle: signed distances from points to convex shapes in plain numpy, with gradients.

Each function takes points in the shapes' own frames, (..., k, 3) against k shapes, and returns distances (..., k) in
metres and their gradients (..., k, 3): unit vectors that point away from the shape. Where the nearest surface point is
not unique (the centre of a ball, a box's diagonal planes) one of the valid directions is returned.
"""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
from scipy.spatial import ConvexHull

from workcell.geometry.types import Piece
from workcell.pose import Array

_TINY = 1e-300


def box(x: Array, half: Array) -> tuple[Array, Array]:
    """Boxes with half sizes `half` (k, 3)."""
    over = np.abs(x) - half
    outside = np.maximum(over, 0.0)
    length = np.sqrt(np.sum(outside * outside, axis=-1))
    deepest = over.max(axis=-1)
    face = (over == deepest[..., None]) & (np.cumsum(over == deepest[..., None], axis=-1) == 1)
    direction = np.where(
        (length > 0)[..., None], outside / np.maximum(length, _TINY)[..., None], face.astype(float)
    )
    return length + np.minimum(deepest, 0.0), np.where(x < 0, -direction, direction)


def sphere(x: Array, size: Array) -> tuple[Array, Array]:
    """Balls with radii `size` (k, 1)."""
    length, direction = _unit(x)
    return length - size[:, 0], direction


def capsule(x: Array, size: Array) -> tuple[Array, Array]:
    """Capsules along z, `size` (k, 2): radius, half length of the straight part."""
    offset = x.copy()
    offset[..., 2] -= np.clip(x[..., 2], -size[:, 1], size[:, 1])
    length, direction = _unit(offset, fallback=0)
    return length - size[:, 0], direction


def cylinder(x: Array, size: Array) -> tuple[Array, Array]:
    """Cylinders along z, `size` (k, 2): radius, half length."""
    flat = x.copy()
    flat[..., 2] = 0.0
    radius, radial = _unit(flat, fallback=0)
    axial = np.zeros_like(x)
    axial[..., 2] = np.where(x[..., 2] < 0, -1.0, 1.0)
    side, end = radius - size[:, 0], np.abs(x[..., 2]) - size[:, 1]
    out_side, out_end = np.maximum(side, 0.0), np.maximum(end, 0.0)
    length = np.hypot(out_side, out_end)
    inside = np.where((side > end)[..., None], radial, axial)
    weighted = (out_side[..., None] * radial + out_end[..., None] * axial) / np.maximum(length, _TINY)[
        ..., None
    ]
    distance = length + np.minimum(np.maximum(side, end), 0.0)
    return distance, np.where((length > 0)[..., None], weighted, inside)


def halfspace(x: Array, size: Array) -> tuple[Array, Array]:
    """Half-spaces z <= 0."""
    direction = np.zeros_like(x)
    direction[..., 2] = 1.0
    return x[..., 2].copy(), direction


def ellipsoid(x: Array, axes: Array) -> tuple[Array, Array]:
    """Ellipsoids with semi-axes `axes` (k, 3).

    The foot of the normal is e^2 y / (t + e^2) with F(t) = sum (e y / (t + e^2))^2 = 1. F is convex and falls, so
    Newton's iteration from the left of the root climbs to it without overshooting.
    """
    y = np.maximum(np.abs(x), 1e-14)
    square = axes**2
    t = np.max(axes * y - square, axis=-1)
    for _ in range(100):
        denominator = t[..., None] + square
        term = (axes * y / denominator) ** 2
        excess = term.sum(axis=-1) - 1.0
        step = 0.5 * excess / np.maximum(np.sum(term / denominator, axis=-1), _TINY)
        t = t + step
        if np.all(np.abs(step) <= 1e-15 * (1.0 + np.abs(t))):
            break
    ratio = y / (t[..., None] + square)
    _, normal = _unit(ratio)
    inside = np.sum((y / axes) ** 2, axis=-1) < 1.0
    length = np.linalg.norm(y - square * ratio, axis=-1)
    return np.where(inside, -length, length), np.where(x < 0, -normal, normal)


KERNELS: dict[str, Callable[[Array, Array], tuple[Array, Array]]] = {
    "box": box,
    "sphere": sphere,
    "capsule": capsule,
    "cylinder": cylinder,
    "halfspace": halfspace,
    "ellipsoid": ellipsoid,
}


def closest_on_triangles(x: Array, a: Array, b: Array, c: Array) -> Array:
    """Nearest points (..., 3) of triangles with corners a, b, c (broadcast against points x (..., 3)).

    By the regions of the triangle's corners, edges and inside (Ericson, Real-Time Collision Detection, 5.1.5).
    """
    ab, ac = b - a, c - a
    d1, d2 = _dot(ab, x - a), _dot(ac, x - a)
    d3, d4 = _dot(ab, x - b), _dot(ac, x - b)
    d5, d6 = _dot(ab, x - c), _dot(ac, x - c)
    va, vb, vc = d3 * d6 - d5 * d4, d5 * d2 - d1 * d6, d1 * d4 - d3 * d2
    total = va + vb + vc
    total = np.where(np.abs(total) > _TINY, total, 1.0)
    nearest = a + (vb / total)[..., None] * ab + (vc / total)[..., None] * ac
    on_bc = _fraction(d4 - d3, (d4 - d3) + (d5 - d6))
    cases = (
        ((va <= 0) & (d4 >= d3) & (d5 >= d6), b + on_bc[..., None] * (c - b)),
        ((vb <= 0) & (d2 >= 0) & (d6 <= 0), a + _fraction(d2, d2 - d6)[..., None] * ac),
        ((vc <= 0) & (d1 >= 0) & (d3 <= 0), a + _fraction(d1, d1 - d3)[..., None] * ab),
        ((d6 >= 0) & (d5 <= d6), c),
        ((d3 >= 0) & (d4 <= d3), b),
        ((d1 <= 0) & (d2 <= 0), a),
    )
    for region, point in cases:
        nearest = np.where(region[..., None], point, nearest)
    return nearest


def _fraction(part: Array, whole: Array) -> Array:
    return np.clip(part / np.where(np.abs(whole) > _TINY, whole, 1.0), 0.0, 1.0)


def _dot(a: Array, b: Array) -> Array:
    product: Array = np.sum(a * b, axis=-1)
    return product


def _unit(x: Array, fallback: int = 2) -> tuple[Array, Array]:
    """Lengths and unit vectors; the axis `fallback` where the length vanishes."""
    length = np.sqrt(np.sum(x * x, axis=-1))
    direction = x / np.maximum(length, _TINY)[..., None]
    if np.any(length == 0):
        axis = np.zeros(3)
        axis[fallback] = 1.0
        direction = np.where((length == 0)[..., None], axis, direction)
    return length, direction


def plain_distances(points: Array, piece: Piece) -> tuple[Array, Array]:
    """Signed distances (p,) and gradients (p, 3) of points (p, 3) to one piece."""
    local = piece.pose.inverse().apply(points)
    if piece.kind == "hull":
        distance, gradient = _hull(local, piece)
    else:
        columns = KERNELS[piece.kind](local[:, None, :], piece.size[None])
        distance, gradient = columns[0][:, 0], columns[1][:, 0]
    return distance, gradient @ piece.pose.rotation.T


def _hull(x: Array, piece: Piece) -> tuple[Array, Array]:
    """Inside: the nearest facet's plane; outside: the nearest point of the surface's triangles."""
    hull = ConvexHull(piece.vertices)
    a, b, c = (hull.points[hull.simplices[:, k]] for k in range(3))
    heights = x @ hull.equations[:, :3].T + hull.equations[:, 3]
    facet = np.argmax(heights, axis=1)
    rows = np.arange(len(x))
    offset = x[:, None, :] - closest_on_triangles(x[:, None, :], a, b, c)
    length = np.linalg.norm(offset, axis=-1)
    best = np.argmin(length, axis=1)
    outside = heights[rows, facet] > 0
    away = offset[rows, best] / np.maximum(length[rows, best], _TINY)[:, None]
    distance = np.where(outside, length[rows, best], heights[rows, facet])
    return distance, np.where(outside[:, None], away, hull.equations[facet, :3])
