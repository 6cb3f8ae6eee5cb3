"""Forward kinematics of serial chains and of trees.

A frame is a row of 12 numbers: rotation (row-major), then position, in the world.
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from workcell.jit import inner, kernel
from workcell.pose import Array


class Arm(NamedTuple):
    """A serial chain for the kernels, every joint axis turned into its frame's z.

    Attributes:
        frames: (n + 2, 13) base, joints and tool: rotation (9, row-major) and position (3) in the frame before, then 1
            for a prismatic joint.
        bounds: (3, n) lower and upper limits, and 1 where whole turns fit in between.
    """

    frames: Array
    bounds: Array


class Tree(NamedTuple):
    """A kinematic tree for the kernels, every joint axis turned into its frame's z.

    Attributes:
        frames: (n + 1, 13) base and joints, as in `Arm`.
        parents: (n + 1,) link that carries each link's joint; -1 for the base.
    """

    frames: Array
    parents: NDArray[np.int64]


@inner
def forward(frames: Array, q: Array, T: Array) -> None:
    """World frames T (n + 2, 12) of base, links and tool at q (n,)."""
    n = q.shape[0]
    for a in range(12):
        T[0, a] = frames[0, a]
    for i in range(1, n + 1):
        _place(frames, T, i, i - 1, q[i - 1])
    _place(frames, T, n + 1, n, 0.0)


@inner
def forward_tree(tree: Tree, q: Array, T: Array) -> None:
    """World frames T (n + 1, 12) of base and links at q (n,)."""
    for a in range(12):
        T[0, a] = tree.frames[0, a]
    for i in range(1, T.shape[0]):
        _place(tree.frames, T, i, tree.parents[i], q[i - 1])


@inner
def _place(frames: Array, T: Array, i: int, parent: int, value: float) -> None:
    """World frame i from its parent's, with its joint at `value`."""
    c, s, slide = 1.0, 0.0, 0.0
    if frames[i, 12] == 0.0:
        c, s = math.cos(value), math.sin(value)
    else:
        slide = value
    for r in range(3):
        a, b, d = T[parent, 3 * r], T[parent, 3 * r + 1], T[parent, 3 * r + 2]
        x = a * frames[i, 0] + b * frames[i, 3] + d * frames[i, 6]
        y = a * frames[i, 1] + b * frames[i, 4] + d * frames[i, 7]
        z = a * frames[i, 2] + b * frames[i, 5] + d * frames[i, 8]
        T[i, 3 * r] = c * x + s * y
        T[i, 3 * r + 1] = c * y - s * x
        T[i, 3 * r + 2] = z
        T[i, 9 + r] = T[parent, 9 + r] + a * frames[i, 9] + b * frames[i, 10] + d * frames[i, 11] + slide * z


Point = tuple[float, float, float]


@inner
def carried(T: Array, link: int, row: Array, k: int) -> Point:
    """World position of the point in row k (its first three numbers) of an array, carried by a link."""
    x, y, z = row[k, 0], row[k, 1], row[k, 2]
    return (
        T[link, 9] + T[link, 0] * x + T[link, 1] * y + T[link, 2] * z,
        T[link, 10] + T[link, 3] * x + T[link, 4] * y + T[link, 5] * z,
        T[link, 11] + T[link, 6] * x + T[link, 7] * y + T[link, 8] * z,
    )


@inner
def add_rates(
    tree: Tree, T: Array, link: int, point: Point, direction: Point, share: float, out: Array
) -> None:
    """Add to out (n,) `share` times the rates, along `direction`, of a world point that a link carries."""
    x, y, z = point
    u, v, w = direction
    while link > 0:
        zx, zy, zz = T[link, 2], T[link, 5], T[link, 8]
        if tree.frames[link, 12] == 0.0:
            rx, ry, rz = x - T[link, 9], y - T[link, 10], z - T[link, 11]
            rate = u * (zy * rz - zz * ry) + v * (zz * rx - zx * rz) + w * (zx * ry - zy * rx)
        else:
            rate = u * zx + v * zy + w * zz
        out[link - 1] += share * rate
        link = tree.parents[link]


@kernel
def tool_motions(arm: Arm, q: Array, tool: Array, J: Array) -> None:
    """Tool frames (b, 12) at q (b, n), and geometric Jacobians (b, 6, n) there: linear, then angular, in the world."""
    n = q.shape[1]
    T = np.empty((n + 2, 12))
    for c in range(q.shape[0]):
        forward(arm.frames, q[c], T)
        for a in range(12):
            tool[c, a] = T[n + 1, a]
        for k in range(n):
            zx, zy, zz = T[k + 1, 2], T[k + 1, 5], T[k + 1, 8]
            if arm.frames[k + 1, 12] == 0.0:
                rx, ry, rz = tool[c, 9] - T[k + 1, 9], tool[c, 10] - T[k + 1, 10], tool[c, 11] - T[k + 1, 11]
                J[c, 0, k], J[c, 1, k], J[c, 2, k] = zy * rz - zz * ry, zz * rx - zx * rz, zx * ry - zy * rx
                J[c, 3, k], J[c, 4, k], J[c, 5, k] = zx, zy, zz
            else:
                J[c, 0, k], J[c, 1, k], J[c, 2, k] = zx, zy, zz
                J[c, 3, k], J[c, 4, k], J[c, 5, k] = 0.0, 0.0, 0.0
