"""Pose error, Jacobian and steps of one serial chain.

A frame is a row of 12 numbers: rotation (row-major), then position, in the world.
"""

from __future__ import annotations

import math

from workcell.jit import inner
from workcell.kernels.chain import Arm, forward
from workcell.kernels.constants import HUGE, ROTATION_WEIGHT, TURN
from workcell.kernels.random import RandomState, uniform
from workcell.pose import Array


@inner
def read_target(pose: Array, target: Array) -> None:
    """Position and quaternion wxyz (7,) as a frame (12,)."""
    w, x, y, z = pose[3], pose[4], pose[5], pose[6]
    target[0], target[1], target[2] = 1 - 2 * (y * y + z * z), 2 * (x * y - w * z), 2 * (x * z + w * y)
    target[3], target[4], target[5] = 2 * (x * y + w * z), 1 - 2 * (x * x + z * z), 2 * (y * z - w * x)
    target[6], target[7], target[8] = 2 * (x * z - w * y), 2 * (y * z + w * x), 1 - 2 * (x * x + y * y)
    target[9], target[10], target[11] = pose[0], pose[1], pose[2]


@inner
def pose_error(T: Array, target: Array, e: Array) -> float:
    """Position error and weighted rotation vector from the tool to its target, into e (6,); returns its square."""
    i = T.shape[0] - 1
    D = (
        target[3] * T[i, 6] + target[4] * T[i, 7] + target[5] * T[i, 8],
        target[6] * T[i, 3] + target[7] * T[i, 4] + target[8] * T[i, 5],
        target[6] * T[i, 0] + target[7] * T[i, 1] + target[8] * T[i, 2],
        target[0] * T[i, 6] + target[1] * T[i, 7] + target[2] * T[i, 8],
        target[0] * T[i, 3] + target[1] * T[i, 4] + target[2] * T[i, 5],
        target[3] * T[i, 0] + target[4] * T[i, 1] + target[5] * T[i, 2],
    )
    xx = target[0] * T[i, 0] + target[1] * T[i, 1] + target[2] * T[i, 2]
    yy = target[3] * T[i, 3] + target[4] * T[i, 4] + target[5] * T[i, 5]
    zz = target[6] * T[i, 6] + target[7] * T[i, 7] + target[8] * T[i, 8]
    x, y, z = 0.5 * (D[1] - D[0]), 0.5 * (D[3] - D[2]), 0.5 * (D[5] - D[4])
    sine = math.sqrt(x * x + y * y + z * z)
    cosine = 0.5 * (xx + yy + zz - 1.0)
    if sine < 1e-6 and cosine < 0.0:
        # A half turn: the axis comes from the diagonal, any sign serves.
        x, y, z = math.sqrt(max(xx + 1, 0.0)), math.sqrt(max(yy + 1, 0.0)), math.sqrt(max(zz + 1, 0.0))
        if x >= y and x >= z:
            y, z = math.copysign(y, D[4] + D[5]), math.copysign(z, D[2] + D[3])
        elif y >= z:
            x, z = math.copysign(x, D[4] + D[5]), math.copysign(z, D[0] + D[1])
        else:
            x, y = math.copysign(x, D[2] + D[3]), math.copysign(y, D[0] + D[1])
        factor = ROTATION_WEIGHT * math.pi / math.sqrt(x * x + y * y + z * z)
    elif sine > 1e-9:
        factor = ROTATION_WEIGHT * math.atan2(sine, cosine) / sine
    else:
        factor = ROTATION_WEIGHT
    e[0], e[1], e[2] = target[9] - T[i, 9], target[10] - T[i, 10], target[11] - T[i, 11]
    e[3], e[4], e[5] = factor * x, factor * y, factor * z
    cost: float = e[0] * e[0] + e[1] * e[1] + e[2] * e[2] + e[3] * e[3] + e[4] * e[4] + e[5] * e[5]
    return cost


@inner
def jacobian(frames: Array, T: Array, J: Array) -> None:
    """Geometric Jacobian (6, n) of the tool, its rotation rows weighted like the residual's."""
    n = J.shape[1]
    x, y, z = T[n + 1, 9], T[n + 1, 10], T[n + 1, 11]
    for k in range(n):
        zx, zy, zz = T[k + 1, 2], T[k + 1, 5], T[k + 1, 8]
        if frames[k + 1, 12] == 0.0:
            rx, ry, rz = x - T[k + 1, 9], y - T[k + 1, 10], z - T[k + 1, 11]
            J[0, k], J[1, k], J[2, k] = zy * rz - zz * ry, zz * rx - zx * rz, zx * ry - zy * rx
            J[3, k], J[4, k], J[5, k] = ROTATION_WEIGHT * zx, ROTATION_WEIGHT * zy, ROTATION_WEIGHT * zz
        else:
            J[0, k], J[1, k], J[2, k] = zx, zy, zz
            J[3, k], J[4, k], J[5, k] = 0.0, 0.0, 0.0


@inner
def move(q: Array, step: Array, share: float, bounds: Array, out: Array) -> None:
    """q + share * step within the limits: by a whole turn where one fits, else clamped."""
    for k in range(q.shape[0]):
        value = q[k] + share * step[k]
        if bounds[2, k] != 0.0:
            if value > bounds[1, k]:
                value -= TURN * math.ceil((value - bounds[1, k]) / TURN)
            elif value < bounds[0, k]:
                value += TURN * math.ceil((bounds[0, k] - value) / TURN)
        out[k] = min(max(value, bounds[0, k]), bounds[1, k])


@inner
def draw(arm: Arm, random: RandomState, q: Array) -> None:
    """A configuration uniform in the limits, into q (n,)."""
    for k in range(q.shape[0]):
        q[k] = arm.bounds[0, k] + (arm.bounds[1, k] - arm.bounds[0, k]) * uniform(random)


@inner
def seed(
    arm: Arm, target: Array, random: RandomState, tries: int, q: Array, trial: Array, T: Array, e: Array
) -> None:
    """The best by pose error of `tries` uniform configurations, into q (n,)."""
    best = HUGE
    for _ in range(tries):
        draw(arm, random, trial)
        forward(arm.frames, trial, T)
        cost = pose_error(T, target, e)
        if cost < best:
            best = cost
            for k in range(q.shape[0]):
                q[k] = trial[k]
