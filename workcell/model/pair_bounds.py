"""Which pairs of geoms may be the nearest, by bounding spheres and boxes: compiled.

See `workcell.model.judge.nearest`.
"""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from workcell.jit import inner, kernel
from workcell.pose import Array


@inner
def _to_box(centre: Array, turned: Array, boxes: Array, point: int, geom: int) -> float:
    """Metres from the middle of one geom to the bounding box of another."""
    x, y, z = (
        centre[point, 0] - centre[geom, 0],
        centre[point, 1] - centre[geom, 1],
        centre[point, 2] - centre[geom, 2],
    )
    square = 0.0
    for k in range(3):
        along = turned[geom, k] * x + turned[geom, 3 + k] * y + turned[geom, 6 + k] * z
        over = abs(along - boxes[geom, k]) - boxes[geom, 3 + k]
        if over > 0.0:
            square += over * over
    distance: float = math.sqrt(square)
    return distance


@kernel
def lower_bounds(
    centre: Array, turned: Array, pad: Array, boxes: Array, pairs: NDArray[np.int64], motion: Array, limit: float,
    rows: NDArray[np.int64], bounds: Array
) -> int:  # fmt: skip
    """Rows of the pairs (p, 2) that may have the smallest distance less motion, and lower bounds of it; how many.

    Args:
        centre, turned: (g, 3) and (g, 9) world positions and rotations of all geoms.
        pad: (g,) radii of their bounding spheres; boxes: (g, 6) middles and half sizes of their bounding boxes.
        motion: (p,) metres to subtract from the distance of each pair.
        limit: metres; larger values are of no interest.
        rows, bounds: (p,) for the result.
    """
    least = limit
    for p in range(pairs.shape[0]):
        a, b = pairs[p, 0], pairs[p, 1]
        x, y, z = centre[a, 0] - centre[b, 0], centre[a, 1] - centre[b, 1], centre[a, 2] - centre[b, 2]
        # the distance of two middles, which lie inside their convex geoms, is an upper bound
        bounds[p] = math.sqrt(x * x + y * y + z * z) - motion[p]
        least = min(least, bounds[p])
    count = 0
    for p in range(pairs.shape[0]):
        a, b = pairs[p, 0], pairs[p, 1]
        spheres = bounds[p] - (pad[a] + pad[b])
        if spheres < least:
            beside = max(
                _to_box(centre, turned, boxes, a, b) - pad[a], _to_box(centre, turned, boxes, b, a) - pad[b]
            )
            rows[count] = p
            bounds[count] = max(spheres, beside - motion[p]) if beside > 0.0 else spheres
            count += 1
    return count
