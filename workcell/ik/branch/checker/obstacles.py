"""Whether a sphere of the robot collides with an obstacle, or with another, in every configuration of a box."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from workcell.ik.branch.checker.closure import Box, Robot, in_ball, wander
from workcell.ik.branch.checker.linear import noise_along
from workcell.ik.branch.checker.vectors import Vector, cross, dot, minus, move, norm, plus, vector
from workcell.jit import exact_inner
from workcell.pose import Array

BOX, SPHERE, CAPSULE, CYLINDER, HALFSPACE, HULL = 0, 1, 2, 3, 4, 5


class Scene(NamedTuple):
    """Spheres, obstacles and triangles of a problem, all in the world.

    Spheres (m, 5): link, centre in the zero configuration, radius. Obstacles (k, 18): kind, rotation (9),
    position (3), size (3), first and last triangle. Triangles (f, 9).
    """

    spheres: Array
    obstacles: Array
    triangles: Array


@exact_inner
def collides(robot: Robot, box: Box, scene: Scene, s: int, o: int, clearance: float) -> bool:
    """Whether the clearance between sphere s and obstacle o is below `clearance` all over the box."""
    joints = box.lower.shape[0]
    sphere, row = scene.spheres[s], scene.obstacles[o]
    link = int(sphere[0])
    limit = sphere[4] + clearance - robot.scale[0]
    for side in range(2):
        x = move(box.motions[side, link], vector(sphere, 1))
        radius = (
            wander(box, 0, 0, link + 1, x)
            if side == 0
            else wander(box, 1, link + 1, joints, x) + in_ball(robot, x)
        )
        if _inside(scene, row, x, limit - radius):
            return True
        if _tube_inside(robot, box, scene, row, side, link, x, radius, limit):
            return True
    return False


@exact_inner
def touch(robot: Robot, box: Box, scene: Scene, s: int, o: int, clearance: float) -> bool:
    """Whether the clearance between spheres s and o is below `clearance` all over the box.

    Seen from the link of the sphere nearer to the base, the joints between the two move one or the other: those up to
    some link the near one backwards, the rest the far one.
    """
    if scene.spheres[s, 0] > scene.spheres[o, 0]:
        s, o = o, s
    first, last = int(scene.spheres[s, 0]), int(scene.spheres[o, 0])
    near = move(box.motions[0, first], vector(scene.spheres[s], 1))
    far = move(box.motions[0, last], vector(scene.spheres[o], 1))
    room = scene.spheres[s, 4] + scene.spheres[o, 4] + clearance - norm(minus(far, near)) - robot.scale[0]
    for split in range(first, last + 1):
        if wander(box, 0, first + 1, split + 1, near) + wander(box, 0, split + 1, last + 1, far) < room:
            return True
    return False


@exact_inner
def _tube_inside(
    robot: Robot,
    box: Box,
    scene: Scene,
    row: Array,
    side: int,
    link: int,
    x: Vector,
    radius: float,
    limit: float,
) -> bool:
    """The same to second order: the point moves along a segment, with the joints' noise (or the joints) on top."""
    joints = box.lower.shape[0]
    first, last, step = (1, link, 1) if side == 0 else (joints - 2, link + 1, -1)
    follows = box.follow[0, 0] > 0.0
    shifts = np.zeros((8 + joints, 3))
    total, rest, j = 0.0, robot.scale[0] if side == 0 else in_ball(robot, x) + robot.scale[0], first
    # The ball also turns what the joints have moved.
    turned = 0.0 if side == 0 else robot.ball[1]
    while (step > 0 and j <= last) or (step < 0 and j >= last):
        line = box.sides[side, j]
        low, high = box.lower[j] - box.centre[j], box.upper[j] - box.centre[j]
        h = max(high, -low)
        # Second order, as the third in `linear`: total^2 t h l integrates to total^2 h l / 6.
        if line[9] > 0.0:
            w = vector(line, 0)
            rest += ((1.0 + total / 6.0) * total + turned) * h
        else:
            w = cross(vector(line, 0), minus(x, vector(line, 3)))
            rest += (0.5 * ((total + h) ** 2 - total**2) + (total**2 / 6.0 + turned) * h) * norm(w)
            total += h
        for a in range(3):
            way = w[a] if side == 0 else -w[a]
            if follows:
                for r in range(8):
                    shifts[r, a] += box.follow[j, r] * way
                if box.follow[0, 11] > 0.0:
                    for k in range(1, joints - 1):
                        shifts[8 + k, a] += box.follow[j, 12 + k] * way
            else:
                shifts[0, a] += 0.5 * (low + high) * way
                shifts[8 + j, a] = 0.5 * (high - low) * way
        j += step
    if follows and box.follow[0, 11] > 0.0:
        # Free joints but one count as noise, around the middle of their ranges.
        for k in range(1, joints - 1):
            low, high = box.lower[k] - box.centre[k], box.upper[k] - box.centre[k]
            for a in range(3):
                shifts[0, a] += 0.5 * (low + high) * shifts[8 + k, a]
                shifts[8 + k, a] *= 0.5 * (high - low)
    middle = plus(x, 1.0, vector(shifts[0], 0))
    one, two = middle, middle
    if follows and box.follow[0, 1] > 0.0:
        free = int(box.follow[0, 1])
        one = plus(middle, box.lower[free] - box.centre[free], vector(shifts[1], 0))
        two = plus(middle, box.upper[free] - box.centre[free], vector(shifts[1], 0))
    if row[0] == BOX:
        return _in_rounded_box(robot, box, row, shifts, one, two, x, rest, radius, limit)
    squares = 0.0
    for a in range(3):
        e = (1.0 if a == 0 else 0.0, 1.0 if a == 1 else 0.0, 1.0 if a == 2 else 0.0)
        squares += (_reach(robot, box, shifts, e) + rest) ** 2
    room = limit - np.sqrt(squares)
    return _inside(scene, row, one, room) and _inside(scene, row, two, room)


@exact_inner
def _reach(robot: Robot, box: Box, shifts: Array, e: Vector) -> float:
    """How far the noise goes along a unit direction."""
    reach = 0.0
    for k in range(8, shifts.shape[0]):
        reach += abs(dot(e, vector(shifts[k], 0)))
    if box.follow[0, 0] > 0.0:
        weights = np.empty(6)
        for r in range(6):
            weights[r] = dot(e, vector(shifts[2 + r], 0))
        reach += noise_along(weights, box.follow[0, 2:8], box.follow[0, 8:11], robot.ball)
    return reach


@exact_inner
def _in_rounded_box(
    robot: Robot, box: Box, row: Array, shifts: Array, one: Vector, two: Vector, x: Vector, rest: float,
    radius: float, limit: float,
) -> bool:  # fmt: skip
    """Whether all lies in a box swollen by `limit`, by the largest coordinate along each of its axes."""
    if limit <= 0.0:
        return False
    origin, squares = vector(row, 10), 0.0
    for axis in range(3):
        e = (row[1 + axis], row[4 + axis], row[7 + axis])
        farthest = max(abs(dot(e, minus(one, origin))), abs(dot(e, minus(two, origin))))
        farthest = min(
            farthest + _reach(robot, box, shifts, e) + rest, abs(dot(e, minus(x, origin))) + radius
        )
        squares += max(farthest - row[13 + axis], 0.0) ** 2
    return squares < limit * limit


@exact_inner
def _inside(scene: Scene, row: Array, x: Vector, room: float) -> bool:
    """Whether the signed distance of a point to an obstacle is below `room` (which may be negative)."""
    kind = int(row[0])
    u = minus(x, vector(row, 10))
    a = (dot(u, (row[1], row[4], row[7])), dot(u, (row[2], row[5], row[8])), dot(u, (row[3], row[6], row[9])))
    if kind == HALFSPACE:
        return a[2] < room
    if kind == SPHERE:
        return norm(a) - row[13] < room  # type: ignore[no-any-return]
    if kind == CAPSULE:
        beyond = max(abs(a[2]) - row[14], 0.0)
        return norm((a[0], a[1], beyond)) - row[13] < room  # type: ignore[no-any-return]
    if kind == HULL:
        return _inside_hull(scene, row, a, room)
    if kind == CYLINDER:
        over = (np.hypot(a[0], a[1]) - row[13], abs(a[2]) - row[14], -np.inf)
    else:
        over = (abs(a[0]) - row[13], abs(a[1]) - row[14], abs(a[2]) - row[15])
    if max(over) <= 0.0 or room <= 0.0:
        return max(over) < room  # type: ignore[no-any-return]
    return norm((max(over[0], 0.0), max(over[1], 0.0), max(over[2], 0.0))) < room


@exact_inner
def _inside_hull(scene: Scene, row: Array, a: Vector, room: float) -> bool:
    """By the height over the triangles' planes, and outside by the nearest point of one (all belong to it)."""
    height, nearest = -np.inf, np.inf
    for k in range(int(row[16]), int(row[17])):
        t = scene.triangles[k]
        p, q, r = vector(t, 0), vector(t, 3), vector(t, 6)
        normal = cross(minus(q, p), minus(r, p))
        length, sides = norm(normal), norm(minus(q, p)) * norm(minus(r, p))
        # The normal of a thin triangle is uncertain, that of one without area is any.
        flat = length < 1e-6 * sides
        lifted = np.inf if flat else dot(normal, minus(a, p)) / length
        height = max(height, lifted + 1e-15 * sides / max(length, 1e-300) * norm(minus(a, p)))
        nearest = min(nearest, _to_edge(a, p, q), _to_edge(a, q, r), _to_edge(a, r, p))
        if flat:
            continue
        foot = plus(a, -dot(normal, minus(a, p)) / (length * length), normal)
        if (
            dot(cross(minus(q, p), minus(foot, p)), normal) >= 0.0
            and dot(cross(minus(r, q), minus(foot, q)), normal) >= 0.0
            and dot(cross(minus(p, r), minus(foot, r)), normal) >= 0.0
        ):
            nearest = min(nearest, norm(minus(a, foot)))
    return height < room if height <= 0.0 else nearest < room


@exact_inner
def _to_edge(a: Vector, p: Vector, q: Vector) -> float:
    edge = minus(q, p)
    share = min(max(dot(minus(a, p), edge) / max(dot(edge, edge), 1e-300), 0.0), 1.0)
    return norm(minus(a, plus(p, share, edge)))
