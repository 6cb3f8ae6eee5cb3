"""Contracting joints by what is known between two lines, one seen from the base and one from the target.

Four numbers don't change when the lines' own joints turn: the square of the distance between their points, its
components along either line, and the cosine between the lines. Their ranges follow from the joint between the lines
(`closure.between`), or are 0, 0, 0 and 1 for one line seen from both sides.
"""

from __future__ import annotations

import numpy as np

from workcell.ik.branch.checker.closure import (
    Box,
    Robot,
    advance,
    around,
    between,
    in_ball,
    invariant,
    narrow,
    off_axis,
    own_slide,
    sliding,
    stand_at_centre,
    tilt,
    wander,
)
from workcell.ik.branch.checker.coupled import keep_coupled
from workcell.ik.branch.checker.linear import follow_closure
from workcell.ik.branch.checker.vectors import (
    Vector,
    angles_in_band,
    dot,
    minus,
    norm,
    places_in_band,
    vector,
)
from workcell.jit import exact_inner
from workcell.pose import Array

EMPTY, AGAIN, STALLED = 0, 1, 2
ROUNDS = 8
"""Times a box is contracted at most."""
_WORTH = 0.3
"""Fall in the sum of the widths' logarithms for which a box is contracted again by what has just been used."""


@exact_inner
def contract(robot: Robot, box: Box) -> bool:
    """Shrink a box as long as that pays; False if it is proved to hold no solution."""
    for _ in range(ROUNDS):
        outcome = contract_once(robot, box)
        if outcome != AGAIN:
            return outcome != EMPTY
    return True


@exact_inner
def contract_once(robot: Robot, box: Box) -> int:
    """Shrink a box once: EMPTY if it is proved to hold no solution, AGAIN if that paid, else STALLED."""
    before = _size(box)
    if not keep_coupled(robot, box):
        return EMPTY
    stand_at_centre(robot, box)
    if not contract_near(robot, box):
        return EMPTY
    if _size(box) < before - _WORTH:
        return AGAIN
    if not contract_through(robot, box) or not follow_closure(robot, box):
        return EMPTY
    return AGAIN if _size(box) < before - _WORTH else STALLED


@exact_inner
def _size(box: Box) -> float:
    total = 0.0
    for k in range(1, box.lower.shape[0] - 1):
        total += np.log(box.upper[k] - box.lower[k] + 1e-9)
    return total


@exact_inner
def contract_near(robot: Robot, box: Box) -> bool:
    """Contract every joint by its neighbours' lines; False if the box is proved to hold no solution."""
    for k in range(1, box.lower.shape[0] - 1):
        if not _same_line(robot, box, k + 1, k) or not _same_line(robot, box, k - 1, k):
            return False
        if not _middle(robot, box, k):
            return False
    return True


@exact_inner
def contract_through(robot: Robot, box: Box) -> bool:
    """Contract every joint by the lines around every other; False if the box is proved to hold no solution."""
    joints = box.lower.shape[0]
    for i in range(1, joints - 1):
        between(robot, box, i)
        for j in range(1, i - 1):
            if not _known(robot, box, i - 1, j, i + 1):
                return False
        for j in range(i + 2, joints - 1):
            if not _known(robot, box, i - 1, j, i + 1):
                return False
    return True


@exact_inner
def _same_line(robot: Robot, box: Box, line: int, joint: int) -> bool:
    """Contract a joint by a neighbour's line, seen from both sides."""
    box.ranges[:3, :] = 0.0
    box.ranges[3, :] = 1.0
    return _known(robot, box, line, joint, line)


@exact_inner
def _middle(robot: Robot, box: Box, i: int) -> bool:
    """Contract joint i by the lines before and after it."""
    joints, eps = box.lower.shape[0], robot.scale[0]
    near, far = box.sides[0, i - 1], box.sides[1, i + 1]
    y, zy, x, zx = vector(near, 3), vector(near, 0), vector(far, 6), vector(far, 0)
    d = minus(x, y)
    own = own_slide(box, i - 1) + own_slide(box, i + 1)
    move_x = wander(box, 0, 0, i - 1, x) + wander(box, 1, i + 2, joints, x) + in_ball(robot, x)
    move_y = wander(box, 0, 0, i - 1, y) + wander(box, 1, i + 2, joints, y) + in_ball(robot, y)
    tilted = tilt(box, 0, 0, i - 1, zx) + tilt(box, 1, i + 2, joints, zx) + robot.ball[1]
    part, turned = advance(box, 0, i - 2, 0, -1, zy, x, 0.0, 0.0)
    rest, _ = advance(box, 1, joints - 1, i + 2, -1, zy, x, 0.0, turned + robot.ball[1])
    along_y = part + rest + in_ball(robot, x) + own
    part, turned = advance(box, 1, i + 2, joints - 1, 1, zx, y, 0.0, 0.0)
    rest, _ = advance(box, 0, 0, i - 2, 1, zx, y, 0.0, turned + robot.ball[1])
    along_x = part + rest + in_ball(robot, y) + own

    m, zm, f, zf = around(robot, box, i)
    for kind in range(4):
        if kind == 0:
            r = min(move_x, move_y) + own + eps
            low, high = max(norm(d) - r, 0.0) ** 2, (norm(d) + r) ** 2
        else:
            r = eps + (along_y if kind == 1 else (along_x if kind == 2 else tilted))
            value = dot(zy, d) if kind == 1 else (dot(zx, d) if kind == 2 else dot(zy, zx))
            low, high = value - r, value + r
        if not _keep(robot, box, i, kind, m, zm, f, zf, vector(robot.lines[i], 0), low, high, 0.0, 1.0):
            return False
    return True


@exact_inner
def _keep(
    robot: Robot, box: Box, j: int, kind: int, y: Vector, zy: Vector, x: Vector, zx: Vector, z: Vector,
    low: float, high: float, origin: float, sign: float,
) -> bool:  # fmt: skip
    """Keep of joint j, its angle or way t counted from `origin`, what brings an invariant into [low, high].

    The far line (x, zx) moves by sign * t against the near one (y, zy).
    """
    eps = robot.scale[0]
    first, last = box.lower[j] - origin, box.upper[j] - origin
    if robot.lines[j, 9] > 0.0:
        a, b, c = sliding(kind, y, zy, x, zx, z)
        first, last = places_in_band(a, sign * b, c, low, high, first, last, eps)
    else:
        a, b, c = invariant(kind, y, zy, x, zx, z)
        first, last = angles_in_band(a, b, sign * c, low, high, first, last, eps)
    return first <= last and narrow(box, j, origin + first, origin + last)


@exact_inner
def _known(robot: Robot, box: Box, i: int, j: int, k: int) -> bool:
    """Contract joint j by the invariants between near line i and far line k, whose ranges are in `box.ranges`.

    j < i: joint j moves the near line, so it is between the base and it; j > k: the far line. Joints outside j, towards
    base or target, are counted as moving the other line, joints between j and its line as moving that line.
    """
    eps = robot.scale[0]
    near, far = box.sides[0, i], box.sides[1, k]
    y, zy, x, zx = vector(near, 3), vector(near, 0), vector(far, 6), vector(far, 0)
    if i == k and j < i:
        y = vector(near, 6)
    elif i == k:
        x = vector(far, 3)
    line = box.sides[0, j] if j < i else box.sides[1, j]
    if j < i:
        radius, along_y, along_x, tilted = _radii_near(robot, box, i, j, k, line, y, zy, x, zx)
    else:
        radius, along_y, along_x, tilted = _radii_far(robot, box, i, j, k, line, y, zy, x, zx)
    own = own_slide(box, i) + (own_slide(box, k) if i != k else 0.0)
    radius, along_y, along_x = radius + own, along_y + own, along_x + own
    z, o = vector(line, 0), vector(line, 3)
    y, x = minus(y, o), minus(x, o)
    for kind in range(4):
        low, high = box.ranges[kind, 0], box.ranges[kind, 1]
        if kind == 0:
            low = max(np.sqrt(max(low, 0.0)) - radius - eps, 0.0) ** 2
            high = (np.sqrt(max(high, 0.0)) + radius + eps) ** 2
        elif kind == 3 and i == k:
            # One direction seen from both sides: a chord of length r is an angle whose cosine is 1 - r^2 / 2.
            low = 1.0 - 0.5 * (tilted + eps) ** 2
        else:
            r = eps + (along_y if kind == 1 else (along_x if kind == 2 else tilted))
            low, high = low - r, high + r
        # A near line that moves forward, and a far one seen backwards from the target: both move x by -t against y.
        if not _keep(robot, box, j, kind, y, zy, x, zx, z, low, high, box.centre[j], -1.0):
            return False
    return True


@exact_inner
def _radii_near(
    robot: Robot, box: Box, i: int, j: int, k: int, line: Array, y: Vector, zy: Vector, x: Vector, zx: Vector
) -> tuple[float, float, float, float]:
    """Radii for a joint j < i: of the points, along the near and the far line, and of the directions."""
    joints = box.lower.shape[0]
    move_y = wander(box, 0, j + 1, i, y)
    move_x = wander(box, 0, 0, j, x) + wander(box, 1, k + 1, joints, x) + in_ball(robot, x)
    tilted = (
        tilt(box, 0, j + 1, i, zy) + tilt(box, 0, 0, j, zx) + tilt(box, 1, k + 1, joints, zx) + robot.ball[1]
    )
    along_y = move_x + advance(box, 0, i - 1, j + 1, -1, zy, x, box.chord[j] * off_axis(x, line), 0.0)[0]
    swing = box.chord[j] * off_axis(y, line)
    part, turned = advance(box, 1, k + 1, joints - 1, 1, zx, y, swing, 0.0)
    rest, _ = advance(box, 0, 0, j - 1, 1, zx, y, swing, turned + robot.ball[1])
    along_x = move_y + part + rest + in_ball(robot, y) + 2.0 * robot.ball[1] * swing
    return move_x + move_y, along_y, along_x, tilted


@exact_inner
def _radii_far(
    robot: Robot, box: Box, i: int, j: int, k: int, line: Array, y: Vector, zy: Vector, x: Vector, zx: Vector
) -> tuple[float, float, float, float]:
    """The same for a joint j > k."""
    joints = box.lower.shape[0]
    move_x = wander(box, 1, k + 1, j, x)
    move_y = wander(box, 1, j + 1, joints, y) + wander(box, 0, 0, i, y) + in_ball(robot, y)
    tilted = (
        tilt(box, 1, k + 1, j, zx) + tilt(box, 1, j + 1, joints, zy) + tilt(box, 0, 0, i, zy) + robot.ball[1]
    )
    along_x = move_y + advance(box, 1, k + 1, j - 1, 1, zx, y, box.chord[j] * off_axis(y, line), 0.0)[0]
    swing = box.chord[j] * off_axis(x, line)
    part, turned = advance(box, 0, i - 1, 0, -1, zy, x, swing, 0.0)
    rest, _ = advance(box, 1, joints - 1, j + 1, -1, zy, x, swing, turned + robot.ball[1])
    along_y = move_x + part + rest + in_ball(robot, x) + 2.0 * robot.ball[1] * swing
    return move_x + move_y, along_y, along_x, tilted
