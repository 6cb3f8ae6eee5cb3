"""Signed distances from points to convex obstacles, with their gradients: exact outside and inside.

An obstacle is a row as `workcell.geometry.packing.pack_obstacles` makes them; its kind is one of
`workcell.kernels.shape_kinds`.
"""

from __future__ import annotations

import math

from workcell.jit import inner
from workcell.kernels.constants import HUGE
from workcell.kernels.shape_kinds import BALL, BOX, CAPSULE, CYLINDER, ELLIPSOID, HALFSPACE
from workcell.pose import Array

Distance = tuple[float, float, float, float]
"""Signed distance in metres and its gradient."""
_TINY = 1e-12
"""Metres below which an offset has no direction."""


@inner
def signed_distance(obstacles: Array, faces: Array, j: int, x: float, y: float, z: float) -> Distance:
    """From the world point (x, y, z) to obstacle j, with the gradient in the world."""
    lx, ly, lz = _to_local(obstacles, j, x, y, z)
    a, b, c = obstacles[j, 13], obstacles[j, 14], obstacles[j, 15]
    kind = obstacles[j, 0]
    if kind == BOX:
        d, u, v, w = box_distance(lx, ly, lz, a, b, c)
    elif kind == CYLINDER:
        d, u, v, w = _cylinder(lx, ly, lz, a, b)
    elif kind == BALL or kind == CAPSULE:  # noqa: SIM109 -- compiles faster
        d, u, v, w = _capsule(lx, ly, lz, a, b)
    elif kind == HALFSPACE:
        d, u, v, w = lz, 0.0, 0.0, 1.0
    elif kind == ELLIPSOID:
        d, u, v, w = _ellipsoid(lx, ly, lz, a, b, c)
    else:
        d, u, v, w = _hull(faces, int(obstacles[j, 17]), int(obstacles[j, 18]), lx, ly, lz)
    return (
        d,
        obstacles[j, 4] * u + obstacles[j, 5] * v + obstacles[j, 6] * w,
        obstacles[j, 7] * u + obstacles[j, 8] * v + obstacles[j, 9] * w,
        obstacles[j, 10] * u + obstacles[j, 11] * v + obstacles[j, 12] * w,
    )


@inner
def _to_local(obstacles: Array, j: int, x: float, y: float, z: float) -> tuple[float, float, float]:
    x, y, z = x - obstacles[j, 1], y - obstacles[j, 2], z - obstacles[j, 3]
    return (
        obstacles[j, 4] * x + obstacles[j, 7] * y + obstacles[j, 10] * z,
        obstacles[j, 5] * x + obstacles[j, 8] * y + obstacles[j, 11] * z,
        obstacles[j, 6] * x + obstacles[j, 9] * y + obstacles[j, 12] * z,
    )


@inner
def hull_height(obstacles: Array, faces: Array, j: int, x: float, y: float, z: float) -> float:
    """Largest signed distance of a world point from the planes of hull j's facets: never above the signed distance."""
    x, y, z = _to_local(obstacles, j, x, y, z)
    highest = -HUGE
    for f in range(int(obstacles[j, 17]), int(obstacles[j, 18])):
        highest = max(highest, faces[f, 0] * x + faces[f, 1] * y + faces[f, 2] * z + faces[f, 3])
    return highest


@inner
def _capsule(x: float, y: float, z: float, radius: float, half: float) -> Distance:
    z -= min(max(z, -half), half)
    r = math.sqrt(x * x + y * y + z * z)
    if r < _TINY:
        return r - radius, 1.0, 0.0, 0.0
    return r - radius, x / r, y / r, z / r


@inner
def box_distance(x: float, y: float, z: float, a: float, b: float, c: float) -> Distance:
    """From a point in the box's frame, half sizes a, b, c."""
    ox, oy, oz = abs(x) - a, abs(y) - b, abs(z) - c
    px, py, pz = max(ox, 0.0), max(oy, 0.0), max(oz, 0.0)
    square = px * px + py * py + pz * pz
    if square > 0.0:
        d = math.sqrt(square)
        share = 1.0 / d
        return d, math.copysign(px * share, x), math.copysign(py * share, y), math.copysign(pz * share, z)
    if ox >= oy and ox >= oz:
        return ox, math.copysign(1.0, x), 0.0, 0.0
    if oy >= oz:
        return oy, 0.0, math.copysign(1.0, y), 0.0
    return oz, 0.0, 0.0, math.copysign(1.0, z)


@inner
def _cylinder(x: float, y: float, z: float, radius: float, half: float) -> Distance:
    r = math.sqrt(x * x + y * y)
    over, above, up = r - radius, abs(z) - half, math.copysign(1.0, z)
    u, v = (1.0, 0.0) if r < _TINY else (x / r, y / r)
    if over <= 0 or above <= 0:
        if over >= above:
            return over, u, v, 0.0
        return above, 0.0, 0.0, up
    d = math.sqrt(over * over + above * above)
    return d, u * over / d, v * over / d, up * above / d


@inner
def _ellipsoid(x: float, y: float, z: float, a: float, b: float, c: float) -> Distance:
    """The foot of the normal is e_i^2 x_i / (t + e_i^2), with sum (e_i x_i / (t + e_i^2))^2 = 1 (Eberly, Distance
    from a Point to an Ellipsoid, 2013). With s = t + smallest e^2 the sum is convex and falls; it starts between 1 and
    3, so that Newton's iteration climbs to the root in a few steps.
    """
    smallest = min(a, b, c) ** 2
    px, py, pz = max(abs(x), _TINY), max(abs(y), _TINY), max(abs(z), _TINY)
    da, db, dc = a * a - smallest, b * b - smallest, c * c - smallest
    s = max(a * px - da, b * py - db, c * pz - dc)
    for _ in range(60):
        qa, qb, qc = a * px / (s + da), b * py / (s + db), c * pz / (s + dc)
        excess = qa * qa + qb * qb + qc * qc - 1.0
        step = 0.5 * excess / (qa * qa / (s + da) + qb * qb / (s + db) + qc * qc / (s + dc))
        if not step > 1e-16 * s:
            break
        s += step
    fx, fy, fz = a * a * px / (s + da), b * b * py / (s + db), c * c * pz / (s + dc)
    d = math.sqrt((px - fx) ** 2 + (py - fy) ** 2 + (pz - fz) ** 2)
    u, v, w = math.copysign(fx / (a * a), x), math.copysign(fy / (b * b), y), math.copysign(fz / (c * c), z)
    length = math.sqrt(u * u + v * v + w * w)
    if (px / a) ** 2 + (py / b) ** 2 + (pz / c) ** 2 < 1.0:
        d = -d
    return d, u / length, v / length, w / length


@inner
def _hull(faces: Array, first: int, last: int, x: float, y: float, z: float) -> Distance:
    """Inside: the nearest facet's plane. Outside: the nearest point of the facets that face the point."""
    depth, nearest = -HUGE, HUGE
    face, u, v, w = first, 0.0, 0.0, 1.0
    for f in range(first, last):
        height = faces[f, 0] * x + faces[f, 1] * y + faces[f, 2] * z + faces[f, 3]
        if height > depth:
            depth, face = height, f
        if 0.0 < height < nearest:
            cx, cy, cz = _nearest_in_triangle(faces, f, x, y, z)
            d = math.sqrt((x - cx) ** 2 + (y - cy) ** 2 + (z - cz) ** 2)
            if d < nearest:
                nearest, u, v, w = d, x - cx, y - cy, z - cz
    if depth <= 0.0:
        return depth, faces[face, 0], faces[face, 1], faces[face, 2]
    if nearest < _TINY:
        # So small an offset is mostly rounding: the facet's normal is the better direction.
        return nearest, faces[face, 0], faces[face, 1], faces[face, 2]
    return nearest, u / nearest, v / nearest, w / nearest


@inner
def _nearest_in_triangle(faces: Array, f: int, x: float, y: float, z: float) -> tuple[float, float, float]:
    """Where the plane's foot lies inside, that; otherwise the nearest point of the three edges."""
    height = faces[f, 0] * x + faces[f, 1] * y + faces[f, 2] * z + faces[f, 3]
    within, nearest = True, HUGE
    bx, by, bz = 0.0, 0.0, 0.0
    for k in range(3):
        i, j = 4 + 3 * k, 4 + 3 * ((k + 1) % 3)
        ex, ey, ez = (
            faces[f, j] - faces[f, i],
            faces[f, j + 1] - faces[f, i + 1],
            faces[f, j + 2] - faces[f, i + 2],
        )
        rx, ry, rz = x - faces[f, i], y - faces[f, i + 1], z - faces[f, i + 2]
        # The inward side of an edge is normal x edge, with corners counter-clockwise about the normal.
        nx, ny, nz = faces[f, 0], faces[f, 1], faces[f, 2]
        if (ny * ez - nz * ey) * rx + (nz * ex - nx * ez) * ry + (nx * ey - ny * ex) * rz < 0.0:
            within = False
        t = min(max((ex * rx + ey * ry + ez * rz) / (ex * ex + ey * ey + ez * ez), 0.0), 1.0)
        dx, dy, dz = rx - t * ex, ry - t * ey, rz - t * ez
        square = dx * dx + dy * dy + dz * dz
        if square < nearest:
            nearest, bx, by, bz = square, x - dx, y - dy, z - dz
    if within:
        return x - height * faces[f, 0], y - height * faces[f, 1], z - height * faces[f, 2]
    return bx, by, bz
