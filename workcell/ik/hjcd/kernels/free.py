"""Kinematics alone: restart until solved, for one or many targets; descent and polish of each row of a batch."""

from __future__ import annotations

import numpy as np

from workcell.ik.hjcd.kernels.descent import descend
from workcell.ik.hjcd.kernels.newton import polish
from workcell.jit import inner, kernel
from workcell.kernels.chain import Arm, forward
from workcell.kernels.constants import HUGE
from workcell.kernels.pose_error import pose_error, read_target, seed
from workcell.kernels.random import RandomState
from workcell.kernels.structures import Work, scratch
from workcell.pose import Array

SEEDS = 4
"""Uniform configurations from which a restart takes the best."""
SWEEPS = 2
"""Coordinate-descent updates before the polish."""


@inner
def restart(
    arm: Arm, target: Array, accuracy: float, random: RandomState, q: Array, moves: Array, work: Work
) -> float:
    """One seed, descended and polished, into q; returns the squared residual reached."""
    seed(arm, target, random, SEEDS, q, work.trial, work.T, work.e)
    descend(arm, target, SWEEPS, q, work.T, work.e, moves)
    return polish(arm, target, accuracy, q, work)


@kernel
def solve_targets(
    arm: Arm,
    poses: Array,
    first: Array,
    accuracy: float,
    restarts: int,
    random: RandomState,
    q: Array,
    cost: Array,
) -> int:
    """Solve every target poses (k, 7: position, quaternion wxyz) into q (k, n), squared residuals into cost (k,).

    A target begins from the same row of `first` (k or fewer rows, n) where there is one, and stops at the first
    solution or after `restarts`; the best found stays. Returns the restarts done.
    """
    n, done = q.shape[1], 0
    work, target, moves, trial = scratch(n), np.empty(12), np.empty(4), np.empty(n)
    for i in range(poses.shape[0]):
        read_target(poses[i], target)
        cost[i] = HUGE
        for attempt in range(restarts):
            if attempt == 0 and i < first.shape[0]:
                for k in range(n):
                    trial[k] = first[i, k]
                reached = polish(arm, target, accuracy, trial, work)
            else:
                reached = restart(arm, target, accuracy, random, trial, moves, work)
            done += 1
            if reached < cost[i]:
                cost[i] = reached
                for k in range(n):
                    q[i, k] = trial[k]
            if reached < accuracy * accuracy:
                break
    return done


@kernel
def descend_batch(arm: Arm, pose: Array, seeds: Array, sweeps: int, coarse: float, cost: Array) -> int:
    """Descend seeds (b, n), the nearest first, in place, with the squared residuals left in cost (b,).

    Stops when one seed's residual is below `coarse` (metres); returns how many seeds were worked on.
    """
    n = seeds.shape[1]
    T, e, moves, target = np.empty((n + 2, 12)), np.empty(6), np.empty(4), np.empty(12)
    read_target(pose, target)
    for i in range(seeds.shape[0]):
        forward(arm.frames, seeds[i], T)
        cost[i] = pose_error(T, target, e)
    worked = 0
    for i in np.argsort(cost):
        cost[i] = descend(arm, target, sweeps, seeds[i], T, e, moves)
        worked += 1
        if cost[i] < coarse * coarse:
            break
    return worked


@kernel
def polish_batch(arm: Arm, pose: Array, accuracy: float, q: Array, cost: Array) -> None:
    """Polish each of q (b, n), in place, with the squared residuals left in cost (b,)."""
    work, target = scratch(q.shape[1]), np.empty(12)
    read_target(pose, target)
    for i in range(q.shape[0]):
        cost[i] = polish(arm, target, accuracy, q[i], work)
