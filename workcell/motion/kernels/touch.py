"""Cheap looks at single configurations that spare proofs of what can't be proved: whether anything is too near.

A yes is final. A no proves nothing: it says that a proof is worth its time.
"""

from __future__ import annotations

from workcell.jit import inner
from workcell.kernels.chain import carried
from workcell.kernels.distance import hull_height, signed_distance
from workcell.kernels.shape_kinds import BOX, HALFSPACE, HULL
from workcell.motion.kernels.body import Body, Room, stand
from workcell.pose import Array


@inner
def _touches_obstacles(body: Body, T: Array) -> bool:
    """Links at the tip come first: they meet most. One function, since a call costs as much as a box."""
    rows = body.obstacles
    for link in range(body.balls.shape[0] - 1, -1, -1):
        begin, end = int(body.balls[link, 4]), int(body.balls[link, 5])
        radius = body.balls[link, 3] + body.floor
        if begin == end or radius <= 0.0:
            continue
        bx, by, bz = carried(T, link, body.balls, link)
        for j in range(rows.shape[0]):
            x, y, z = bx - rows[j, 1], by - rows[j, 2], bz - rows[j, 3]
            reach = radius + rows[j, 16]
            if rows[j, 0] != HALFSPACE and x * x + y * y + z * z > reach * reach:
                continue
            if rows[j, 0] != BOX:
                if _enters(body, T, link, j):
                    return True
                continue
            # the ball around the spheres comes first; distances to boxes without a root
            for i in range(begin - 1, end):
                size = radius
                if i >= begin:
                    x, y, z = carried(T, link, body.spheres, i)
                    x, y, z = x - rows[j, 1], y - rows[j, 2], z - rows[j, 3]
                    size = body.spheres[i, 3] + body.floor
                u = max(abs(rows[j, 4] * x + rows[j, 7] * y + rows[j, 10] * z) - rows[j, 13], 0.0)
                v = max(abs(rows[j, 5] * x + rows[j, 8] * y + rows[j, 11] * z) - rows[j, 14], 0.0)
                w = max(abs(rows[j, 6] * x + rows[j, 9] * y + rows[j, 12] * z) - rows[j, 15], 0.0)
                inside = size > 0.0 and u * u + v * v + w * w < size * size
                if i >= begin and inside:
                    return True
                if i < begin and not inside:
                    break
    return False


@inner
def _enters(body: Body, T: Array, link: int, j: int) -> bool:
    """Whether a link's sphere overlaps obstacle j, whatever its kind."""
    begin, end = int(body.balls[link, 4]), int(body.balls[link, 5])
    for i in range(begin - 1, end):
        row = link if i < begin else i
        balls = body.balls if i < begin else body.spheres
        x, y, z = carried(T, link, balls, row)
        size = balls[row, 3] + body.floor
        inside = size > 0.0
        if inside and body.obstacles[j, 0] == HULL:
            inside = hull_height(body.obstacles, body.faces, j, x, y, z) < size
        if inside:
            d, _, _, _ = signed_distance(body.obstacles, body.faces, j, x, y, z)
            inside = d < size
        if i >= begin and inside:
            return True
        if i < begin and not inside:
            return False
    return False


@inner
def _touches_itself(body: Body, T: Array) -> bool:
    for p in range(body.pairs.shape[0]):
        a, b = body.pairs[p, 0], body.pairs[p, 1]
        ax, ay, az = carried(T, a, body.balls, a)
        bx, by, bz = carried(T, b, body.balls, b)
        reach = body.balls[a, 3] + body.balls[b, 3] + body.floor
        if (bx - ax) ** 2 + (by - ay) ** 2 + (bz - az) ** 2 > reach * reach:
            continue
        for i in range(int(body.balls[b, 4]), int(body.balls[b, 5])):
            bx, by, bz = carried(T, b, body.spheres, i)
            for k in range(int(body.balls[a, 4]), int(body.balls[a, 5])):
                if body.apart[i, k] == 0:
                    continue
                ax, ay, az = carried(T, a, body.spheres, k)
                reach = body.spheres[i, 3] + body.spheres[k, 3] + body.floor
                if reach > 0.0 and (bx - ax) ** 2 + (by - ay) ** 2 + (bz - az) ** 2 < reach * reach:
                    return True
    return False


@inner
def free_samples(body: Body, a: Array, b: Array, count: int, work: Room) -> int:
    """How many of `count` samples on the line from a to b, b the last, come before the first that touches something."""
    for i in range(1, count + 1):
        share = i / count
        for k in range(a.shape[0]):
            work.lead[0, k] = a[k] + share * (b[k] - a[k])
        stand(body, work.lead[0], work)
        if _touches_obstacles(body, work.T) or _touches_itself(body, work.T):
            return i - 1
    return count
