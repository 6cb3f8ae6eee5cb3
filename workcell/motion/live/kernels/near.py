"""What is near the limbs: pairs below a margin with gradients, and the smallest gap of every link."""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from workcell.jit import inner
from workcell.kernels.distance import signed_distance
from workcell.kernels.shape_kinds import HALFSPACE
from workcell.kernels.shapes import Shapes, to_shape
from workcell.motion.live.kernels.limbs import Limbs, Place, point_gradient
from workcell.pose import Array

MOST_NEAR = 32
"""Pairs that are kept, the nearest ones."""
FAR = 1e9
APART = 1e8
"""Gaps beyond it belong to links of which no pair is looked at, or none below the ceiling."""


class Movers(NamedTuple):
    """Obstacles that move, as they are now and as fast as they are said to move.

    Attributes:
        rows: (o, 19) as in `Shapes`.
        faces: (f, 13) triangles of hulls.
        moves: (o, 9) velocity, angular velocity, and the point in the world that they are about.
        then: (o, 19) room for the rows at another time.
    """

    rows: Array
    faces: Array
    moves: Array
    then: Array


class Near(NamedTuple):
    """Pairs nearer than a margin.

    Attributes:
        gap: (MOST_NEAR,) metres.
        rate: (MOST_NEAR,) metres a second at which the obstacle's own motion closes the gap, negative: opens it.
        who: (MOST_NEAR, 3) sphere, what it is near (0 a shape, 1 a mover, 2 a sphere), and which.
        gradient: (MOST_NEAR, n).
        used: (1,) rows in use.
    """

    gap: Array
    rate: Array
    who: NDArray[np.int64]
    gradient: Array
    used: NDArray[np.int64]


@inner
def move_obstacles(movers: Movers, t: float) -> None:
    """The movers' rows t seconds from now, into `then`: about their points, turned by the whole angle."""
    for o in range(movers.rows.shape[0]):
        for c in range(19):
            movers.then[o, c] = movers.rows[o, c]
        m = movers.moves[o]
        for r in range(3):
            movers.then[o, 1 + r] += t * m[r]
        speed = math.sqrt(m[3] * m[3] + m[4] * m[4] + m[5] * m[5])
        if speed * abs(t) < 1e-12:
            continue
        x, y, z = m[3] / speed, m[4] / speed, m[5] / speed
        cosine, s = math.cos(speed * t), math.sin(speed * t)
        e = 1.0 - cosine
        R = (
            cosine + e * x * x, e * x * y - s * z, e * x * z + s * y,
            e * y * x + s * z, cosine + e * y * y, e * y * z - s * x,
            e * z * x - s * y, e * z * y + s * x, cosine + e * z * z,
        )  # fmt: skip
        rows = movers.rows
        ax, ay, az = rows[o, 1] - m[6], rows[o, 2] - m[7], rows[o, 3] - m[8]
        for r in range(3):
            turned = R[3 * r] * ax + R[3 * r + 1] * ay + R[3 * r + 2] * az
            movers.then[o, 1 + r] = m[6 + r] + t * m[r] + turned
            for k in range(3):
                movers.then[o, 4 + 3 * r + k] = (
                    R[3 * r] * rows[o, 4 + k] + R[3 * r + 1] * rows[o, 7 + k] + R[3 * r + 2] * rows[o, 10 + k]
                )


@inner
def _slot(near: Near, gap: float) -> int:
    """Where a pair with this gap goes; -1 where all that are kept are nearer."""
    count = near.used[0]
    if count < near.gap.shape[0]:
        near.used[0] = count + 1
        return int(count)
    worst = 0
    for c in range(1, count):
        if near.gap[c] > near.gap[worst]:
            worst = c
    return worst if gap < near.gap[worst] else -1


@inner
def _beyond(rows: Array, o: int, x: float, y: float, z: float, reach: float) -> bool:
    """Whether a shape is surely farther than `reach` from a point, by the ball around it."""
    if rows[o, 0] == HALFSPACE:
        return False
    dx, dy, dz, ball = x - rows[o, 1], y - rows[o, 2], z - rows[o, 3], reach + rows[o, 16]
    return bool(ball <= 0.0 or dx * dx + dy * dy + dz * dz >= ball * ball)


@inner
def _beyond_box(shapes: Shapes, j: int, x: float, y: float, z: float, reach: float) -> bool:
    boxes = shapes.boxes
    return bool(
        abs(x - boxes[0, j]) - boxes[3, j] > reach
        or abs(y - boxes[1, j]) - boxes[4, j] > reach
        or abs(z - boxes[2, j]) - boxes[5, j] > reach
    )


@inner
def find_near(
    limbs: Limbs, shapes: Shapes, movers: Movers, skipped: NDArray[np.bool_], place: Place, margin: float,
    margin_moving: float, near: Near,
) -> float:  # fmt: skip
    """Pairs below `margin` metres, of movers (as in `then`) below `margin_moving`; the smallest gap, `FAR` if none.

    `skipped` (s, k) are spheres and shapes that don't count: what overlapped as the robot began.
    """
    near.used[0] = 0
    smallest, boxes = FAR, shapes.boxes.shape[1]
    centres, spheres = place.centres, limbs.spheres
    for i in range(limbs.rows[0, 1], spheres.shape[0]):
        x, y, z, radius = centres[i, 0], centres[i, 1], centres[i, 2], spheres[i, 3]
        reach = margin + radius
        for j in range(skipped.shape[1]):
            if skipped[i, j]:
                continue
            if j < boxes:
                if _beyond_box(shapes, j, x, y, z, reach):
                    continue
            elif _beyond(shapes.rows, j - boxes, x, y, z, reach):
                continue
            d, u, v, w = to_shape(shapes, j, x, y, z)
            gap = d - radius
            if gap < margin:
                smallest = min(smallest, gap)
                at = _slot(near, gap)
                if at >= 0:
                    near.gap[at], near.rate[at] = gap, 0.0
                    near.who[at, 0], near.who[at, 1], near.who[at, 2] = i, 0, j
                    point_gradient(
                        limbs, place, int(spheres[i, 4]), (x, y, z), (u, v, w), 1.0, near.gradient[at], True
                    )
    for i in range(limbs.rows[0, 1], spheres.shape[0]):
        x, y, z, radius = centres[i, 0], centres[i, 1], centres[i, 2], spheres[i, 3]
        for o in range(movers.then.shape[0]):
            if _beyond(movers.then, o, x, y, z, margin_moving + radius):
                continue
            d, u, v, w = signed_distance(movers.then, movers.faces, o, x, y, z)
            gap = d - radius
            if gap < margin_moving:
                smallest = min(smallest, gap)
                at = _slot(near, gap)
                if at >= 0:
                    near.gap[at] = gap
                    near.rate[at] = _closing(movers, o, x - d * u, y - d * v, z - d * w, u, v, w)
                    near.who[at, 0], near.who[at, 1], near.who[at, 2] = i, 1, o
                    point_gradient(
                        limbs, place, int(spheres[i, 4]), (x, y, z), (u, v, w), 1.0, near.gradient[at], True
                    )
    return min(smallest, _find_own(limbs, place, margin, near))


@inner
def _closing(
    movers: Movers, o: int, x: float, y: float, z: float, u: float, v: float, w: float
) -> float:  # fmt: skip
    """Metres a second at which a mover's point comes along a direction."""
    m = movers.moves[o]
    rx, ry, rz = x - m[6], y - m[7], z - m[8]
    vx, vy, vz = m[0] + m[4] * rz - m[5] * ry, m[1] + m[5] * rx - m[3] * rz, m[2] + m[3] * ry - m[4] * rx
    closing: float = vx * u + vy * v + vz * w
    return closing


@inner
def _find_own(limbs: Limbs, place: Place, margin: float, near: Near) -> float:
    """Add the robots' own pairs below the margin; the smallest gap among them."""
    smallest, centres, spheres = FAR, place.centres, limbs.spheres
    for p in range(limbs.pairs.shape[0]):
        i, j = limbs.pairs[p, 0], limbs.pairs[p, 1]
        x, y, z = centres[i, 0] - centres[j, 0], centres[i, 1] - centres[j, 1], centres[i, 2] - centres[j, 2]
        square, radii = x * x + y * y + z * z, spheres[i, 3] + spheres[j, 3]
        reach = margin + radii
        if square >= reach * reach:
            continue
        d = math.sqrt(square)
        gap = d - radii
        smallest = min(smallest, gap)
        at = _slot(near, gap)
        if at < 0:
            continue
        if d < 1e-12:
            x, y, z, d = 0.0, 0.0, 1.0, 1.0
        near.gap[at], near.rate[at] = gap, 0.0
        near.who[at, 0], near.who[at, 1], near.who[at, 2] = i, 2, j
        direction = (x / d, y / d, z / d)
        one, other = (
            (centres[i, 0], centres[i, 1], centres[i, 2]),
            (centres[j, 0], centres[j, 1], centres[j, 2]),
        )
        point_gradient(limbs, place, int(spheres[i, 4]), one, direction, 1.0, near.gradient[at], True)
        point_gradient(limbs, place, int(spheres[j, 4]), other, direction, -1.0, near.gradient[at], False)
    return smallest


@inner
def link_gaps(
    limbs: Limbs, shapes: Shapes, movers: Movers, skipped: NDArray[np.bool_], place: Place, ceiling: float, gaps: Array
) -> float:  # fmt: skip
    """Smallest gaps up to `ceiling`, into gaps (m + 2, m + 1): row 0 of links to shapes, row a + 1 of link a to link b,
    and on its diagonal of link a to movers. Returns the smallest of all.
    """
    links = limbs.rows.shape[0]
    for b in range(links):
        gaps[0, b] = ceiling
        for a in range(links):
            gaps[a + 1, b] = ceiling if a == b else FAR
    smallest, boxes = ceiling, shapes.boxes.shape[1]
    centres, spheres = place.centres, limbs.spheres
    for i in range(limbs.rows[0, 1], spheres.shape[0]):
        link, radius = int(spheres[i, 4]), spheres[i, 3]
        x, y, z = centres[i, 0], centres[i, 1], centres[i, 2]
        best = gaps[0, link]
        for j in range(skipped.shape[1]):
            if skipped[i, j]:
                continue
            if j < boxes:
                if _beyond_box(shapes, j, x, y, z, best + radius):
                    continue
            elif _beyond(shapes.rows, j - boxes, x, y, z, best + radius):
                continue
            best = min(best, to_shape(shapes, j, x, y, z)[0] - radius)
        gaps[0, link] = best
        smallest = min(smallest, best)
        best = gaps[link + 1, link]
        for o in range(movers.then.shape[0]):
            if not _beyond(movers.then, o, x, y, z, best + radius):
                best = min(best, signed_distance(movers.then, movers.faces, o, x, y, z)[0] - radius)
        gaps[link + 1, link] = best
        smallest = min(smallest, best)
    for p in range(limbs.pairs.shape[0]):
        i, j = limbs.pairs[p, 0], limbs.pairs[p, 1]
        a, b = int(spheres[i, 4]), int(spheres[j, 4])
        if a > b:
            a, b = b, a
        x, y, z = centres[i, 0] - centres[j, 0], centres[i, 1] - centres[j, 1], centres[i, 2] - centres[j, 2]
        square, radii = x * x + y * y + z * z, spheres[i, 3] + spheres[j, 3]
        reach = max(min(gaps[a + 1, b], ceiling) + radii, 0.0)
        if square < reach * reach:
            gaps[a + 1, b] = math.sqrt(square) - radii
            smallest = min(smallest, gaps[a + 1, b])
    return smallest
