"""Lower bounds of distances between convex solids, by Gilbert, Johnson and Keerthi: compiled.

A solid is the points within a radius of its core: a point, a segment, or what `support` knows. The distance of two
cores is bounded from below by a plane between them, which is what is handed back: rounding apart, it holds however
early the iteration ends. Solids meet where no plane was found.
"""

from __future__ import annotations

import math

import numpy as np

from workcell.jit import exact_inner, exact_kernel
from workcell.pose import Array

POINT, SEGMENT, BOX, CYLINDER, ELLIPSOID, HULL = range(6)
"""Kinds of cores: a sphere's, a capsule's, and those of solids without a radius."""

_ITERATIONS = 200
_GAP = 1e-8
"""Metres between the bounds of a distance at which it is known well enough."""


@exact_inner
def support(
    kind: int, size: Array, vertices: Array, turned: Array, place: Array, x: float, y: float, z: float
) -> tuple[float, float, float]:
    """The point of a core that is farthest along (x, y, z).

    Args:
        kind: of the core; size: (3,) MuJoCo's sizes of the geom; vertices: (k, 3) of a hull.
        turned, place: (9,) rotation, by rows, and (3,) position of the geom.
    """
    u = turned[0] * x + turned[3] * y + turned[6] * z
    v = turned[1] * x + turned[4] * y + turned[7] * z
    w = turned[2] * x + turned[5] * y + turned[8] * z
    a, b, c = 0.0, 0.0, 0.0
    if kind == SEGMENT:
        c = math.copysign(size[1], w)
    elif kind == BOX:
        a, b, c = math.copysign(size[0], u), math.copysign(size[1], v), math.copysign(size[2], w)
    elif kind == CYLINDER:
        across = math.sqrt(u * u + v * v)
        if across > 0.0:
            a, b = size[0] * u / across, size[0] * v / across
        c = math.copysign(size[1], w)
    elif kind == ELLIPSOID:
        a, b, c = size[0] * u, size[1] * v, size[2] * w
        long = math.sqrt(a * a + b * b + c * c)
        if long > 0.0:
            a, b, c = size[0] * a / long, size[1] * b / long, size[2] * c / long
    elif kind == HULL:
        best, at = -math.inf, 0
        for k in range(vertices.shape[0]):
            along = u * vertices[k, 0] + v * vertices[k, 1] + w * vertices[k, 2]
            if along > best:
                best, at = along, k
        a, b, c = vertices[at, 0], vertices[at, 1], vertices[at, 2]
    return (
        place[0] + turned[0] * a + turned[1] * b + turned[2] * c,
        place[1] + turned[3] * a + turned[4] * b + turned[5] * c,
        place[2] + turned[6] * a + turned[7] * b + turned[8] * c,
    )


@exact_inner
def core_distance(
    kind: int, size: Array, vertices: Array, turned: Array, place: Array, corners: Array, enough: float, near: Array
) -> float:  # fmt: skip
    """A lower bound of the distance between a core and the hull of `corners`, tight to `_GAP`; -inf: they meet.

    Args:
        kind, size, vertices, turned, place: of the core, as in `support`.
        corners: (k, 3) in the same frame as `place`.
        enough: metres; bounds above it end the search.
        near: (2, 3) for the nearest points of the core and of the hull.
    """
    simplex, weight = np.empty((4, 9)), np.empty(4)
    x, y, z = place[0] - corners[0, 0], place[1] - corners[0, 1], place[2] - corners[0, 2]
    count, bound = 0, -math.inf
    for _ in range(_ITERATIONS):
        square = x * x + y * y + z * z
        long = math.sqrt(square)
        if long < 1e-12:
            return -math.inf
        a, b, c = support(kind, size, vertices, turned, place, -x, -y, -z)
        best, at = -math.inf, 0
        for k in range(corners.shape[0]):
            along = x * corners[k, 0] + y * corners[k, 1] + z * corners[k, 2]
            if along > best:
                best, at = along, k
        p, q, r = a - corners[at, 0], b - corners[at, 1], c - corners[at, 2]
        here = (x * p + y * q + z * r) / long
        bound = max(bound, here)
        if bound > enough or (count > 0 and long - bound <= _GAP):
            break
        for k in range(count):
            if simplex[k, 0] == p and simplex[k, 1] == q and simplex[k, 2] == r:
                return bound if bound > 0.0 else -math.inf
        row = simplex[count]
        row[0], row[1], row[2], row[3], row[4], row[5] = p, q, r, a, b, c
        row[6], row[7], row[8] = corners[at, 0], corners[at, 1], corners[at, 2]
        count = _nearest(simplex, count + 1, weight)
        if count == 4:
            return -math.inf
        x, y, z = 0.0, 0.0, 0.0
        near[:] = 0.0
        for k in range(count):
            x += weight[k] * simplex[k, 0]
            y += weight[k] * simplex[k, 1]
            z += weight[k] * simplex[k, 2]
            for i in range(3):
                near[0, i] += weight[k] * simplex[k, 3 + i]
                near[1, i] += weight[k] * simplex[k, 6 + i]
        if count > 1 and x * x + y * y + z * z >= square:
            break  # rounding is all that is left
    return bound if bound > 0.0 else -math.inf


@exact_inner
def _nearest(simplex: Array, count: int, weight: Array) -> int:
    """Keep of a simplex (4, 9) the face nearest to the origin; how many corners it has, with weights of its point.

    4 means that the origin is inside.
    """
    if count == 4 and _inside(simplex):
        return 4
    best = math.inf
    first, second, third = 0, -1, -1
    for i in range(count):
        square = _dot(simplex, i, i)
        if square < best:
            best, first, second, third = square, i, -1, -1
            weight[0] = 1.0
    for i in range(count):
        for j in range(i + 1, count):
            a, b, c = _dot(simplex, i, i), _dot(simplex, i, j), _dot(simplex, j, j)
            long = a - 2.0 * b + c
            if long > 0.0:
                t = (a - b) / long
                square = a * (1.0 - t) * (1.0 - t) + 2.0 * b * t * (1.0 - t) + c * t * t
                if 0.0 < t < 1.0 and square < best:
                    best, first, second, third = square, i, j, -1
                    weight[0], weight[1] = 1.0 - t, t
    for skip in range(4 if count == 4 else 1 if count == 3 else 0):
        i, j, k = _others(skip) if count == 4 else (0, 1, 2)
        u, v, square = _on_face(simplex, i, j, k)
        if square < best:
            best, first, second, third = square, i, j, k
            weight[0], weight[1], weight[2] = 1.0 - u - v, u, v
    return _keep(simplex, first, second, third)


@exact_inner
def _others(skip: int) -> tuple[int, int, int]:
    """The three of four corners that are not `skip`."""
    if skip == 0:
        return 1, 2, 3
    if skip == 1:
        return 0, 2, 3
    if skip == 2:
        return 0, 1, 3
    return 0, 1, 2


@exact_inner
def _dot(simplex: Array, i: int, j: int) -> float:
    """Of two corners."""
    product: float = (
        simplex[i, 0] * simplex[j, 0] + simplex[i, 1] * simplex[j, 1] + simplex[i, 2] * simplex[j, 2]
    )
    return product


@exact_inner
def _on_face(simplex: Array, i: int, j: int, k: int) -> tuple[float, float, float]:
    """Weights of corners j and k of the face's point nearest to the origin, and its squared distance; inf: outside."""
    ax, ay, az = simplex[i, 0], simplex[i, 1], simplex[i, 2]
    bx, by, bz = simplex[j, 0] - ax, simplex[j, 1] - ay, simplex[j, 2] - az
    cx, cy, cz = simplex[k, 0] - ax, simplex[k, 1] - ay, simplex[k, 2] - az
    bb, bc, cc = bx * bx + by * by + bz * bz, bx * cx + by * cy + bz * cz, cx * cx + cy * cy + cz * cz
    area = bb * cc - bc * bc
    if area <= 1e-14 * bb * cc:
        return 0.0, 0.0, math.inf
    ab, ac = ax * bx + ay * by + az * bz, ax * cx + ay * cy + az * cz
    u, v = (ac * bc - ab * cc) / area, (ab * bc - ac * bb) / area
    if u <= 0.0 or v <= 0.0 or u + v >= 1.0:
        return 0.0, 0.0, math.inf
    x, y, z = ax + u * bx + v * cx, ay + u * by + v * cy, az + u * bz + v * cz
    return u, v, x * x + y * y + z * z


@exact_inner
def _volume(simplex: Array, i: int, j: int, k: int) -> float:
    """Six times the signed volume between the origin and three corners."""
    volume: float = (
        simplex[i, 0] * (simplex[j, 1] * simplex[k, 2] - simplex[j, 2] * simplex[k, 1])
        + simplex[i, 1] * (simplex[j, 2] * simplex[k, 0] - simplex[j, 0] * simplex[k, 2])
        + simplex[i, 2] * (simplex[j, 0] * simplex[k, 1] - simplex[j, 1] * simplex[k, 0])
    )
    return volume


@exact_inner
def _inside(simplex: Array) -> bool:
    """Whether the origin is strictly inside four corners."""
    a, b = _volume(simplex, 1, 2, 3), -_volume(simplex, 0, 2, 3)
    c, d = _volume(simplex, 0, 1, 3), -_volume(simplex, 0, 1, 2)
    return (a > 0.0 and b > 0.0 and c > 0.0 and d > 0.0) or (a < 0.0 and b < 0.0 and c < 0.0 and d < 0.0)


@exact_inner
def _keep(simplex: Array, first: int, second: int, third: int) -> int:
    """Move the rows that are kept, whose numbers rise, to the front; how many."""
    simplex[0] = simplex[first]
    if second < 0:
        return 1
    simplex[1] = simplex[second]
    if third < 0:
        return 2
    simplex[2] = simplex[third]
    return 3


@exact_kernel
def pierced(
    half: Array,
    turned: Array,
    place: Array,
    reach: float,
    axis_turned: Array,
    axis_place: Array,
    points: Array,
) -> bool:
    """Whether a segment goes through a box.

    Args:
        half, turned, place: half sizes, rotation (9,) and position of the box.
        reach: half the segment's length; axis_turned, axis_place: its frame, whose z axis it lies on.
        points: (6,) for the middle of what is inside, twice.
    """
    first, last = -reach, reach
    for k in range(3):
        from_middle, along = 0.0, 0.0
        for i in range(3):
            from_middle += turned[3 * i + k] * (axis_place[i] - place[i])
            along += turned[3 * i + k] * axis_turned[3 * i + 2]
        if along == 0.0:
            if abs(from_middle) > half[k]:
                return False
        else:
            one, other = (-half[k] - from_middle) / along, (half[k] - from_middle) / along
            first, last = max(first, min(one, other)), min(last, max(one, other))
    if first > last:
        return False
    for i in range(3):
        points[i] = axis_place[i] + 0.5 * (first + last) * axis_turned[3 * i + 2]
        points[3 + i] = points[i]
    return True
