"""All pairs that are nearer than a margin, of batches of configurations, with gradients."""

from __future__ import annotations

import numpy as np

from workcell.jit import inner, kernel
from workcell.kernels.chain import Tree, add_rates
from workcell.kernels.shape_kinds import HALFSPACE
from workcell.kernels.shapes import Shapes, box_keys, to_shape
from workcell.kernels.sphere_gaps import Index, add_self_rates, apart, place_spheres
from workcell.pose import Array


@inner
def _near_shapes(shapes: Shapes, x: float, y: float, z: float, reach: float, keys: Array, near: Index) -> int:
    """Shapes that may be nearer than `reach` to a point, by their keys or the balls around them; how many there are.

    They are written to near (k,), in packed order.
    """
    rows, b, count = shapes.rows, shapes.boxes.shape[1], 0
    box_keys(shapes.boxes, x, y, z, keys)
    ceiling = reach * reach if reach > 0.0 else reach
    for j in range(b):
        near[count] = j
        count += keys[j] < ceiling
    for r in range(rows.shape[0]):
        dx, dy, dz, ball = x - rows[r, 1], y - rows[r, 2], z - rows[r, 3], reach + rows[r, 16]
        near[count] = b + r
        count += rows[r, 0] == HALFSPACE or (ball > 0.0 and dx * dx + dy * dy + dz * dz < ball * ball)
    return count


@kernel
def near_contacts(
    tree: Tree, spheres: Array, shapes: Shapes, pairs: Index, q: Array, margin: float, who: Index,
    gap: Array, gradient: Array,
) -> int:  # fmt: skip
    """How many gaps at q (c, n) are below `margin`; as many as there is room for are written, by configuration.

    Of each `who` (., 4): the configuration, the sphere, the shape or -1, the other sphere or -1; `gap` (.,) and its
    gradient (., n).
    """
    room, count = gap.shape[0], 0
    T, centres = np.empty((tree.frames.shape[0], 12)), np.empty((spheres.shape[0], 3))
    keys, near = np.empty(shapes.boxes.shape[1]), np.empty(shapes.order.shape[0] + 1, dtype=np.int64)
    for c in range(q.shape[0]):
        place_spheres(tree, spheres, q[c], T, centres)
        for i in range(spheres.shape[0]):
            x, y, z = centres[i, 0], centres[i, 1], centres[i, 2]
            reach = margin + spheres[i, 3]
            for k in range(_near_shapes(shapes, x, y, z, reach, keys, near)):
                d, u, v, w = to_shape(shapes, near[k], x, y, z)
                if d >= reach:
                    continue
                if count < room:
                    who[count, 0], who[count, 1], who[count, 2], who[count, 3] = (
                        c,
                        i,
                        shapes.order[near[k]],
                        -1,
                    )
                    gap[count] = d - spheres[i, 3]
                    gradient[count, :] = 0.0
                    add_rates(tree, T, int(spheres[i, 4]), (x, y, z), (u, v, w), 1.0, gradient[count])
                count += 1
        for p in range(pairs.shape[0]):
            i, j = pairs[p, 0], pairs[p, 1]
            d, direction = apart(centres, i, j)
            if d >= margin + spheres[i, 3] + spheres[j, 3]:
                continue
            if count < room:
                who[count, 0], who[count, 1], who[count, 2], who[count, 3] = c, i, -1, j
                gap[count] = d - spheres[i, 3] - spheres[j, 3]
                gradient[count, :] = 0.0
                add_self_rates(tree, T, spheres, centres, i, j, direction, gradient[count])
            count += 1
    return count
