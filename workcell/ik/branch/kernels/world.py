"""Signed distances from points to obstacles, with gradients: exact for all kinds but hulls (`hull_distance`)."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from workcell.jit import exact_inner, exact_kernel
from workcell.kernels.shape_kinds import BOX, CAPSULE, CYLINDER, HALFSPACE, HULL
from workcell.pose import Array

_ROUNDS = 60
_CONVERGED = 1e-9


class World(NamedTuple):
    """Spheres of the robot and obstacles, in the base's frame.

    Attributes:
        spheres: (m, 5) index of the frame that carries each, centre in it, radius.
        obstacles: (k, 24) kind (see `shape_kinds`), rotation (9), position (3), size (3), bounding box (6), first and
            last row of its vertices and planes (2 x 2, hulls only; -1 otherwise, at 22 and 23 of `vertices`, see
            `branch`).
        vertices: (v, 3) hull vertices in the obstacle's frame.
        planes: (f, 4) hull planes there: outward unit normal and offset.
        pairs: (p, 2) spheres that must keep clear of each other, the one nearer to the base first.
        clearance: (2,) the clearance c that a solution keeps, and the excess over it up to which "no" may go.
    """

    spheres: Array
    obstacles: Array
    vertices: Array
    planes: Array
    pairs: NDArray[np.int64]
    clearance: Array


@exact_inner
def to_local(row: Array, x: float, y: float, z: float) -> tuple[float, float, float]:
    """A point in an obstacle's frame."""
    u, v, w = x - row[10], y - row[11], z - row[12]
    return (
        row[1] * u + row[4] * v + row[7] * w,
        row[2] * u + row[5] * v + row[8] * w,
        row[3] * u + row[6] * v + row[9] * w,
    )


@exact_kernel
def signed_distance(world: World, index: int, x: float, y: float, z: float, gradient: Array) -> float:
    """Signed distance of a point to obstacle `index`; writes its gradient (3,)."""
    row = world.obstacles[index]
    kind = int(row[0])
    u, v, w = to_local(row, x, y, z)
    a, b, c = 0.0, 0.0, 1.0
    if kind == BOX:
        distance, a, b, c = _box(u, v, w, row[13], row[14], row[15])
    elif kind == HALFSPACE:
        distance = w
    elif kind == HULL:
        distance, a, b, c = hull_distance(world, index, u, v, w)
    elif kind == CYLINDER:
        distance, a, b, c = _cylinder(u, v, w, row[13], row[14])
    else:
        along = min(max(w, -row[14]), row[14]) if kind == CAPSULE else 0.0
        length = np.sqrt(u * u + v * v + (w - along) ** 2)
        distance = length - row[13]
        if length > 1e-12:
            a, b, c = u / length, v / length, (w - along) / length
    gradient[0] = row[1] * a + row[2] * b + row[3] * c
    gradient[1] = row[4] * a + row[5] * b + row[6] * c
    gradient[2] = row[7] * a + row[8] * b + row[9] * c
    return distance


@exact_inner
def _box(u: float, v: float, w: float, hu: float, hv: float, hw: float) -> tuple[float, float, float, float]:
    su, sv, sw = 1.0 if u >= 0 else -1.0, 1.0 if v >= 0 else -1.0, 1.0 if w >= 0 else -1.0
    eu, ev, ew = abs(u) - hu, abs(v) - hv, abs(w) - hw
    if eu <= 0.0 and ev <= 0.0 and ew <= 0.0:
        if eu >= ev and eu >= ew:
            return eu, su, 0.0, 0.0
        if ev >= ew:
            return ev, 0.0, sv, 0.0
        return ew, 0.0, 0.0, sw
    eu, ev, ew = max(eu, 0.0), max(ev, 0.0), max(ew, 0.0)
    length = np.sqrt(eu * eu + ev * ev + ew * ew)
    return length, su * eu / length, sv * ev / length, sw * ew / length


@exact_inner
def _cylinder(u: float, v: float, w: float, radius: float, half: float) -> tuple[float, float, float, float]:
    rho = np.sqrt(u * u + v * v)
    cu, cv = (u / rho, v / rho) if rho > 1e-12 else (1.0, 0.0)
    side = 1.0 if w >= 0 else -1.0
    er, ez = rho - radius, abs(w) - half
    if er > 0.0 and ez > 0.0:
        length = np.sqrt(er * er + ez * ez)
        return length, cu * er / length, cv * er / length, side * ez / length
    if er > ez:
        return er, cu, cv, 0.0
    return ez, 0.0, 0.0, side


@exact_inner
def hull_distance(
    world: World, index: int, u: float, v: float, w: float
) -> tuple[float, float, float, float]:
    """Inside a hull: the nearest plane. Outside: the distance to a point of the hull that is nearly the nearest.

    The point is found by Frank-Wolfe steps with away directions folded in (pairwise over the last vertex); whatever
    it is, it belongs to the hull, so the distance is never below the true one.
    """
    row = world.obstacles[index]
    first_plane, last_plane = int(row[22]), int(row[23])
    best, plane = -np.inf, first_plane
    for f in range(first_plane, last_plane):
        p = world.planes[f]
        height = p[0] * u + p[1] * v + p[2] * w + p[3]
        if height > best:
            best, plane = height, f
    if best <= 0.0:
        p = world.planes[plane]
        return best, p[0], p[1], p[2]
    first, last = int(row[13]), int(row[14])
    x, y, z = 0.0, 0.0, 0.0
    for k in range(first, last):
        x += world.vertices[k, 0]
        y += world.vertices[k, 1]
        z += world.vertices[k, 2]
    count = float(last - first)
    x, y, z = x / count, y / count, z / count
    weights = np.full(last - first, 1.0 / count)
    for _ in range(_ROUNDS):
        dx, dy, dz = u - x, v - y, w - z
        towards, away, low, high = first, first, np.inf, -np.inf
        for k in range(first, last):
            along = dx * world.vertices[k, 0] + dy * world.vertices[k, 1] + dz * world.vertices[k, 2]
            if along > high:
                high, towards = along, k
            if weights[k - first] > 0.0 and along < low:
                low, away = along, k
        if high - low < _CONVERGED:
            break
        ex = world.vertices[towards, 0] - world.vertices[away, 0]
        ey = world.vertices[towards, 1] - world.vertices[away, 1]
        ez = world.vertices[towards, 2] - world.vertices[away, 2]
        step = (dx * ex + dy * ey + dz * ez) / (ex * ex + ey * ey + ez * ez)
        step = min(step, weights[away - first])
        weights[away - first] -= step
        weights[towards - first] += step
        x, y, z = x + step * ex, y + step * ey, z + step * ez
    dx, dy, dz = u - x, v - y, w - z
    length = np.sqrt(dx * dx + dy * dy + dz * dz)
    if length < 1e-12:
        return 0.0, 0.0, 0.0, 1.0
    return length, dx / length, dy / length, dz / length
