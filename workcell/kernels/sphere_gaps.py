"""Clearances of a robot's spheres to shapes and to each other, at batches of configurations, with gradients."""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from workcell.jit import inner, kernel
from workcell.kernels.chain import Point, Tree, add_rates, carried, forward_tree
from workcell.kernels.shapes import Shapes, nearest_shape, to_shape, to_shapes
from workcell.pose import Array

Index = NDArray[np.int64]


@inner
def place_spheres(tree: Tree, spheres: Array, q: Array, T: Array, centres: Array) -> None:
    """Link frames T (n + 1, 12) and the spheres' centres (m, 3) in the world."""
    forward_tree(tree, q, T)
    for i in range(spheres.shape[0]):
        centres[i, 0], centres[i, 1], centres[i, 2] = carried(T, int(spheres[i, 4]), spheres, i)


@inner
def _point(centres: Array, i: int) -> Point:
    return centres[i, 0], centres[i, 1], centres[i, 2]


@inner
def apart(centres: Array, i: int, j: int) -> tuple[float, Point]:
    """Distance of two centres, and the direction from the second to the first."""
    x, y, z = centres[i, 0] - centres[j, 0], centres[i, 1] - centres[j, 1], centres[i, 2] - centres[j, 2]
    d = math.sqrt(x * x + y * y + z * z)
    if d < 1e-12:
        return d, (0.0, 0.0, 1.0)
    return d, (x / d, y / d, z / d)


@inner
def add_self_rates(
    tree: Tree, T: Array, spheres: Array, centres: Array, i: int, j: int, direction: Point, out: Array
) -> None:
    """Gradient (n,) of the gap between spheres i and j; of joints that carry both the parts cancel."""
    add_rates(tree, T, int(spheres[i, 4]), _point(centres, i), direction, 1.0, out)
    add_rates(tree, T, int(spheres[j, 4]), _point(centres, j), direction, -1.0, out)


@kernel
def sphere_gaps(
    tree: Tree, spheres: Array, shapes: Shapes, q: Array, gap: Array, gradient: Array, which: Index
) -> None:
    """Per sphere and configuration q (c, n) the gap (c, m) to the nearest shape `which` (c, m); none: inf, -1.

    The gradients (c, m, n) are left out where the array has no rows.
    """
    T, centres = np.empty((tree.frames.shape[0], 12)), np.empty((spheres.shape[0], 3))
    keys = np.empty(shapes.boxes.shape[1])
    for c in range(q.shape[0]):
        place_spheres(tree, spheres, q[c], T, centres)
        for i in range(spheres.shape[0]):
            x, y, z = _point(centres, i)
            d, at = nearest_shape(shapes, x, y, z, np.inf, keys)
            gap[c, i] = d - spheres[i, 3]
            which[c, i] = shapes.order[at] if at >= 0 else -1
            if gradient.shape[0] > 0:
                for k in range(q.shape[1]):
                    gradient[c, i, k] = 0.0
                if at >= 0:
                    direction = to_shape(shapes, at, x, y, z)[1:]
                    add_rates(tree, T, int(spheres[i, 4]), (x, y, z), direction, 1.0, gradient[c, i])


@kernel
def pair_gaps(tree: Tree, spheres: Array, shapes: Shapes, q: Array, gap: Array, gradient: Array) -> None:
    """At one q (n,) the gaps (m, k) of every sphere to every shape and their gradients (m, k, n)."""
    T, centres = np.empty((tree.frames.shape[0], 12)), np.empty((spheres.shape[0], 3))
    n = q.shape[0]
    J, found = np.empty((3, n)), np.empty((4, shapes.order.shape[0]))
    place_spheres(tree, spheres, q, T, centres)
    for i in range(spheres.shape[0]):
        x, y, z = _point(centres, i)
        for a in range(n):
            J[0, a], J[1, a], J[2, a] = 0.0, 0.0, 0.0
        link = int(spheres[i, 4])
        add_rates(tree, T, link, (x, y, z), (1.0, 0.0, 0.0), 1.0, J[0])
        add_rates(tree, T, link, (x, y, z), (0.0, 1.0, 0.0), 1.0, J[1])
        add_rates(tree, T, link, (x, y, z), (0.0, 0.0, 1.0), 1.0, J[2])
        to_shapes(shapes, x, y, z, found)
        for j in range(shapes.order.shape[0]):
            k = shapes.order[j]
            u, v, w = found[1, j], found[2, j], found[3, j]
            gap[i, k] = found[0, j] - spheres[i, 3]
            for a in range(n):
                gradient[i, k, a] = u * J[0, a] + v * J[1, a] + w * J[2, a]


@kernel
def self_gaps(tree: Tree, spheres: Array, pairs: Index, q: Array, gap: Array, gradient: Array) -> None:
    """Gaps (c, p) between pairs (p, 2) of spheres at q (c, n), and gradients (c, p, n) unless that has no rows."""
    T, centres = np.empty((tree.frames.shape[0], 12)), np.empty((spheres.shape[0], 3))
    for c in range(q.shape[0]):
        place_spheres(tree, spheres, q[c], T, centres)
        for p in range(pairs.shape[0]):
            i, j = pairs[p, 0], pairs[p, 1]
            d, direction = apart(centres, i, j)
            gap[c, p] = d - spheres[i, 3] - spheres[j, 3]
            if gradient.shape[0] > 0:
                for k in range(q.shape[1]):
                    gradient[c, p, k] = 0.0
                add_self_rates(tree, T, spheres, centres, i, j, direction, gradient[c, p])


@inner
def _nearest_pair(spheres: Array, pairs: Index, centres: Array, below: float, hint: int) -> tuple[float, int]:
    """The smallest gap between two spheres and its pair; (`below`, -1) where none is below that.

    `hint` is asked first.
    """
    best, at = below, -1
    for p in range(-1 if hint >= 0 else 0, pairs.shape[0]):
        pair = hint if p < 0 else p
        i, j = pairs[pair, 0], pairs[pair, 1]
        radii = spheres[i, 3] + spheres[j, 3]
        x, y, z = centres[i, 0] - centres[j, 0], centres[i, 1] - centres[j, 1], centres[i, 2] - centres[j, 2]
        square, touching = x * x + y * y + z * z, best + radii
        if touching > 0.0 and square < touching * touching:
            gap = math.sqrt(square) - radii
            if gap < best:
                best, at = gap, pair
    return best, at


@kernel
def smallest_gaps(
    tree: Tree, spheres: Array, shapes: Shapes, pairs: Index, q: Array, gap: Array, gradient: Array, where: Index
) -> None:  # fmt: skip
    """The smallest gap (c,) at each q (c, n), to a shape or between two spheres; inf where there is nothing.

    `where` (c, 3): the sphere, the shape and the other sphere, -1 for what is not there. Gradients (c, n) unless that
    has no rows. Exact: what is passed over is proved farther by the ball around it.
    """
    T, centres = np.empty((tree.frames.shape[0], 12)), np.empty((spheres.shape[0], 3))
    keys, hint = np.empty(shapes.boxes.shape[1]), -1
    for c in range(q.shape[0]):
        place_spheres(tree, spheres, q[c], T, centres)
        best, sphere, shape = np.inf, -1, -1
        for i in range(spheres.shape[0]):
            x, y, z = _point(centres, i)
            d, at = nearest_shape(shapes, x, y, z, best + spheres[i, 3], keys)
            if at >= 0:
                best, sphere, shape = d - spheres[i, 3], i, at
        best, pair = _nearest_pair(spheres, pairs, centres, best, hint)
        hint = pair if pair >= 0 else hint
        gap[c] = best
        where[c, 0], where[c, 1], where[c, 2] = sphere, -1, -1
        if pair >= 0:
            where[c, 0], where[c, 2] = pairs[pair, 0], pairs[pair, 1]
        elif shape >= 0:
            where[c, 1] = shapes.order[shape]
        if gradient.shape[0] > 0:
            for k in range(q.shape[1]):
                gradient[c, k] = 0.0
            if pair >= 0:
                i, j = pairs[pair, 0], pairs[pair, 1]
                direction = apart(centres, i, j)[1]
                add_self_rates(tree, T, spheres, centres, i, j, direction, gradient[c])
            elif sphere >= 0:
                x, y, z = _point(centres, sphere)
                direction = to_shape(shapes, shape, x, y, z)[1:]
                add_rates(tree, T, int(spheres[sphere, 4]), (x, y, z), direction, 1.0, gradient[c])
