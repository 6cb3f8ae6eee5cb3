"""What the closure of the chain says about a box of joint angles: bands for single joints between any two lines.

Everything is in the base's frame. The pose of link k is T_k times its pose in the zero configuration, T_k the product
of the exponentials of joints 1 to k; a solution has T_n = G, the motion that takes the tool from its zero pose to the
target. So link k can be computed from the base, and from the target backwards. Joints 0 and n + 1 don't turn; they
carry one line each, fixed to the base and to the tool. Where only the tool's position, or its position and one
direction count, the target itself has joints: they come after the robot's.

Around the centre of the box, T_k(q) = E_1 ... E_k T_k(centre) with E_j a rotation by q_j - centre_j about axis j as it
lies at the centre. A point x moves under any product of the E_j by at most sum_j chord_j dist(x, axis_j), chord_j =
2 sin(h_j / 2), as rotations preserve distances. A joint that slides moves every point by at most h_j.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from workcell.ik.branch.checker.vectors import (
    EPS,
    Vector,
    band_over,
    cross,
    dot,
    minus,
    move,
    norm,
    parabola_over,
    plus,
    screw,
    slide,
    turn,
    vector,
)
from workcell.jit import exact_inner, exact_kernel
from workcell.pose import Array


class Robot(NamedTuple):
    """The problem's kinematics.

    Attributes:
        lines: (N, 10) of every joint in the zero configuration: direction, its point nearest the line before, and
            after; 1 where the joint slides. The points belong to the link that the joint moves.
        middle: the joint at whose link the linear closure is taken.
        turns: whether the target's rotation counts.
        goal: (12,) the motion G.
        ball: (5,) tolerances (m, rad) and the target's position.
        scale: (1,) rounding slack, see `vectors`.
        coupled: (f, 2 + d + 1) joints that follow others, who leads them, and by which polynomial, in rising powers.
    """

    lines: Array
    middle: int
    turns: bool
    goal: Array
    ball: Array
    scale: Array
    coupled: Array


class Box(NamedTuple):
    """A box and the lines at its centre.

    Attributes:
        lower, upper, centre, chord: (N,).
        motions: (2, N, 12) T_k from the base, and from the target.
        sides: (2, N, 10) lines as seen from the base and from the target.
        ranges: (4, 2) scratch.
        follow: (N + 1, 12 + N) how joints follow one another, see `linear`.
    """

    lower: Array
    upper: Array
    centre: Array
    chord: Array
    motions: Array
    sides: Array
    ranges: Array
    follow: Array


@exact_kernel
def new_box(joints: int) -> Box:
    """Room for one."""
    return Box(
        np.zeros(joints),
        np.zeros(joints),
        np.zeros(joints),
        np.zeros(joints),
        np.zeros((2, joints, 12)),
        np.zeros((2, joints, 10)),
        np.zeros((4, 2)),
        np.zeros((joints + 1, 12 + joints)),
    )


@exact_inner
def stand_at_centre(robot: Robot, box: Box) -> None:
    """Compute the motions and lines at the middle of the box; how joints follow one another isn't known there yet."""
    joints = robot.lines.shape[0]
    box.follow[0, 0] = 0.0
    base, target = box.motions[0], box.motions[1]
    for k in range(joints):
        box.centre[k] = 0.5 * (box.lower[k] + box.upper[k])
        box.sides[0, k, 9] = box.sides[1, k, 9] = robot.lines[k, 9]
        update_chord(box, k)
    base[0, :] = 0.0
    base[0, 0] = base[0, 4] = base[0, 8] = 1.0
    for k in range(1, joints):
        _follow_joint(robot, base[k - 1], k, box.centre[k], base[k])
    target[joints - 1, :] = robot.goal
    for k in range(joints - 1, 0, -1):
        _follow_joint(robot, target[k], k, -box.centre[k], target[k - 1])
    for side in range(2):
        for k in range(joints):
            T, line, out = box.motions[side, k], robot.lines[k], box.sides[side, k]
            out[0], out[1], out[2] = turn(T, vector(line, 0))
            out[3], out[4], out[5] = move(T, vector(line, 3))
            out[6], out[7], out[8] = move(T, vector(line, 6))


@exact_inner
def _follow_joint(robot: Robot, T: Array, k: int, value: float, out: Array) -> None:
    """out = T * exponential of joint k."""
    line = robot.lines[k]
    if line[9] > 0.0:
        slide(T, vector(line, 0), value, out)
    else:
        screw(T, vector(line, 0), vector(line, 3), value, out)


@exact_inner
def update_chord(box: Box, k: int) -> None:
    """The chord of joint k's largest departure from the centre, or the departure itself, which is no less."""
    h = max(box.upper[k] - box.centre[k], box.centre[k] - box.lower[k])
    if h > 0.0:
        box.chord[k] = (h if h < 0.3 or box.sides[0, k, 9] > 0.0 else 2.0 * np.sin(0.5 * min(h, np.pi))) + EPS
    else:
        box.chord[k] = 0.0


@exact_inner
def narrow(box: Box, k: int, lower: float, upper: float) -> bool:
    """Keep [lower, upper] of joint k; False if nothing is left."""
    if lower > upper:
        return False
    box.lower[k] = max(box.lower[k], lower - EPS)
    box.upper[k] = min(box.upper[k], upper + EPS)
    update_chord(box, k)
    return box.lower[k] <= box.upper[k]  # type: ignore[no-any-return]


@exact_inner
def off_axis(x: Vector, line: Array) -> float:
    """How far a joint moves a point for each unit of its chord: by its distance from the line, or by 1 if it slides."""
    if line[9] > 0.0:
        return 1.0
    return norm(cross(vector(line, 0), minus(x, vector(line, 3))))


@exact_inner
def off_direction(z: Vector, line: Array) -> float:
    """The same for a unit direction: the sine between it and the line, or nothing."""
    if line[9] > 0.0:
        return 0.0
    return norm(cross(z, vector(line, 0)))


@exact_inner
def own_slide(box: Box, k: int) -> float:
    """How far joint k moves the points of its own line."""
    return box.chord[k] if box.sides[0, k, 9] > 0.0 else 0.0  # type: ignore[no-any-return]


@exact_inner
def wander(box: Box, side: int, first: int, last: int, x: Vector) -> float:
    """How far a point moves under joints first <= k < last, their axes seen from one side."""
    total = 0.0
    for k in range(first, last):
        if box.chord[k] > 0.0:
            total += box.chord[k] * off_axis(x, box.sides[side, k])
    return total


@exact_inner
def tilt(box: Box, side: int, first: int, last: int, z: Vector) -> float:
    """The same for a unit direction."""
    total = 0.0
    for k in range(first, last):
        if box.chord[k] > 0.0:
            total += box.chord[k] * off_direction(z, box.sides[side, k])
    return total


@exact_inner
def in_ball(robot: Robot, x: Vector) -> float:
    """How far a point fixed to the target moves within the tolerance ball, there or back."""
    ball = robot.ball
    return (ball[0] + ball[1] * norm(minus(x, vector(ball, 2)))) * (1.0 + ball[1])  # type: ignore[no-any-return]


@exact_inner
def advance(
    box: Box, side: int, first: int, last: int, step: int, z: Vector, x: Vector, extra: float, turned: float
) -> tuple[float, float]:
    """Component along z of a point's move under joints first, first + step ... last (outermost first), and z's tilt.

    Of E_1 E_2 x - x the part by joint 2 is E_1 (E_2 x - x), a vector at right angles to E_1 z_2: along z it counts with
    at most |z x z_2| + (what E_1 tilts z by), and at most fully; along z_2 if joint 2 slides, so with |z . z_2|. x is
    known to `extra`.
    """
    total, k = 0.0, first
    while (step > 0 and k <= last) or (step < 0 and k >= last):
        if box.chord[k] > 0.0:
            line = box.sides[side, k]
            if line[9] > 0.0:
                total += box.chord[k] * min(1.0, abs(dot(z, vector(line, 0))) + turned)
            else:
                sine = off_direction(z, line)
                total += box.chord[k] * (off_axis(x, line) + extra) * min(1.0, sine + turned)
                turned += box.chord[k] * sine
        k += step
    return total, turned


@exact_inner
def wave(u: Vector, v: Vector, z: Vector) -> Vector:
    """(a, b, c) of u . E(t) v = a + b cos t + c sin t, E(t) the rotation by t about z."""
    along = dot(u, z) * dot(v, z)
    return (along, dot(u, v) - along, dot(u, cross(z, v)))


@exact_inner
def around(robot: Robot, box: Box, i: int) -> tuple[Vector, Vector, Vector, Vector]:
    """Points and directions of the lines of joints i - 1 and i + 1 at the zero configuration, from a point of i.

    Where joint i + 1 slides, its points lie where they do at the centre of the box.
    """
    m, f, o = robot.lines[i - 1], robot.lines[i + 1], vector(robot.lines[i], 3)
    x = minus(vector(f, 6), o)
    if f[9] > 0.0:
        x = plus(x, box.centre[i + 1], vector(f, 0))
    return minus(vector(m, 3), o), vector(m, 0), x, vector(f, 0)


@exact_inner
def between(robot: Robot, box: Box, i: int) -> None:
    """Ranges over joint i of the invariants between the lines of joints i - 1 and i + 1."""
    eps, line = robot.scale[0], robot.lines[i]
    y, zy, x, zx = around(robot, box, i)
    for kind in range(4):
        if line[9] > 0.0:
            a, b, c = sliding(kind, y, zy, x, zx, vector(line, 0))
            low, high = parabola_over(a, b, c, box.lower[i], box.upper[i], eps)
        else:
            a, b, c = invariant(kind, y, zy, x, zx, vector(line, 0))
            low, high = band_over(a, b, c, box.lower[i], box.upper[i], eps)
        box.ranges[kind, 0], box.ranges[kind, 1] = low, high


@exact_inner
def invariant(kind: int, y: Vector, zy: Vector, x: Vector, zx: Vector, z: Vector) -> Vector:
    """Coefficients of |f - m|^2, z_m.(f - m), z_f.(f - m), z_m.z_f (kinds 0 to 3) as a + b cos t + c sin t.

    The far line (x, zx) turns about z by t, the near one (y, zy) stays; both points are taken from the axis.
    """
    if kind == 0:
        a, b, c = wave(y, x, z)
        return (dot(x, x) + dot(y, y) - 2.0 * a, -2.0 * b, -2.0 * c)
    if kind == 1:
        a, b, c = wave(zy, x, z)
        return (a - dot(zy, y), b, c)
    if kind == 2:
        a, b, c = wave(y, zx, z)
        return (dot(zx, x) - a, -b, -c)
    return wave(zy, zx, z)


@exact_inner
def sliding(kind: int, y: Vector, zy: Vector, x: Vector, zx: Vector, z: Vector) -> Vector:
    """The same as a + b t + c t^2 where the far line slides along z by t."""
    d = minus(x, y)
    if kind == 0:
        return (dot(d, d), 2.0 * dot(z, d), 1.0)
    if kind == 1:
        return (dot(zy, d), dot(zy, z), 0.0)
    if kind == 2:
        return (dot(zx, d), dot(zx, z), 0.0)
    return (dot(zy, zx), 0.0, 0.0)
