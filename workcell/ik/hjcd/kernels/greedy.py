"""PO-CCD, HJCD-IK's first phase as published: the best joint for position and the best for rotation, or a kick.

Sections III and IV-A, Eqs. 8-11 and Alg. 3 of HJCD-IK (see `workcell.ik.hjcd.solver`). The paper leaves its numbers
open; these are its authors' code's, but for what their code does with rotations, where the paper is followed.
"""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from workcell.jit import inner, kernel
from workcell.kernels.chain import Arm, forward
from workcell.kernels.constants import HUGE, ROTATION_WEIGHT
from workcell.kernels.pose_error import pose_error, read_target
from workcell.kernels.random import RandomState, uniform
from workcell.pose import Array

SWEEPS = 20
"""Updates of a seed at most."""
LEAST = 1e-5
"""Metres, or radians, by which an update must lower an error."""
COARSE_POSITION, COARSE_ROTATION = 0.02, 0.5 * math.pi
"""Metres and radians: once a seed is within both, phase one ends for all seeds."""
KICK = 0.05
"""Share of its range by which a joint is moved at most where no update helps."""
_TINY = 1e-9


@inner
def _positional(arm: Arm, T: Array, e: Array, q: Array, k: int) -> tuple[float, float]:
    """Joint k's motion toward the target's position (Eqs. 8-9), within its limits, and the error it leaves, metres."""
    n = q.shape[0]
    zx, zy, zz = T[k + 1, 2], T[k + 1, 5], T[k + 1, 8]
    lower, upper = arm.bounds[0, k] - q[k], arm.bounds[1, k] - q[k]
    square = e[0] * e[0] + e[1] * e[1] + e[2] * e[2]
    if arm.frames[k + 1, 12] != 0.0:
        along = zx * e[0] + zy * e[1] + zz * e[2]
        t = min(max(along, lower), upper)
        return t, math.sqrt(max(square - 2 * t * along + t * t, 0.0))
    ux, uy, uz = T[n + 1, 9] - T[k + 1, 9], T[n + 1, 10] - T[k + 1, 10], T[n + 1, 11] - T[k + 1, 11]
    vx, vy, vz = ux + e[0], uy + e[1], uz + e[2]
    along_u, along_v = zx * ux + zy * uy + zz * uz, zx * vx + zy * vy + zz * vz
    flat = ux * vx + uy * vy + uz * vz - along_u * along_v
    cross = zx * (uy * vz - uz * vy) + zy * (uz * vx - ux * vz) + zz * (ux * vy - uy * vx)
    if math.sqrt(flat * flat + cross * cross) < _TINY:
        return 0.0, HUGE
    t = min(max(math.atan2(cross, flat), lower), upper)
    return t, math.sqrt(max(square + 2 * (flat - flat * math.cos(t) - cross * math.sin(t)), 0.0))


@inner
def _orientational(arm: Arm, T: Array, e: Array, q: Array, k: int, anneal: float) -> tuple[float, float]:
    """Joint k's share of the rotation that is missing (Eq. 11), within its limits, and the angle it leaves, radians."""
    if arm.frames[k + 1, 12] != 0.0:
        return 0.0, HUGE
    zx, zy, zz = T[k + 1, 2], T[k + 1, 5], T[k + 1, 8]
    about = (zx * e[3] + zy * e[4] + zz * e[5]) / ROTATION_WEIGHT
    t = min(max(anneal * about, arm.bounds[0, k] - q[k]), arm.bounds[1, k] - q[k])
    angle = math.sqrt(e[3] * e[3] + e[4] * e[4] + e[5] * e[5]) / ROTATION_WEIGHT
    # of two turns after each other: the scalar part of the product of their quaternions
    share = math.sin(0.5 * angle) * about / max(angle, _TINY)
    scalar = math.cos(0.5 * angle) * math.cos(0.5 * t) + share * math.sin(0.5 * t)
    return t, 2.0 * math.acos(min(abs(scalar), 1.0))


@inner
def _update(arm: Arm, T: Array, e: Array, q: Array, anneal: float, before: Array, out: Array) -> bool:
    """The best positional and the best orientational motion of q, into out (n,); False where neither helps.

    On the same joint, the larger motion. `before` (2,) are the errors at q.
    """
    n = q.shape[0]
    nearest, straightest = before[0] - LEAST, before[1] - LEAST
    one, other, move, turn = -1, -1, 0.0, 0.0
    for k in range(n):
        out[k] = q[k]
        t, left = _positional(arm, T, e, q, k)
        if left < nearest:
            nearest, one, move = left, k, t
        t, left = _orientational(arm, T, e, q, k, anneal)
        if left < straightest:
            straightest, other, turn = left, k, t
    if one >= 0 and one == other:
        out[one] += move if abs(move) >= abs(turn) else turn
        return True
    if one >= 0:
        out[one] += move
    if other >= 0:
        out[other] += turn
    return one >= 0 or other >= 0


@inner
def kick(arm: Arm, random: RandomState, share: float, q: Array, out: Array) -> None:
    """q (n,) with every joint moved by up to `share` of its range, evenly, within the limits."""
    for k in range(q.shape[0]):
        lower, upper = arm.bounds[0, k], arm.bounds[1, k]
        out[k] = min(max(q[k] + share * (upper - lower) * (2.0 * uniform(random) - 1.0), lower), upper)


@inner
def _errors(T: Array, target: Array, e: Array, errors: Array) -> None:
    """Residual e (6,), and metres and radians of it into errors (2,)."""
    pose_error(T, target, e)
    errors[0] = math.sqrt(e[0] * e[0] + e[1] * e[1] + e[2] * e[2])
    errors[1] = math.sqrt(e[3] * e[3] + e[4] * e[4] + e[5] * e[5]) / ROTATION_WEIGHT


@kernel
def sweep_seeds(
    arm: Arm, pose: Array, first: int, last: int, random: NDArray[np.uint64], seeds: Array, errors: Array
) -> int:
    """Updates first to last - 1 of phase one, of every seed (b, n) in place, metres and radians into errors (b, 2).

    An update that lowers neither error by `LEAST` is exchanged for a kick from `random` (b, 1). Ends after the sweep in
    which a seed came within the coarse tolerance; returns how many were made.
    """
    n = seeds.shape[1]
    T, e, target = np.empty((n + 2, 12)), np.empty(6), np.empty(12)
    trial, after, met = np.empty(n), np.empty(2), False
    read_target(pose, target)
    for sweep in range(first, last):
        anneal = 0.75 + 0.25 * (1.0 - sweep / SWEEPS)
        for i in range(seeds.shape[0]):
            forward(arm.frames, seeds[i], T)
            _errors(T, target, e, errors[i])
            helps = _update(arm, T, e, seeds[i], anneal, errors[i], trial)
            if helps:
                forward(arm.frames, trial, T)
                _errors(T, target, e, after)
                helps = after[0] < errors[i, 0] - LEAST or after[1] < errors[i, 1] - LEAST
            if not helps:
                kick(arm, random[i], KICK, seeds[i], trial)
                forward(arm.frames, trial, T)
                _errors(T, target, e, after)
            for k in range(n):
                seeds[i, k] = trial[k]
            errors[i, 0], errors[i, 1] = after[0], after[1]
            met = met or (after[0] < COARSE_POSITION and after[1] < COARSE_ROTATION)
        if met:
            return sweep + 1 - first
    return last - first
