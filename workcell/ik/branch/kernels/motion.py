"""Motion radii: how far a point or a direction can go while joints vary within the box.

With the axes at the centre of the box, the pose of link i is E_1 E_2 ... E_i times its pose at the centre, E_j the
rotation about axis j by the departure of joint j (product of exponentials). Rotations are isometries, so
|E_1 ... E_i x - x| <= sum_j |E_j x - x| <= sum_j 2 sin(h_j / 2) dist(x, axis_j), in whatever order, and a direction
d moves by at most sum_j 2 sin(h_j / 2) |z_j x d|. A joint that slides by at most h_j moves every point by that much
and no direction.
"""

from __future__ import annotations

import numpy as np

from workcell.jit import exact_inner
from workcell.pose import Array


@exact_inner
def arm(x: float, y: float, z: float, line: Array) -> float:
    """How far a joint moves a point for each unit of its chord: the distance to its line, or 1 where it slides."""
    if line[9] > 0.0:
        return 1.0
    u, v, w = x - line[3], y - line[4], z - line[5]
    a = v * line[2] - w * line[1]
    b = w * line[0] - u * line[2]
    c = u * line[1] - v * line[0]
    return np.sqrt(a * a + b * b + c * c)  # type: ignore[no-any-return]


@exact_inner
def sine_between(x: float, y: float, z: float, line: Array) -> float:
    """Sine of the angle between a unit direction and a line's: how far a joint turns it; 0 for one that slides."""
    if line[9] > 0.0:
        return 0.0
    a = y * line[2] - z * line[1]
    b = z * line[0] - x * line[2]
    c = x * line[1] - y * line[0]
    return np.sqrt(a * a + b * b + c * c)  # type: ignore[no-any-return]


@exact_inner
def ball_radius(x: float, y: float, z: float, ball: Array) -> float:
    """How far a point fixed to the target moves while the target varies in its tolerance ball."""
    u, v, w = x - ball[2], y - ball[3], z - ball[4]
    return (ball[0] + ball[1] * np.sqrt(u * u + v * v + w * w)) * (1.0 + ball[1])  # type: ignore[no-any-return]


@exact_inner
def own_slide(lines: Array, sweep: Array, k: int) -> float:
    """How far a joint moves the points of its own line: not at all, unless it slides."""
    return sweep[k] if lines[k, 9] > 0.0 else 0.0  # type: ignore[no-any-return]


@exact_inner
def point_radius(x: float, y: float, z: float, lines: Array, sweep: Array, count: int) -> float:
    """Radius of a point under the first `count` joints of a view."""
    total = 0.0
    for k in range(count):
        if sweep[k] > 0.0:
            total += sweep[k] * arm(x, y, z, lines[k])
    return total


@exact_inner
def direction_radius(x: float, y: float, z: float, lines: Array, sweep: Array, count: int) -> float:
    """The same for a direction."""
    total = 0.0
    for k in range(count):
        if sweep[k] > 0.0:
            total += sweep[k] * sine_between(x, y, z, lines[k])
    return total
