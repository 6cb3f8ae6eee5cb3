"""Signed distances of points to a packed world of convex shapes: every pair, or the nearest shape of each point.

Axis-aligned boxes stand apart, one column each, so that the compiler handles several at once.
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from workcell.jit import inner, kernel
from workcell.kernels.distance import Distance, box_distance, hull_height, signed_distance
from workcell.kernels.shape_kinds import HALFSPACE, HULL
from workcell.pose import Array

Index = NDArray[np.int64]


class Shapes(NamedTuple):
    """Convex shapes.

    Attributes:
        boxes: (6, b) centres and half sizes of axis-aligned boxes.
        rows: (r, 19) all other shapes, as `workcell.geometry.packing.pack_obstacles` makes them.
        faces: (f, 13) triangles of hulls, as there.
        order: (b + r,) place of each in the list that was packed; boxes first.
    """

    boxes: Array
    rows: Array
    faces: Array
    order: Index


@inner
def box_keys(boxes: Array, x: float, y: float, z: float, keys: Array) -> None:
    """Of each box the squared distance outside, and the signed distance inside: both grow with the distance."""
    for j in range(boxes.shape[1]):
        ox, oy = abs(x - boxes[0, j]) - boxes[3, j], abs(y - boxes[1, j]) - boxes[4, j]
        oz = abs(z - boxes[2, j]) - boxes[5, j]
        px, py, pz = max(ox, 0.0), max(oy, 0.0), max(oz, 0.0)
        keys[j] = px * px + py * py + pz * pz + min(max(max(ox, oy), oz), 0.0)


@inner
def from_key(key: float) -> float:
    """The signed distance of a key."""
    return math.sqrt(key) if key > 0.0 else key


@inner
def to_shapes(shapes: Shapes, x: float, y: float, z: float, found: Array) -> None:
    """Signed distances and gradients from a point to all shapes, into found (4, k), in packed order."""
    boxes, b = shapes.boxes, shapes.boxes.shape[1]
    for j in range(b):
        dx, dy, dz = x - boxes[0, j], y - boxes[1, j], z - boxes[2, j]
        px, py = max(abs(dx) - boxes[3, j], 0.0), max(abs(dy) - boxes[4, j], 0.0)
        pz = max(abs(dz) - boxes[5, j], 0.0)
        d = math.sqrt(px * px + py * py + pz * pz)
        share = 1.0 / max(d, 1e-300)
        found[0, j] = d
        found[1, j] = math.copysign(px * share, dx)
        found[2, j] = math.copysign(py * share, dy)
        found[3, j] = math.copysign(pz * share, dz)
    for j in range(found.shape[1]):
        if j >= b or found[0, j] == 0.0:
            found[0, j], found[1, j], found[2, j], found[3, j] = to_shape(shapes, j, x, y, z)


@inner
def to_shape(shapes: Shapes, at: int, x: float, y: float, z: float) -> Distance:
    """Signed distance and gradient from a point to shape `at`, in packed order."""
    b = shapes.boxes.shape[1]
    if at < b:
        boxes = shapes.boxes
        return box_distance(
            x - boxes[0, at], y - boxes[1, at], z - boxes[2, at], boxes[3, at], boxes[4, at], boxes[5, at]
        )
    return signed_distance(shapes.rows, shapes.faces, at - b, x, y, z)


@inner
def nearest_shape(
    shapes: Shapes, x: float, y: float, z: float, below: float, keys: Array
) -> tuple[float, int]:
    """The smallest signed distance, and the shape in packed order; (`below`, -1) where none is below that."""
    best, at = below, -1
    b = shapes.boxes.shape[1]
    if b > 0:
        box_keys(shapes.boxes, x, y, z, keys)
        ceiling = best * best if best > 0.0 else best
        for j in range(b):
            if keys[j] < ceiling:
                ceiling, at = keys[j], j
        if at >= 0:
            best = from_key(ceiling)
    rows = shapes.rows
    for r in range(rows.shape[0]):
        if rows[r, 0] != HALFSPACE:
            dx, dy, dz = x - rows[r, 1], y - rows[r, 2], z - rows[r, 3]
            # No point is nearer to a shape than to the ball around it.
            ball = best + rows[r, 16]
            if ball <= 0.0 or dx * dx + dy * dy + dz * dz >= ball * ball:
                continue
        d = signed_distance(rows, shapes.faces, r, x, y, z)[0]
        if d < best:
            best, at = d, b + r
    return best, at


@kernel
def all_distances(shapes: Shapes, points: Array, distance: Array, gradient: Array) -> None:
    """Distances (p, k) of points (p, 3) and, where its length is not 0, their gradients (p, k, 3)."""
    b, total = shapes.boxes.shape[1], shapes.order.shape[0]
    keys, found = np.empty(b), np.empty((4, total))
    for i in range(points.shape[0]):
        x, y, z = points[i, 0], points[i, 1], points[i, 2]
        if gradient.shape[0] == 0:
            box_keys(shapes.boxes, x, y, z, keys)
            for j in range(b):
                distance[i, shapes.order[j]] = from_key(keys[j])
            for j in range(b, total):
                distance[i, shapes.order[j]] = signed_distance(shapes.rows, shapes.faces, j - b, x, y, z)[0]
        else:
            to_shapes(shapes, x, y, z, found)
            for j in range(total):
                k = shapes.order[j]
                distance[i, k] = found[0, j]
                gradient[i, k, 0], gradient[i, k, 1], gradient[i, k, 2] = (
                    found[1, j],
                    found[2, j],
                    found[3, j],
                )


@kernel
def nearest_distances(shapes: Shapes, points: Array, distance: Array, gradient: Array, which: Index) -> None:
    """Distance (p,), gradient (p, 3) and number (p,) of the shape nearest to each point (p, 3); inf, 0, -1 if none."""
    keys = np.empty(shapes.boxes.shape[1])
    for i in range(points.shape[0]):
        x, y, z = points[i, 0], points[i, 1], points[i, 2]
        distance[i], at = nearest_shape(shapes, x, y, z, np.inf, keys)
        which[i], gradient[i, 0], gradient[i, 1], gradient[i, 2] = -1, 0.0, 0.0, 0.0
        if at >= 0:
            which[i] = shapes.order[at]
            gradient[i, 0], gradient[i, 1], gradient[i, 2] = to_shape(shapes, at, x, y, z)[1:]


@kernel
def floor_distances(shapes: Shapes, points: Array, distance: Array) -> None:
    """Lower bounds (p,) of the smallest distance of points (p, 3): exact but outside of hulls, where planes count."""
    keys = np.empty(shapes.boxes.shape[1])
    rows, faces = shapes.rows, shapes.faces
    for i in range(points.shape[0]):
        x, y, z = points[i, 0], points[i, 1], points[i, 2]
        best = np.inf
        box_keys(shapes.boxes, x, y, z, keys)
        for j in range(keys.shape[0]):
            best = min(best, keys[j])
        best = from_key(best)
        for r in range(rows.shape[0]):
            hull = rows[r, 0] == HULL
            d = hull_height(rows, faces, r, x, y, z) if hull else signed_distance(rows, faces, r, x, y, z)[0]
            best = min(best, d)
        distance[i] = best
