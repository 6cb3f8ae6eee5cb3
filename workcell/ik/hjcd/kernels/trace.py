"""Walk along the self-motion of an arm with joints to spare, and stop where it is clear of obstacles.

The configurations of seven joints that reach a target form closed curves in joint space (more joints: all but seven
are held, at random). From a point of one of them we walk all around it, through obstacles and beyond limits, with
steps over which the walk surely stays in collision; so a clear stretch is hardly missed, however thin, and a curve
that was walked need not be walked again.
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np

from workcell.ik.hjcd.kernels.newton import polish
from workcell.jit import inner
from workcell.kernels.chain import Arm, forward
from workcell.kernels.cholesky import factor6, gram, solve6
from workcell.kernels.constants import HUGE, TURN
from workcell.kernels.contacts import Contacts, collect, idle_stretch
from workcell.kernels.pose_error import jacobian, move, pose_error
from workcell.kernels.structures import Work, World
from workcell.pose import Array

LONGEST = 0.12
"""Radians of one step."""
SHORTEST = 1e-3
"""Radians of one step."""
CAUTION = 0.75
"""Share of the idle stretch that is walked: its speed was taken at the step's beginning."""
SPARE = 5e-4
"""Metres of clearance that the walk may step over."""
MOST_STEPS = 4000
"""Steps after which a walk ends."""
MOST_ARC = 60.0
"""Radians after which a walk ends."""
MEMORY = 6000
"""Points of walked curves that are remembered."""


class Walked(NamedTuple):
    """Curves walked so far: points (MEMORY, 2 n + 1) with tangent and step, and how many are in use (1,)."""

    points: Array
    used: Array


@inner
def _offset(arm: Arm, k: int, difference: float) -> float:
    """A joint's difference modulo whole turns."""
    if arm.frames[k + 1, 12] == 0.0:
        return difference - TURN * math.floor(difference / TURN + 0.5)
    return difference


@inner
def was_walked(arm: Arm, walked: Walked, q: Array, width: float) -> bool:
    """Whether q (n,) lies within `width` of a curve in the memory."""
    n = q.shape[0]
    for i in range(int(walked.used[0])):
        length = walked.points[i, 2 * n] + width
        along, square = 0.0, 0.0
        for k in range(n):
            d = _offset(arm, k, q[k] - walked.points[i, k])
            along += d * walked.points[i, n + k]
            square += d * d
            if square > length * length + width * width:
                break
        else:
            if -width <= along <= length and square - along * along <= width * width:
                return True
    return False


@inner
def remember(walked: Walked, q: Array, tangent: Array, step: float) -> None:
    """Add a point, its tangent (n,) and the step taken from it to the memory (as long as there is room)."""
    i, n = int(walked.used[0]), q.shape[0]
    if i < walked.points.shape[0]:
        for k in range(n):
            walked.points[i, k], walked.points[i, n + k] = q[k], tangent[k]
        walked.points[i, 2 * n] = step
        walked.used[0] += 1


@inner
def _tangent(work: Work, tangent: Array) -> bool:
    """Project `tangent` (n,) on the null space of work.J, given its factored Gram matrix in work.A; unit length."""
    n = tangent.shape[0]
    for r in range(6):
        work.y[r] = 0.0
        for k in range(n):
            work.y[r] += work.J[r, k] * tangent[k]
    solve6(work.A, work.y, work.y)
    square = 0.0
    for k in range(n):
        for r in range(6):
            tangent[k] -= work.J[r, k] * work.y[r]
        square += tangent[k] * tangent[k]
    if square < 1e-12:
        return False
    for k in range(n):
        tangent[k] /= math.sqrt(square)
    return True


@inner
def _correct(arm: Arm, target: Array, held: Array, q: Array, work: Work) -> float:
    """Up to three Newton steps back on the curve; frames, Jacobian and Gram factor are left in `work`.

    Joints with held (n,) not zero keep their values: their columns are struck out.
    """
    cost = HUGE
    for _ in range(4):
        forward(arm.frames, q, work.T)
        cost = pose_error(work.T, target, work.e)
        jacobian(arm.frames, work.T, work.J)
        for k in range(q.shape[0]):
            if held[k] != 0.0:
                for r in range(6):
                    work.J[r, k] = 0.0
        gram(work.J, 1e-9, work.A)
        if not factor6(work.A) or cost < 1e-8:
            break
        solve6(work.A, work.e, work.y)
        for k in range(q.shape[0]):
            for r in range(6):
                q[k] += work.J[r, k] * work.y[r]
    return cost


@inner
def _twist(arm: Arm, T: Array, tangent: Array, twist: Array) -> None:
    """Velocity fields (n + 1, 6) of the links: linear at the world's origin, and angular."""
    for r in range(6):
        twist[0, r] = 0.0
    for k in range(tangent.shape[0]):
        zx, zy, zz = tangent[k] * T[k + 1, 2], tangent[k] * T[k + 1, 5], tangent[k] * T[k + 1, 8]
        px, py, pz = T[k + 1, 9], T[k + 1, 10], T[k + 1, 11]
        for r in range(6):
            twist[k + 1, r] = twist[k, r]
        if arm.frames[k + 1, 12] == 0.0:
            twist[k + 1, 0] += py * zz - pz * zy
            twist[k + 1, 1] += pz * zx - px * zz
            twist[k + 1, 2] += px * zy - py * zx
            twist[k + 1, 3] += zx
            twist[k + 1, 4] += zy
            twist[k + 1, 5] += zz
        else:
            twist[k + 1, 0] += zx
            twist[k + 1, 1] += zy
            twist[k + 1, 2] += zz


@inner
def _outside(arm: Arm, q: Array, tangent: Array) -> float:
    """Length of the walk over which some joint surely stays outside its limits, modulo whole turns."""
    longest = 0.0
    for k in range(q.shape[0]):
        half = 0.5 * (arm.bounds[1, k] - arm.bounds[0, k])
        if arm.bounds[2, k] == 0.0:
            away = abs(_offset(arm, k, q[k] - arm.bounds[0, k] - half)) - half
            longest = max(longest, away / max(abs(tangent[k]), 1e-3))
    return longest


@inner
def unwind(arm: Arm, q: Array, out: Array) -> None:
    """q by whole turns as near the middle of the limits as can be, into out (n,)."""
    for k in range(q.shape[0]):
        middle = 0.5 * (arm.bounds[0, k] + arm.bounds[1, k])
        out[k] = middle + _offset(arm, k, q[k] - middle)


@inner
def accept(
    arm: Arm, target: Array, world: World, enough: float, q: Array, out: Array, work: Work, contacts: Contacts
) -> float:
    """Polish q (n,) into `out` within the limits; returns its smallest gap less the wanted one, -1e3 without a pose."""
    n = q.shape[0]
    unwind(arm, q, out)
    for k in range(n):
        work.step[k] = 0.0
    move(out, work.step, 0.0, arm.bounds, out)
    if polish(arm, target, 1e-3 * enough, out, work) > enough * enough:
        return -1e3
    forward(arm.frames, out, work.T)
    return collect(world, work.T, world.required, world.required, contacts) - world.required


@inner
def walk(
    arm: Arm, target: Array, world: World, enough: float, skip: float, held: Array, q: Array, out: Array,
    walked: Walked, work: Work, contacts: Contacts, twist: Array,
) -> float:  # fmt: skip
    """Walk around the curve through q (n,), which is moved; returns the arc at which `out` (n,) is clear, or -1.

    Joints with held (n,) not zero stand still. Nothing is accepted before the arc `skip`, so that a walk can go on past
    a configuration that was refused.
    """
    n = q.shape[0]
    start, tangent, hint = q.copy(), np.zeros(n), np.full(2, -1.0)
    for k in range(n):
        tangent[k] = 0.0 if held[k] != 0.0 else 1.0 / (1.0 + k)
    if _correct(arm, target, held, q, work) > 1e-4 or not _tangent(work, tangent):
        return -1.0
    arc, sign = 0.0, 1.0
    first_tangent = tangent.copy()
    for _step in range(MOST_STEPS):
        stretch = _outside(arm, q, tangent)
        if stretch < LONGEST / CAUTION:
            _twist(arm, work.T, tangent, twist)
            stretch = max(stretch, idle_stretch(world, work.T, twist, SPARE, hint))
        if (
            stretch <= 0.0
            and arc >= skip
            and accept(arm, target, world, enough, q, out, work, contacts) >= 0.0
        ):
            return arc
        step = min(max(CAUTION * stretch, SHORTEST), LONGEST)
        if arc < skip:
            step = min(step, 0.03)
        remember(walked, q, tangent, step)
        for k in range(n):
            q[k] += step * tangent[k]
        if _correct(arm, target, held, q, work) > 1e-4 or not _tangent(work, tangent):
            if sign < 0:
                break
            sign = -1.0
            for k in range(n):
                q[k], tangent[k] = start[k], -first_tangent[k]
            _correct(arm, target, held, q, work)
            continue
        arc += step
        if arc > MOST_ARC:
            break
        if arc > 0.3:
            near = 0.0
            for k in range(n):
                near += _offset(arm, k, q[k] - start[k]) ** 2
            if near < step * step:
                break
    return -1.0
