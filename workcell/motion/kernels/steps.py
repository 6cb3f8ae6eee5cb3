"""How far a motion may go on from one configuration, forwards and backwards, before anything could touch.

The signed distance to a convex obstacle is convex, so that a centre that moves from x to x + dx has a distance of at
least d + g.dx, with g the gradient at x: along a motion with velocity v at x and accelerations up to A,

    d(s) >= d + s g.v - A s^2 / 2        for s of either sign.

The same holds for the distance of two spheres, in the frame of the link that carries one of them, and for the cosine
between the tool's axis and a direction.
"""

from __future__ import annotations

import math
from typing import NamedTuple

from workcell.jit import inner
from workcell.kernels.chain import carried
from workcell.kernels.distance import hull_height, signed_distance
from workcell.kernels.shape_kinds import BOX, HALFSPACE, HULL
from workcell.motion.kernels.body import Body, span
from workcell.pose import Array

SAFETY = 1e-9
"""Metres of every distance that are left to rounding."""
CONE = -2
"""In place of an obstacle or sphere: the tool's axis leaves its cone."""


class Steps(NamedTuple):
    """Parameters by which a motion may go on, and what stands in the way first.

    Attributes:
        forward, backward: proved safe, up to what was asked for; negative: it is not even safe here.
        level: lower bound on the clearance over that stretch, or the level that was given, where that is less.
        gap: smallest clearance at the configuration that was met (1e3 where none is near).
        first, second: rows of the nearest pair: a sphere and an obstacle, or a sphere and, as `-(row + 3)`, another
            sphere; -1 for none.
    """

    forward: float
    backward: float
    level: float
    gap: float
    first: int
    second: int


@inner
def _velocity(W: Array, a: int, b: int, x: float, y: float, z: float) -> tuple[float, float, float]:
    """Velocity relative to link a of the world point (x, y, z) that link b carries."""
    wx, wy, wz = W[b, 3] - W[a, 3], W[b, 4] - W[a, 4], W[b, 5] - W[a, 5]
    return (
        W[b, 0] - W[a, 0] + wy * z - wz * y,
        W[b, 1] - W[a, 1] + wz * x - wx * z,
        W[b, 2] - W[a, 2] + wx * y - wy * x,
    )


@inner
def _ball_speed(W: Array, a: int, b: int, x: float, y: float, z: float, radius: float) -> float:
    """How fast, at most, any centre within `radius` of the point that link b carries moves relative to link a."""
    u, v, w = _velocity(W, a, b, x, y, z)
    wx, wy, wz = W[b, 3] - W[a, 3], W[b, 4] - W[a, 4], W[b, 5] - W[a, 5]
    return math.sqrt(u * u + v * v + w * w) + radius * math.sqrt(wx * wx + wy * wy + wz * wz)


@inner
def safe_steps(
    body: Body, T: Array, W: Array, A: Array, twisting: float, half: float, keep: float, level: float
) -> Steps:
    """Steps of at most `half` in either direction that every pair and the cone allow.

    The links at the tip come first: they restrict most, and what can't be met within the steps that are left
    need not be looked at.

    Args:
        T, W, A, twisting: frames, velocities and bounds on accelerations (`body.accelerations`).
        keep: share of the clearance above the floor that the steps leave untouched: more steps, a better `level`.
        level: pairs that stay farther apart than this need not be looked at.
    """
    forward, backward, gap, first, second = half, half, 1e3, -1, -1
    floor, rows = body.floor + SAFETY, body.obstacles
    if body.cone[6] > -2.0:
        spare, slope = _cone(body, T, W)
        if spare < 0.0:
            return Steps(-1.0, -1.0, level, spare, -1, CONE)
        forward, backward = (
            min(forward, span(spare, slope, twisting)),
            min(backward, span(spare, -slope, twisting)),
        )
    for link in range(body.balls.shape[0] - 1, -1, -1):
        begin, end = int(body.balls[link, 4]), int(body.balls[link, 5])
        if begin == end:
            continue
        bx, by, bz = carried(T, link, body.balls, link)
        radius, bend = body.balls[link, 3], A[0, link]
        speed = _ball_speed(W, 0, link, bx, by, bz, radius)
        for j in range(rows.shape[0]):
            longest = max(forward, backward)
            travel = longest * (speed + 0.5 * bend * longest) + level + SAFETY
            reach = radius + travel + rows[j, 16]
            dx, dy, dz = bx - rows[j, 1], by - rows[j, 2], bz - rows[j, 3]
            kind = rows[j, 0]
            if kind != HALFSPACE and dx * dx + dy * dy + dz * dz > reach * reach:
                continue
            for i in range(begin - 1, end):
                # the ball around the spheres comes first
                x, y, z = (bx, by, bz) if i < begin else carried(T, link, body.spheres, i)
                near = travel + (radius if i < begin else body.spheres[i, 3])
                far = False
                if kind == BOX:
                    dx, dy, dz = x - rows[j, 1], y - rows[j, 2], z - rows[j, 3]
                    u = max(abs(rows[j, 4] * dx + rows[j, 7] * dy + rows[j, 10] * dz) - rows[j, 13], 0.0)
                    v = max(abs(rows[j, 5] * dx + rows[j, 8] * dy + rows[j, 11] * dz) - rows[j, 14], 0.0)
                    w = max(abs(rows[j, 6] * dx + rows[j, 9] * dy + rows[j, 12] * dz) - rows[j, 15], 0.0)
                    far = u * u + v * v + w * w > near * near
                    if i < begin and not far:
                        continue
                elif kind == HULL:
                    far = hull_height(rows, body.faces, j, x, y, z) > near
                d, gx, gy, gz = 0.0, 0.0, 0.0, 0.0
                if not far:
                    d, gx, gy, gz = signed_distance(rows, body.faces, j, x, y, z)
                    far = d > near
                if far and i < begin:
                    break
                if far or i < begin:
                    continue
                d -= body.spheres[i, 3]
                if d < gap:
                    gap, first, second = d, i, j
                    if d < floor:
                        return Steps(-1.0, -1.0, level, gap, first, second)
                u, v, w = _velocity(W, 0, link, x, y, z)
                spare, slope = (1.0 - keep) * (d - floor), gx * u + gy * v + gz * w
                level = min(level, d - spare)
                forward = min(forward, span(spare, slope, bend))
                backward = min(backward, span(spare, -slope, bend))
    return _self_steps(body, T, W, A, keep, Steps(forward, backward, level, gap, first, second))


@inner
def _self_steps(body: Body, T: Array, W: Array, A: Array, keep: float, found: Steps) -> Steps:
    """The same for pairs of links, from what the obstacles allow."""
    forward, backward, level, gap, first, second = found
    floor = body.floor + SAFETY
    for p in range(body.pairs.shape[0]):
        a, b = body.pairs[p, 0], body.pairs[p, 1]
        ax, ay, az = carried(T, a, body.balls, a)
        bx, by, bz = carried(T, b, body.balls, b)
        longest = max(forward, backward)
        speed = _ball_speed(W, a, b, bx, by, bz, body.balls[b, 3])
        travel = longest * (speed + 0.5 * A[a, b] * longest)
        reach = body.balls[a, 3] + body.balls[b, 3] + travel + level + SAFETY
        if (bx - ax) ** 2 + (by - ay) ** 2 + (bz - az) ** 2 > reach * reach:
            continue
        for i in range(int(body.balls[b, 4]), int(body.balls[b, 5])):
            x, y, z = carried(T, b, body.spheres, i)
            u, v, w = _velocity(W, a, b, x, y, z)
            for k in range(int(body.balls[a, 4]), int(body.balls[a, 5])):
                if body.apart[i, k] == 0:
                    continue
                ox, oy, oz = carried(T, a, body.spheres, k)
                dx, dy, dz = x - ox, y - oy, z - oz
                apart = math.sqrt(dx * dx + dy * dy + dz * dz)
                d = apart - body.spheres[i, 3] - body.spheres[k, 3]
                if d < gap:
                    gap, first, second = d, i, -(k + 3)
                    if d < floor:
                        return Steps(-1.0, -1.0, level, gap, first, second)
                spare, slope = (1.0 - keep) * (d - floor), (dx * u + dy * v + dz * w) / max(apart, 1e-12)
                level = min(level, d - spare)
                forward = min(forward, span(spare, slope, A[a, b]))
                backward = min(backward, span(spare, -slope, A[a, b]))
    return Steps(forward, backward, level, gap, first, second)


@inner
def _cone(body: Body, T: Array, W: Array) -> tuple[float, float]:
    """By how much the cosine between the tool's axis and its direction exceeds the least one, and its rate."""
    n = T.shape[0] - 2
    cone = body.cone
    x = T[n + 1, 0] * cone[0] + T[n + 1, 1] * cone[1] + T[n + 1, 2] * cone[2]
    y = T[n + 1, 3] * cone[0] + T[n + 1, 4] * cone[1] + T[n + 1, 5] * cone[2]
    z = T[n + 1, 6] * cone[0] + T[n + 1, 7] * cone[1] + T[n + 1, 8] * cone[2]
    u, v, w = W[n, 4] * z - W[n, 5] * y, W[n, 5] * x - W[n, 3] * z, W[n, 3] * y - W[n, 4] * x
    return x * cone[3] + y * cone[4] + z * cone[5] - cone[6], u * cone[3] + v * cone[4] + w * cone[5]
