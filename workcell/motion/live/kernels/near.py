"""What is near the limbs: pairs below a margin with gradients, and the smallest gap of every link."""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from workcell.jit import inlined, lean
from workcell.kernels.chain import Point
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
        close: (k,) scratch: shapes near a link.
    """

    gap: Array
    rate: Array
    who: NDArray[np.int64]
    gradient: Array
    used: NDArray[np.int64]
    close: NDArray[np.int64]


@lean
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


@inlined
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


@inlined
def _beyond(rows: Array, o: int, x: float, y: float, z: float, reach: float) -> bool:
    """Whether a shape is surely farther than `reach` from a point, by the ball around it."""
    if rows[o, 0] == HALFSPACE:
        return False
    dx, dy, dz, ball = x - rows[o, 1], y - rows[o, 2], z - rows[o, 3], reach + rows[o, 16]
    return bool(ball <= 0.0 or dx * dx + dy * dy + dz * dz >= ball * ball)


@inlined
def _beyond_box(boxes: Array, j: int, x: float, y: float, z: float, reach: float) -> bool:
    return bool(
        abs(x - boxes[0, j]) - boxes[3, j] > reach
        or abs(y - boxes[1, j]) - boxes[4, j] > reach
        or abs(z - boxes[2, j]) - boxes[5, j] > reach
    )


@lean
def _close_shapes(
    limbs: Limbs, shapes: Shapes, place: Place, link: int, reach: float, close: NDArray[np.int64]
) -> int:  # fmt: skip
    """Which shapes may be within reach of a link's ball, into `close`; how many."""
    count, boxes = 0, shapes.boxes.shape[1]
    x, y, z = place.balls[link, 0], place.balls[link, 1], place.balls[link, 2]
    reach += limbs.balls[link, 3]
    for j in range(close.shape[0]):
        if j < boxes:
            if _beyond_box(shapes.boxes, j, x, y, z, reach):
                continue
        elif _beyond(shapes.rows, j - boxes, x, y, z, reach):
            continue
        close[count] = j
        count += 1
    return count


@inlined
def _apart(centres: Array, spheres: Array, i: int, at: Array, balls: Array, link: int, reach: float) -> bool:
    """Whether a sphere is surely farther than `reach` from the spheres of a link, by the ball around them."""
    x, y, z = centres[i, 0] - at[link, 0], centres[i, 1] - at[link, 1], centres[i, 2] - at[link, 2]
    reach += spheres[i, 3] + balls[link, 3]
    return bool(reach <= 0.0 or x * x + y * y + z * z >= reach * reach)


@lean
def find_near(
    limbs: Limbs, shapes: Shapes, movers: Movers, skipped: NDArray[np.bool_], place: Place, margin: float,
    margin_moving: float, near: Near,
) -> float:  # fmt: skip
    """Pairs below `margin` metres, of movers (as in `then`) below `margin_moving`; the smallest gap, `FAR` if none.

    `skipped` (s, k) are spheres and shapes that don't count: what overlapped as the robot began.
    """
    near.used[0] = 0
    smallest, centres, spheres = FAR, place.centres, limbs.spheres
    smallest = min(smallest, _find_standing(limbs, shapes, skipped, place, margin, near))
    for i in range(limbs.rows[0, 1], spheres.shape[0] if movers.then.shape[0] > 0 else 0):
        x, y, z, radius = centres[i, 0], centres[i, 1], centres[i, 2], spheres[i, 3]
        for o in range(movers.then.shape[0]):
            if _beyond(movers.then, o, x, y, z, margin_moving + radius):
                continue
            d, u, v, w = signed_distance(movers.then, movers.faces, o, x, y, z)
            gap = d - radius
            if gap < margin_moving:
                smallest = min(smallest, gap)
                rate = _closing(movers.moves, o, x - d * u, y - d * v, z - d * w, u, v, w)
                _keep(limbs, place, near, (i, 1, o), gap, rate, (u, v, w))
    return min(smallest, _find_own(limbs, place, margin, near))


@lean
def _find_standing(
    limbs: Limbs, shapes: Shapes, skipped: NDArray[np.bool_], place: Place, margin: float, near: Near
) -> float:  # fmt: skip
    """Add what stands and is nearer than the margin; the smallest gap."""
    smallest, boxes, rows, packed = FAR, shapes.boxes.shape[1], limbs.rows, shapes.boxes
    centres, spheres, close, others = place.centres, limbs.spheres, near.close, shapes.rows
    for link in range(1, rows.shape[0]):
        count = _close_shapes(limbs, shapes, place, link, margin, close)
        for c in range(count):
            j = close[c]
            for i in range(rows[link, 0], rows[link, 1]):
                x, y, z, radius = centres[i, 0], centres[i, 1], centres[i, 2], spheres[i, 3]
                if skipped[i, j] or (j < boxes and _beyond_box(packed, j, x, y, z, margin + radius)):
                    continue
                if j >= boxes and _beyond(others, j - boxes, x, y, z, margin + radius):
                    continue
                d, u, v, w = to_shape(shapes, j, x, y, z)
                if d - radius < margin:
                    smallest = min(smallest, d - radius)
                    _keep(limbs, place, near, (i, 0, j), d - radius, 0.0, (u, v, w))
    return smallest


@lean
def _keep(
    limbs: Limbs, place: Place, near: Near, who: tuple[int, int, int], gap: float, rate: float, direction: Point
) -> None:  # fmt: skip
    """Write a pair down, if it is among the nearest, with the gradient of its sphere's way along a direction."""
    at = _slot(near, gap)
    if at < 0:
        return
    i = who[0]
    near.gap[at], near.rate[at] = gap, rate
    near.who[at, 0], near.who[at, 1], near.who[at, 2] = i, who[1], who[2]
    point = (place.centres[i, 0], place.centres[i, 1], place.centres[i, 2])
    point_gradient(limbs, place, int(limbs.spheres[i, 4]), point, direction, 1.0, near.gradient[at], True)
    if who[1] == 2:
        j = who[2]
        point = (place.centres[j, 0], place.centres[j, 1], place.centres[j, 2])
        point_gradient(
            limbs, place, int(limbs.spheres[j, 4]), point, direction, -1.0, near.gradient[at], False
        )


@inlined
def _closing(moves: Array, o: int, x: float, y: float, z: float, u: float, v: float, w: float) -> float:
    """Metres a second at which a mover's point comes along a direction."""
    m = moves[o]
    rx, ry, rz = x - m[6], y - m[7], z - m[8]
    vx, vy, vz = m[0] + m[4] * rz - m[5] * ry, m[1] + m[5] * rx - m[3] * rz, m[2] + m[3] * ry - m[4] * rx
    closing: float = vx * u + vy * v + vz * w
    return closing


@lean
def _find_own(limbs: Limbs, place: Place, margin: float, near: Near) -> float:
    """Add the robots' own pairs below the margin; the smallest gap among them."""
    smallest, centres, spheres, runs, pairs = FAR, place.centres, limbs.spheres, limbs.runs, limbs.pairs
    for run in range(runs.shape[0]):
        i = runs[run, 2]
        if _apart(centres, spheres, i, place.balls, limbs.balls, runs[run, 1], margin):
            continue
        x, y, z, radius = centres[i, 0], centres[i, 1], centres[i, 2], spheres[i, 3]
        for p in range(runs[run, 3], runs[run, 4]):
            j = pairs[p, 1]
            u, v, w = x - centres[j, 0], y - centres[j, 1], z - centres[j, 2]
            square, radii = u * u + v * v + w * w, radius + spheres[j, 3]
            reach = margin + radii
            if square >= reach * reach:
                continue
            d = math.sqrt(square)
            smallest = min(smallest, d - radii)
            direction = (u / d, v / d, w / d) if d > 1e-12 else (0.0, 0.0, 1.0)
            _keep(limbs, place, near, (i, 2, j), d - radii, 0.0, direction)
    return smallest


@lean
def link_gaps(
    limbs: Limbs, shapes: Shapes, movers: Movers, skipped: NDArray[np.bool_], place: Place, ceiling: float,
    gaps: Array, close: NDArray[np.int64],
) -> float:  # fmt: skip
    """Smallest gaps up to `ceiling`, into gaps (m + 2, m + 1); the smallest of all.

    Row 0 is of links to shapes, row a + 1 of link a to link b, and on its diagonal of link a to movers.
    """
    links = limbs.rows.shape[0]
    for b in range(links):
        gaps[0, b] = ceiling
        for a in range(links):
            gaps[a + 1, b] = ceiling if a == b else FAR
    smallest = _gaps_to_standing(limbs, shapes, skipped, place, ceiling, gaps, close)
    if movers.then.shape[0] > 0:
        smallest = min(smallest, _gaps_to_moving(limbs, movers, place, ceiling, gaps))
    return min(smallest, _own_gaps(limbs, place, ceiling, gaps))


@lean
def _gaps_to_standing(
    limbs: Limbs, shapes: Shapes, skipped: NDArray[np.bool_], place: Place, ceiling: float, gaps: Array,
    close: NDArray[np.int64],
) -> float:  # fmt: skip
    """The part of `link_gaps` about what stands."""
    smallest, boxes, rows, packed = ceiling, shapes.boxes.shape[1], limbs.rows, shapes.boxes
    centres, spheres, others = place.centres, limbs.spheres, shapes.rows
    for link in range(1, rows.shape[0]):
        best = ceiling
        for c in range(_close_shapes(limbs, shapes, place, link, ceiling, close)):
            j = close[c]
            for i in range(rows[link, 0], rows[link, 1]):
                x, y, z, radius = centres[i, 0], centres[i, 1], centres[i, 2], spheres[i, 3]
                if skipped[i, j] or (j < boxes and _beyond_box(packed, j, x, y, z, best + radius)):
                    continue
                if j >= boxes and _beyond(others, j - boxes, x, y, z, best + radius):
                    continue
                best = min(best, to_shape(shapes, j, x, y, z)[0] - radius)
        gaps[0, link] = best
        smallest = min(smallest, best)
    return smallest


@lean
def _gaps_to_moving(limbs: Limbs, movers: Movers, place: Place, ceiling: float, gaps: Array) -> float:
    """The part of `link_gaps` about what moves."""
    smallest, rows, centres, spheres = ceiling, limbs.rows, place.centres, limbs.spheres
    for link in range(1, rows.shape[0]):
        best = ceiling
        for i in range(rows[link, 0], rows[link, 1]):
            x, y, z, radius = centres[i, 0], centres[i, 1], centres[i, 2], spheres[i, 3]
            for o in range(movers.then.shape[0]):
                if not _beyond(movers.then, o, x, y, z, best + radius):
                    best = min(best, signed_distance(movers.then, movers.faces, o, x, y, z)[0] - radius)
        gaps[link + 1, link] = best
        smallest = min(smallest, best)
    return smallest


@lean
def _own_gaps(limbs: Limbs, place: Place, ceiling: float, gaps: Array) -> float:
    """The part of `link_gaps` about the robots' own pairs."""
    smallest, centres, spheres, runs, pairs = ceiling, place.centres, limbs.spheres, limbs.runs, limbs.pairs
    for run in range(runs.shape[0]):
        a, b, i = runs[run, 0], runs[run, 1], runs[run, 2]
        best = min(gaps[a + 1, b], ceiling)
        if not _apart(centres, spheres, i, place.balls, limbs.balls, b, best):
            x, y, z, radius = centres[i, 0], centres[i, 1], centres[i, 2], spheres[i, 3]
            for p in range(runs[run, 3], runs[run, 4]):
                j = pairs[p, 1]
                u, v, w = x - centres[j, 0], y - centres[j, 1], z - centres[j, 2]
                square, radii = u * u + v * v + w * w, radius + spheres[j, 3]
                reach = max(best + radii, 0.0)
                if square < reach * reach:
                    best = math.sqrt(square) - radii
        gaps[a + 1, b] = best
        smallest = min(smallest, best)
    return smallest
