"""A robot's spheres near obstacles and near each other: the pairs below a margin, with their gradients."""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np

from workcell.jit import inner
from workcell.kernels.chain import carried
from workcell.kernels.constants import FAR
from workcell.kernels.distance import signed_distance
from workcell.kernels.shape_kinds import HALFSPACE
from workcell.kernels.structures import World
from workcell.pose import Array

MOST_CONTACTS = 128
"""Contacts of one configuration that are kept; more mean that it is hopeless anyway."""


class Contacts(NamedTuple):
    """Pairs closer than a margin.

    Attributes:
        rows: (MOST_CONTACTS, 14) gap, gradient (3), sphere's centre (3) and link; the sphere's row, and the obstacle or
            minus one less the row of another sphere; that sphere's centre (3) and link, -1 for an obstacle.
        used: (1,) rows in use.
    """

    rows: Array
    used: Array


@inner
def room() -> Contacts:
    """An empty list of contacts."""
    return Contacts(np.empty((MOST_CONTACTS, 14)), np.zeros(1))


@inner
def _out_of_reach(world: World, j: int, x: float, y: float, z: float, reach: float) -> bool:
    """Whether obstacle j is surely farther than `reach` from a point, by its bounding ball and its own distance."""
    if world.obstacles[j, 0] != HALFSPACE:
        dx, dy, dz = x - world.obstacles[j, 1], y - world.obstacles[j, 2], z - world.obstacles[j, 3]
        reach_ball = reach + world.obstacles[j, 16]
        if dx * dx + dy * dy + dz * dz > reach_ball * reach_ball:
            return True
    return signed_distance(world.obstacles, world.faces, j, x, y, z)[0] > reach


@inner
def collect(world: World, T: Array, margin: float, stop_below: float, contacts: Contacts) -> float:
    """All pairs with a gap below `margin`, for frames T; returns the smallest gap (`FAR` where none is near).

    Gives up at a gap below `stop_below`, with the list incomplete.
    """
    rows, count, smallest = contacts.rows, 0, FAR
    obstacles = world.obstacles.shape[0]
    for link in range(world.balls.shape[0]):
        first, last = int(world.balls[link, 4]), int(world.balls[link, 5])
        if first == last:
            continue
        bx, by, bz = carried(T, link, world.balls, link)
        for j in range(obstacles):
            if _out_of_reach(world, j, bx, by, bz, world.balls[link, 3] + margin):
                continue
            for i in range(first, last):
                x, y, z = carried(T, link, world.spheres, i)
                d, u, v, w = signed_distance(world.obstacles, world.faces, j, x, y, z)
                gap: float = d - world.spheres[i, 3]
                if gap < margin and count < MOST_CONTACTS:
                    rows[count, 0], rows[count, 1], rows[count, 2], rows[count, 3] = gap, u, v, w
                    rows[count, 4], rows[count, 5], rows[count, 6] = x, y, z
                    rows[count, 7], rows[count, 8], rows[count, 9] = float(link), float(i), float(j)
                    rows[count, 13] = -1.0
                    count += 1
                if gap < smallest:
                    smallest = gap
                    if gap < stop_below:
                        contacts.used[0] = count
                        return smallest
    contacts.used[0] = count
    return min(smallest, _collect_pairs(world, T, margin, contacts))


@inner
def _collect_pairs(world: World, T: Array, margin: float, contacts: Contacts) -> float:
    """Add the robot's own pairs with a gap below `margin`; returns the smallest gap among them."""
    rows, count, smallest = contacts.rows, int(contacts.used[0]), FAR
    for p in range(world.pairs.shape[0]):
        i, j = world.pairs[p, 0], world.pairs[p, 1]
        x, y, z = carried(T, int(world.spheres[i, 5]), world.spheres, i)
        a, b, c = carried(T, int(world.spheres[j, 5]), world.spheres, j)
        u, v, w = x - a, y - b, z - c
        d = math.sqrt(u * u + v * v + w * w)
        gap = d - world.spheres[i, 3] - world.spheres[j, 3]
        smallest = min(smallest, gap)
        if gap < margin and count < MOST_CONTACTS:
            d = max(d, 1e-12)
            rows[count, 0], rows[count, 1], rows[count, 2], rows[count, 3] = gap, u / d, v / d, w / d
            rows[count, 4], rows[count, 5], rows[count, 6], rows[count, 7] = x, y, z, world.spheres[i, 5]
            rows[count, 8], rows[count, 9] = float(i), float(-1 - j)
            rows[count, 10], rows[count, 11], rows[count, 12] = a, b, c
            rows[count, 13] = world.spheres[j, 5]
            count += 1
    contacts.used[0] = count
    return smallest


@inner
def contact_row(frames: Array, T: Array, rows: Array, c: int, out: Array) -> None:
    """Gradient of contact c's gap with respect to the joints, into out (n,)."""
    for k in range(out.shape[0]):
        out[k] = 0.0
    _add_rates(frames, T, rows[c], 4, 1.0, out)
    if rows[c, 13] >= 0.0:
        _add_rates(frames, T, rows[c], 10, -1.0, out)


@inner
def _add_rates(frames: Array, T: Array, row: Array, at: int, share: float, out: Array) -> None:
    """Add `share` times the rates along a contact's gradient of the point in row[at:], with its link after it."""
    u, v, w = share * row[1], share * row[2], share * row[3]
    x, y, z = row[at], row[at + 1], row[at + 2]
    for k in range(int(row[at + 3])):
        zx, zy, zz = T[k + 1, 2], T[k + 1, 5], T[k + 1, 8]
        if frames[k + 1, 12] == 0.0:
            rx, ry, rz = x - T[k + 1, 9], y - T[k + 1, 10], z - T[k + 1, 11]
            out[k] += u * (zy * rz - zz * ry) + v * (zz * rx - zx * rz) + w * (zx * ry - zy * rx)
        else:
            out[k] += u * zx + v * zy + w * zz


@inner
def idle_stretch(world: World, T: Array, twist: Array, spare: float, hint: Array) -> float:
    """Length along a motion over which some sphere surely stays inside an obstacle or another sphere; 0: none is.

    `twist` (n + 1, 6) is each link's velocity field: linear at the world's origin, angular. A sphere that lies `depth`
    inside and moves with speed v stays inside for depth / v, and short of a clearance of `spare` for (depth +
    spare) / v. The pair in hint (2,) is asked first, and replaced by the one with the longest stretch.
    """
    longest = 0.0
    if hint[0] >= 0:
        longest = _stretch(world, T, twist, spare, int(hint[0]), int(hint[1]))
    if longest > 0.1:
        return longest
    for link in range(world.balls.shape[0]):
        first, last = int(world.balls[link, 4]), int(world.balls[link, 5])
        if first == last:
            continue
        bx, by, bz = carried(T, link, world.balls, link)
        for j in range(world.obstacles.shape[0]):
            if _out_of_reach(world, j, bx, by, bz, world.balls[link, 3] + world.required):
                continue
            for i in range(first, last):
                stretch = _stretch(world, T, twist, spare, i, j)
                if stretch > longest:
                    longest = stretch
                    hint[0], hint[1] = float(i), float(j)
                    if longest > 0.1:
                        return longest
    for p in range(world.pairs.shape[0]):
        i, j = world.pairs[p, 0], -1 - world.pairs[p, 1]
        stretch = _stretch(world, T, twist, spare, i, j)
        if stretch > longest:
            longest = stretch
            hint[0], hint[1] = float(i), float(j)
    return longest


@inner
def _stretch(world: World, T: Array, twist: Array, spare: float, i: int, j: int) -> float:
    """The same for sphere i in obstacle j, or in sphere -1 - j."""
    x, y, z = carried(T, int(world.spheres[i, 5]), world.spheres, i)
    vx, vy, vz = _velocity(twist, int(world.spheres[i, 5]), x, y, z)
    if j >= 0:
        gap = signed_distance(world.obstacles, world.faces, j, x, y, z)[0] - world.spheres[i, 3]
    else:
        other = -1 - j
        a, b, c = carried(T, int(world.spheres[other, 5]), world.spheres, other)
        ux, uy, uz = _velocity(twist, int(world.spheres[other, 5]), a, b, c)
        vx, vy, vz = vx - ux, vy - uy, vz - uz
        gap = (
            math.sqrt((x - a) ** 2 + (y - b) ** 2 + (z - c) ** 2)
            - world.spheres[i, 3]
            - world.spheres[other, 3]
        )
    gap -= world.required
    if gap >= -1e-5:
        return 0.0
    stretch: float = (spare - gap) / max(math.sqrt(vx * vx + vy * vy + vz * vz), 1e-6)
    return stretch


@inner
def _velocity(twist: Array, link: int, x: float, y: float, z: float) -> tuple[float, float, float]:
    """Velocity of a point that a link carries."""
    return (
        twist[link, 0] + twist[link, 4] * z - twist[link, 5] * y,
        twist[link, 1] + twist[link, 5] * x - twist[link, 3] * z,
        twist[link, 2] + twist[link, 3] * y - twist[link, 4] * x,
    )
