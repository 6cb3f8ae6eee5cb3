"""Greedy orientation-aware coordinate descent, after HJCD-IK's first phase: the start of every restart.

Section IV, Eqs. 8-11 of HJCD-IK (see `workcell.ik.hjcd.solver`), with the best turn for rotation in place of Eq. 11 and
without random updates; the phase as published is `greedy`.
"""

from __future__ import annotations

import math

from workcell.jit import inner
from workcell.kernels.chain import Arm, forward
from workcell.kernels.constants import ROTATION_WEIGHT
from workcell.kernels.pose_error import pose_error
from workcell.pose import Array


@inner
def _best_turns(arm: Arm, T: Array, target: Array, e: Array, q: Array, moves: Array) -> None:
    """The joint whose motion leaves the smallest position error, and the one for the smallest rotation error.

    Into moves (4,): joint and motion for position, joint and motion for rotation; joint -1 where none helps.
    Position, revolute: with u and v from the joint to tool and target, the squared error after a turn t is
    |u|^2 + |v|^2 - 2 (axial + flat cos t + cross sin t) (Eqs. 8-9). Rotation: the scalar part of the error
    quaternion (w, r) becomes w cos(t/2) + r.z sin(t/2), largest at t = 2 atan2(r.z, w).
    """
    n = q.shape[0]
    square = e[0] * e[0] + e[1] * e[1] + e[2] * e[2]
    angle = math.sqrt(e[3] * e[3] + e[4] * e[4] + e[5] * e[5]) / ROTATION_WEIGHT
    w = math.cos(0.5 * angle)
    scale = math.sin(0.5 * angle) / max(ROTATION_WEIGHT * angle, 1e-12)
    moves[0], moves[2] = -1.0, -1.0
    nearest, straightest = square * (1 - 1e-6), w + 1e-9
    for k in range(n):
        zx, zy, zz = T[k + 1, 2], T[k + 1, 5], T[k + 1, 8]
        lower, upper = arm.bounds[0, k] - q[k], arm.bounds[1, k] - q[k]
        if arm.frames[k + 1, 12] != 0.0:
            t = min(max(zx * e[0] + zy * e[1] + zz * e[2], lower), upper)
            left = square - 2 * t * (zx * e[0] + zy * e[1] + zz * e[2]) + t * t
            if left < nearest:
                nearest, moves[0], moves[1] = left, float(k), t
            continue
        ux, uy, uz = T[n + 1, 9] - T[k + 1, 9], T[n + 1, 10] - T[k + 1, 10], T[n + 1, 11] - T[k + 1, 11]
        vx, vy, vz = ux + e[0], uy + e[1], uz + e[2]
        along_u, along_v = zx * ux + zy * uy + zz * uz, zx * vx + zy * vy + zz * vz
        flat = ux * vx + uy * vy + uz * vz - along_u * along_v
        cross = zx * (uy * vz - uz * vy) + zy * (uz * vx - ux * vz) + zz * (ux * vy - uy * vx)
        t = min(max(math.atan2(cross, flat), lower), upper)
        left = square + 2 * (flat - flat * math.cos(t) - cross * math.sin(t))
        if left < nearest:
            nearest, moves[0], moves[1] = left, float(k), t
        r = scale * (zx * e[3] + zy * e[4] + zz * e[5])
        t = min(max(2 * math.atan2(r, w), lower), upper)
        cosine = abs(w * math.cos(0.5 * t) + r * math.sin(0.5 * t))
        if cosine > straightest:
            straightest, moves[2], moves[3] = cosine, float(k), t


@inner
def descend(arm: Arm, target: Array, sweeps: int, q: Array, T: Array, e: Array, moves: Array) -> float:
    """Up to `sweeps` greedy updates of q in place; returns the squared residual reached.

    Each applies the best positional and the best orientational motion; on the same joint, the larger one.
    """
    forward(arm.frames, q, T)
    cost = pose_error(T, target, e)
    for sweep in range(sweeps):
        _best_turns(arm, T, target, e, q, moves)
        if moves[0] < 0 and moves[2] < 0:
            break
        anneal = 0.75 + 0.25 * (1.0 - sweep / sweeps)
        if moves[0] == moves[2]:
            k = int(moves[0])
            q[k] += moves[1] if abs(moves[1]) >= abs(moves[3]) else anneal * moves[3]
        else:
            if moves[0] >= 0:
                q[int(moves[0])] += moves[1]
            if moves[2] >= 0:
                q[int(moves[2])] += anneal * moves[3]
        forward(arm.frames, q, T)
        cost = pose_error(T, target, e)
    return cost
