"""Distances from convex geoms to height fields, as the triangular prisms that MuJoCo collides: compiled.

Above the grid's cells stands a pyramid of their largest heights, four to one, so that what is far away or too low is
left out in few steps.
"""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from workcell.jit import exact_inner, exact_kernel
from workcell.model.judge.convex import core_distance, support
from workcell.pose import Array

_TOUCH = 1e-9
"""Metres by which solids overlap at least where nothing parts them."""


@exact_kernel
def tallest(heights: Array, levels: NDArray[np.int64], out: Array) -> None:
    """Into `out` the largest heights of all blocks of 2^k x 2^k cells, level by level.

    Args:
        heights: (rows, columns) metres at the grid's points.
        levels: (l, 3) first place in `out`, rows and columns of each level; the first is that of the cells.
    """
    first, rows, columns = levels[0]
    for i in range(rows):
        for j in range(columns):
            low, high = (
                max(heights[i, j], heights[i, j + 1]),
                max(heights[i + 1, j], heights[i + 1, j + 1]),
            )
            out[first + i * columns + j] = max(low, high)
    for k in range(1, levels.shape[0]):
        below, wide, long = levels[k - 1]
        first, rows, columns = levels[k]
        for i in range(rows):
            for j in range(columns):
                most = -math.inf
                for row in range(2 * i, min(2 * i + 2, wide)):
                    for column in range(2 * j, min(2 * j + 2, long)):
                        most = max(most, out[below + row * long + column])
                out[first + i * columns + j] = most


@exact_inner
def _bound(levels: NDArray[np.int64], peaks: Array, grid: Array, box: Array, k: int, i: int, j: int) -> float:
    """A lower bound of the signed distance between a box (6,: lowest, highest) and a block of cells."""
    size = 1 << k
    rows, columns = levels[0, 1], levels[0, 2]
    x0, x1 = grid[0] * (2.0 * j * size / columns - 1.0), grid[0] * (2.0 * (j + 1) * size / columns - 1.0)
    y0, y1 = grid[1] * (2.0 * i * size / rows - 1.0), grid[1] * (2.0 * (i + 1) * size / rows - 1.0)
    top = peaks[levels[k, 0] + i * levels[k, 2] + j]
    u, v = max(x0 - box[3], box[0] - x1, 0.0), max(y0 - box[4], box[1] - y1, 0.0)
    w = max(-grid[2] - box[5], box[2] - top, 0.0)
    beside: float = math.sqrt(u * u + v * v + w * w)
    if beside > 0.0:
        return beside
    # where the box is right above the block, it is in it by how far its lowest point is below the peak
    inside: float = min(box[2] - top, 0.0) - _TOUCH
    return inside


@exact_inner
def _prism(heights: Array, grid: Array, i: int, j: int, half: int, corners: Array) -> None:
    """Into `corners` (6, 3) one of the two prisms of a cell: three corners of the surface, three of the base."""
    rows, columns = heights.shape
    for k in range(3):
        row, column = i, j
        if k == 2:
            row, column = i + 1, j + 1
        elif k == 1:
            row, column = (i, j + 1) if half == 0 else (i + 1, j)
        x, y = grid[0] * (2.0 * column / (columns - 1) - 1.0), grid[1] * (2.0 * row / (rows - 1) - 1.0)
        corners[k, 0], corners[k, 1], corners[k, 2] = x, y, heights[row, column]
        corners[3 + k, 0], corners[3 + k, 1], corners[3 + k, 2] = x, y, -grid[2]


@exact_inner
def _depth(
    kind: int, size: Array, vertices: Array, turned: Array, place: Array, radius: float, corners: Array, half: int,
    near: Array,
) -> float:  # fmt: skip
    """How far a geom must move up out of a prism's surface, or down out of its base, as a distance: negative."""
    ax, ay, az = (
        corners[1, 0] - corners[0, 0],
        corners[1, 1] - corners[0, 1],
        corners[1, 2] - corners[0, 2],
    )
    bx, by, bz = (
        corners[2, 0] - corners[0, 0],
        corners[2, 1] - corners[0, 1],
        corners[2, 2] - corners[0, 2],
    )
    x, y, z = ay * bz - az * by, az * bx - ax * bz, ax * by - ay * bx
    long = math.copysign(math.sqrt(x * x + y * y + z * z), z)
    x, y, z = x / long, y / long, z / long
    a, b, c = support(kind, size, vertices, turned, place, -x, -y, -z)
    above = x * (a - corners[0, 0]) + y * (b - corners[0, 1]) + z * (c - corners[0, 2]) - radius
    near[0, 0], near[0, 1], near[0, 2] = a - radius * x, b - radius * y, c - radius * z
    _, _, high = support(kind, size, vertices, turned, place, 0.0, 0.0, 1.0)
    below = corners[3, 2] - high - radius
    depth = max(above, below)
    near[1, 0], near[1, 1], near[1, 2] = (
        near[0, 0] - above * x,
        near[0, 1] - above * y,
        near[0, 2] - above * z,
    )
    overlap: float = min(depth, -_TOUCH)
    return overlap


@exact_kernel
def field_distance(
    kind: int, size: Array, vertices: Array, turned: Array, place: Array, radius: float,
    heights: Array, grid: Array, levels: NDArray[np.int64], peaks: Array, limit: float, points: Array,
) -> float:  # fmt: skip
    """The smallest signed distance between a convex geom and a height field, at most `limit`; never too large.

    Args:
        kind, size, vertices, turned, place: of the geom's core in the field's frame, see `convex.support`.
        radius: metres around the core.
        heights: (rows, columns) metres; grid: (3,) half sizes in x and y, and the depth of the base.
        levels, peaks: the pyramid that `tallest` makes.
        limit: metres; larger distances are of no interest.
        points: (2, 3) for the nearest points of the geom and of the field, in the field's frame.
    """
    best = limit
    top = levels.shape[0] - 1
    waiting, bounds = np.empty((4 * (top + 1) + 4, 3), dtype=np.int64), np.empty(4 * (top + 1) + 4)
    corners, near, box = np.empty((6, 3)), np.empty((2, 3)), np.empty(6)
    _box_around(kind, size, vertices, turned, place, radius, box)
    waiting[0, 0], waiting[0, 1], waiting[0, 2] = top, 0, 0
    bounds[0] = _bound(levels, peaks, grid, box, top, 0, 0)
    count = 1
    while count > 0:
        count -= 1
        if bounds[count] >= best:
            continue
        k, i, j = waiting[count]
        if k > 0:
            count = _open(levels, peaks, grid, box, k, i, j, waiting, bounds, count, best)
            continue
        for half in range(2):
            _prism(heights, grid, i, j, half, corners)
            near[:] = 0.0
            found = core_distance(kind, size, vertices, turned, place, corners, best + radius, near) - radius
            if found <= 0.0 and found == -math.inf:
                found = _depth(kind, size, vertices, turned, place, radius, corners, half, near)
            elif radius > 0.0 and found < best:
                _to_surface(near, radius)
            if found < best:
                best = found
                points[:] = near
    return best


@exact_inner
def _box_around(
    kind: int, size: Array, vertices: Array, turned: Array, place: Array, radius: float, box: Array
) -> None:
    """Into `box` (6,) the lowest and the highest corner of the box around a geom."""
    for k in range(3):
        x, y, z = 1.0 if k == 0 else 0.0, 1.0 if k == 1 else 0.0, 1.0 if k == 2 else 0.0
        a, b, c = support(kind, size, vertices, turned, place, -x, -y, -z)
        box[k] = a * x + b * y + c * z - radius
        a, b, c = support(kind, size, vertices, turned, place, x, y, z)
        box[3 + k] = a * x + b * y + c * z + radius


@exact_inner
def _to_surface(near: Array, radius: float) -> None:
    """Move the core's nearest point (row 0) by its radius towards the other."""
    x, y, z = near[1, 0] - near[0, 0], near[1, 1] - near[0, 1], near[1, 2] - near[0, 2]
    long = math.sqrt(x * x + y * y + z * z)
    if long > 0.0:
        near[0, 0] += radius * x / long
        near[0, 1] += radius * y / long
        near[0, 2] += radius * z / long


@exact_inner
def _open(
    levels: NDArray[np.int64], peaks: Array, grid: Array, box: Array, k: int, i: int, j: int,
    waiting: NDArray[np.int64], bounds: Array, count: int, best: float,
) -> int:  # fmt: skip
    """Put the blocks inside a block on the heap of what waits, the nearest last; how many wait then."""
    first = count
    for row in range(2 * i, min(2 * i + 2, levels[k - 1, 1])):
        for column in range(2 * j, min(2 * j + 2, levels[k - 1, 2])):
            bound = _bound(levels, peaks, grid, box, k - 1, row, column)
            if bound >= best:
                continue
            at = count
            while at > first and bounds[at - 1] < bound:
                bounds[at] = bounds[at - 1]
                waiting[at] = waiting[at - 1]
                at -= 1
            bounds[at] = bound
            waiting[at, 0], waiting[at, 1], waiting[at, 2] = k - 1, row, column
            count += 1
    return count
