"""Where a tool is from its pose on a path, axis by axis, and what is near the robot there."""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np

from workcell.jit import inner
from workcell.kernels.chain import Arm, forward
from workcell.kernels.constants import HUGE, ROTATION_WEIGHT
from workcell.kernels.contacts import MOST_CONTACTS, Contacts, collect, contact_row, room
from workcell.kernels.coupling import Couple, follow, gather
from workcell.kernels.pose_error import jacobian
from workcell.kernels.structures import Work, World, scratch
from workcell.pose import Array


class Room(NamedTuple):
    """Scratch: IK's own, the tool's coordinates and their rates, rows of the program, a wish and a trial (n,).

    Where joints follow variables: how they do (else empty), their values, slopes and a row by joints (m,), and the
    Jacobian by joints (6, m).
    """

    work: Work
    contacts: Contacts
    x: Array
    turn: Array
    rows: Array
    wish: Array
    trial: Array
    couple: Couple
    joints: Array
    slope: Array
    by_joint: Array
    J: Array


@inner
def new_room(arm: Arm, couple: Couple) -> Room:
    """Scratch for an arm of m joints and n variables."""
    n, m = arm.bounds.shape[1], arm.frames.shape[0] - 2
    rows = np.empty((MOST_CONTACTS + 12 + 2 * n, 2 * n + 3))
    vectors = np.empty(6), np.empty(9), rows, np.zeros(n), np.empty(n)
    own = scratch(n)
    work = Work(
        np.empty((m + 2, 12)), own.J, own.e, own.A, own.y, own.step, own.trial, own.gradient, own.newton, own.H,
        own.column,
    )  # fmt: skip
    return Room(work, room(), *vectors, couple, np.empty(m), np.empty(m), np.empty(m), np.empty((6, m)))


@inner
def stand(arm: Arm, q: Array, space: Room) -> None:
    """Frames at q (n,), into work.T."""
    if space.couple.variable.shape[0] == 0:
        forward(arm.frames, q, space.work.T)
    else:
        follow(space.couple, q, space.joints, space.slope)
        forward(arm.frames, space.joints, space.work.T)


@inner
def contact_rates(arm: Arm, c: int, space: Room) -> None:
    """Gradient of contact c's gap by the variables, into work.column (n,)."""
    work = space.work
    if space.couple.variable.shape[0] == 0:
        contact_row(arm.frames, work.T, space.contacts.rows, c, work.column)
    else:
        contact_row(arm.frames, work.T, space.contacts.rows, c, space.by_joint)
        gather(space.couple, space.slope, space.by_joint, work.column)


@inner
def coordinates(T: Array, target: Array, tool_axes: bool, x: Array, turn: Array) -> None:
    """The tool's coordinates from its target: position and rotation vector in the target's axes, or in the world's.

    Into x (6,); `turn` (9,) gets the matrix that makes rates of the rotation vector out of angular velocities in these
    axes: the inverse of the left Jacobian of SO(3), 1 - [v] / 2 + (1 - t / 2 cot(t / 2)) / t^2 [v]^2.
    """
    i = T.shape[0] - 1
    dx, dy, dz = T[i, 9] - target[9], T[i, 10] - target[10], T[i, 11] - target[11]
    D = np.empty((3, 3))
    for r in range(3):
        for c in range(3):
            D[r, c] = 0.0
            for k in range(3):
                if tool_axes:
                    D[r, c] += target[3 * k + r] * T[i, 3 * k + c]
                else:
                    D[r, c] += T[i, 3 * r + k] * target[3 * c + k]
    for r in range(3):
        if tool_axes:
            x[r] = target[r] * dx + target[3 + r] * dy + target[6 + r] * dz
    if not tool_axes:
        x[0], x[1], x[2] = dx, dy, dz
    a, b, c = 0.5 * (D[2, 1] - D[1, 2]), 0.5 * (D[0, 2] - D[2, 0]), 0.5 * (D[1, 0] - D[0, 1])
    sine = math.sqrt(a * a + b * b + c * c)
    angle = math.atan2(sine, 0.5 * (D[0, 0] + D[1, 1] + D[2, 2] - 1.0))
    factor = angle / sine if sine > 1e-9 else 1.0
    x[3], x[4], x[5] = factor * a, factor * b, factor * c
    half = 0.5 * angle
    bend = 1.0 / 12.0 if angle < 1e-3 else (1.0 - half * math.cos(half) / math.sin(half)) / (angle * angle)
    u, v, w = x[3], x[4], x[5]
    square = u * u + v * v + w * w
    turn[0], turn[4], turn[8] = (
        1 + bend * (u * u - square),
        1 + bend * (v * v - square),
        1 + bend * (w * w - square),
    )
    turn[1], turn[3] = bend * u * v + 0.5 * w, bend * u * v - 0.5 * w
    turn[2], turn[6] = bend * u * w - 0.5 * v, bend * u * w + 0.5 * v
    turn[5], turn[7] = bend * v * w + 0.5 * u, bend * v * w - 0.5 * u


@inner
def rates(arm: Arm, target: Array, tool_axes: bool, space: Room) -> None:
    """Rates of the coordinates, into work.J (6, n); rotations weighted by `ROTATION_WEIGHT`, as x will be."""
    work, turn = space.work, space.turn
    J = work.J
    if space.couple.variable.shape[0] == 0:
        jacobian(arm.frames, work.T, J)
    else:
        jacobian(arm.frames, work.T, space.J)
        for r in range(6):
            gather(space.couple, space.slope, space.J[r], J[r])
    for k in range(J.shape[1]):
        for part in range(2):
            a, b, c = J[3 * part, k], J[3 * part + 1, k], J[3 * part + 2, k]
            if tool_axes:
                a, b, c = (
                    target[0] * a + target[3] * b + target[6] * c,
                    target[1] * a + target[4] * b + target[7] * c,
                    target[2] * a + target[5] * b + target[8] * c,
                )
            if part == 1:
                a, b, c = (
                    turn[0] * a + turn[1] * b + turn[2] * c,
                    turn[3] * a + turn[4] * b + turn[5] * c,
                    turn[6] * a + turn[7] * b + turn[8] * c,
                )
            J[3 * part, k], J[3 * part + 1, k], J[3 * part + 2, k] = a, b, c


@inner
def look(
    arm: Arm, world: World, target: Array, box: Array, margin: float, q: Array, space: Room
) -> tuple[float, float]:
    """Frames, coordinates and contacts at q (n,); returns the error beyond the tolerance (metres) and the clearance."""
    work = space.work
    stand(arm, q, space)
    coordinates(work.T, target, box[6] != 0.0, space.x, space.turn)
    gap = collect(world, work.T, margin, -HUGE, space.contacts)
    square = 0.0
    for r in range(6):
        weight = 1.0 if r < 3 else ROTATION_WEIGHT
        over = weight * max(abs(space.x[r]) - box[r], 0.0)
        square += over * over
    return math.sqrt(square), gap
