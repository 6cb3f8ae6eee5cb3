"""Robots as the live kernels know them: a tree of joints, tools and spheres; where that is, and its rates."""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from workcell.jit import lean
from workcell.kernels.chain import Point, Tree, add_rates, carried, forward_tree
from workcell.kernels.coupling import Couple, follow, gather
from workcell.pose import Array

Index = NDArray[np.int64]


class Limbs(NamedTuple):
    """One or several robots as a tree of m joints that n variables move.

    Attributes:
        tree: frames and parents of base and links.
        couple: how joints follow from variables.
        tools: (k, 13) link, rotation (9, row-major) and position (3) in the link's axis frame.
        spheres: (s, 5) centre in the link's axis frame, radius, link; sorted by link.
        rows: (m + 1, 2) first and last row in `spheres` of each link.
        balls: (m + 1, 4) a ball around the spheres of each link: centre in its axis frame, radius, -1 without spheres.
        pairs: (p, 2) rows of spheres that must keep clear of each other, sorted by their links.
        runs: (b, 5) of pairs that one sphere has with one link: its link (the lower one), the other, the sphere, and
            the first and last row of the pairs.
        levers: (m + 1, m + 1, m) metres by which a radian (or metre) of each joint may move points of link b seen from
            link a; row 0: from the world.
        shy: (m + 1, m + 1) metres of clearance between link a and link b > a at which the collision term is a quarter.
        bounds: (2, n) position limits.
        rates: (3, n) limits of velocity, acceleration and jerk.
    """

    tree: Tree
    couple: Couple
    tools: Array
    spheres: Array
    rows: Index
    balls: Array
    pairs: Index
    runs: Index
    levers: Array
    shy: Array
    bounds: Array
    rates: Array


class Place(NamedTuple):
    """Where the limbs are at one configuration.

    Attributes:
        values, slopes: (m,) of the joints.
        T: (m + 1, 12) frames of the links.
        tools: (k, 12) frames of the tools.
        centres: (s, 3) of the spheres; balls: (m + 1, 3) of the links' balls.
        row: (m,) a gradient by joints, on its way to one by variables.
    """

    values: Array
    slopes: Array
    T: Array
    tools: Array
    centres: Array
    balls: Array
    row: Array


@lean
def put(limbs: Limbs, q: Array, place: Place) -> None:
    """Links, tools and spheres at variables q (n,)."""
    follow(limbs.couple, q, place.values, place.slopes)
    forward_tree(limbs.tree, place.values, place.T)
    T = place.T
    for t in range(limbs.tools.shape[0]):
        link = int(limbs.tools[t, 0])
        for r in range(3):
            a, b, c = T[link, 3 * r], T[link, 3 * r + 1], T[link, 3 * r + 2]
            for s in range(3):
                place.tools[t, 3 * r + s] = (
                    a * limbs.tools[t, 1 + s] + b * limbs.tools[t, 4 + s] + c * limbs.tools[t, 7 + s]
                )
            place.tools[t, 9 + r] = (
                T[link, 9 + r] + a * limbs.tools[t, 10] + b * limbs.tools[t, 11] + c * limbs.tools[t, 12]
            )
    for i in range(limbs.spheres.shape[0]):
        x, y, z = carried(T, int(limbs.spheres[i, 4]), limbs.spheres, i)
        place.centres[i, 0], place.centres[i, 1], place.centres[i, 2] = x, y, z
    for link in range(limbs.balls.shape[0]):
        x, y, z = carried(T, link, limbs.balls, link)
        place.balls[link, 0], place.balls[link, 1], place.balls[link, 2] = x, y, z


@lean
def tool_jacobian(limbs: Limbs, place: Place, tool: int, J: Array) -> None:
    """Geometric Jacobian (6, n) of a tool by the variables: linear, then angular, in the world."""
    for r in range(6):
        for k in range(J.shape[1]):
            J[r, k] = 0.0
    T, link = place.T, int(limbs.tools[tool, 0])
    x, y, z = place.tools[tool, 9], place.tools[tool, 10], place.tools[tool, 11]
    while link > 0:
        k, slope = limbs.couple.variable[link - 1], place.slopes[link - 1]
        u, v, w = slope * T[link, 2], slope * T[link, 5], slope * T[link, 8]
        if limbs.tree.frames[link, 12] == 0.0:
            rx, ry, rz = x - T[link, 9], y - T[link, 10], z - T[link, 11]
            J[0, k] += v * rz - w * ry
            J[1, k] += w * rx - u * rz
            J[2, k] += u * ry - v * rx
            J[3, k] += u
            J[4, k] += v
            J[5, k] += w
        else:
            J[0, k] += u
            J[1, k] += v
            J[2, k] += w
        link = limbs.tree.parents[link]


@lean
def point_gradient(
    limbs: Limbs,
    place: Place,
    link: int,
    point: Point,
    direction: Point,
    share: float,
    out: Array,
    fresh: bool,
) -> None:
    """Rates (n,) of a world point that a link carries, along a direction; added to `out` unless it is fresh."""
    for k in range(place.row.shape[0]):
        place.row[k] = 0.0
    add_rates(limbs.tree, place.T, link, point, direction, share, place.row)
    if fresh:
        gather(limbs.couple, place.slopes, place.row, out)
        return
    for k in range(place.row.shape[0]):
        out[limbs.couple.variable[k]] += place.slopes[k] * place.row[k]


@lean
def turn_error(goal: Array, tool: Array, w: Array) -> float:
    """Rotation vector w (3,) from a goal's frame (12,) to a tool's, along the goal's axes; its length.

    Of the two antipodes the nearer one.
    """
    d = (
        goal[2] * tool[1] + goal[5] * tool[4] + goal[8] * tool[7],
        goal[1] * tool[2] + goal[4] * tool[5] + goal[7] * tool[8],
        goal[0] * tool[2] + goal[3] * tool[5] + goal[6] * tool[8],
        goal[2] * tool[0] + goal[5] * tool[3] + goal[8] * tool[6],
        goal[1] * tool[0] + goal[4] * tool[3] + goal[7] * tool[6],
        goal[0] * tool[1] + goal[3] * tool[4] + goal[6] * tool[7],
    )
    xx = goal[0] * tool[0] + goal[3] * tool[3] + goal[6] * tool[6]
    yy = goal[1] * tool[1] + goal[4] * tool[4] + goal[7] * tool[7]
    zz = goal[2] * tool[2] + goal[5] * tool[5] + goal[8] * tool[8]
    x, y, z = 0.5 * (d[0] - d[1]), 0.5 * (d[2] - d[3]), 0.5 * (d[4] - d[5])
    sine, cosine = math.sqrt(x * x + y * y + z * z), 0.5 * (xx + yy + zz - 1.0)
    angle = math.atan2(sine, cosine)
    if sine < 1e-6 and cosine < 0.0:
        # A half turn: the axis comes from the diagonal, any sign serves.
        x, y, z = math.sqrt(max(xx + 1, 0.0)), math.sqrt(max(yy + 1, 0.0)), math.sqrt(max(zz + 1, 0.0))
        if x >= y and x >= z:
            y, z = math.copysign(y, d[4] + d[5]), math.copysign(z, d[2] + d[3])
        elif y >= z:
            x, z = math.copysign(x, d[4] + d[5]), math.copysign(z, d[0] + d[1])
        else:
            x, y = math.copysign(x, d[2] + d[3]), math.copysign(y, d[0] + d[1])
        share = angle / math.sqrt(x * x + y * y + z * z)
    else:
        share = angle / sine if sine > 1e-9 else 1.0
    w[0], w[1], w[2] = share * x, share * y, share * z
    return angle
