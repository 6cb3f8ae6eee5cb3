"""Fast local tracking of a tool path, from waypoint to waypoint by small programs.

See `workcell.motion.tool_paths.tracker`.
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np

from workcell.jit import inner, kernel
from workcell.kernels.chain import Arm
from workcell.kernels.constants import HUGE
from workcell.kernels.coupling import Couple
from workcell.kernels.null_space_qp import LOOK_AHEAD
from workcell.kernels.structures import World
from workcell.motion.tool_paths.kernels.coordinates import (
    Room,
    contact_rates,
    coordinates,
    look,
    new_room,
    rates,
    stand,
)
from workcell.motion.tool_paths.kernels.program import equalities, program
from workcell.pose import Array

REACHED, UNREACHED, TOUCHING = 0, 1, 2
"""At the target and clear; not at the target; at the target but too near to something."""
ITERATIONS = 16
"""Programs from one waypoint to the next."""


class Aside(NamedTuple):
    """What the arm does beside the path, in the motions that leave the tool where it is.

    Attributes:
        limits, singularities, obstacles: gains of the gradients (radians) away from each.
        distance: metres of clearance below which an obstacle repels.
        longest: radians that one waypoint may add to the motion that the path needs, at most.
    """

    limits: float
    singularities: float
    obstacles: float
    distance: float
    longest: float


@inner
def volume(arm: Arm, target: Array, box: Array, q: Array, space: Room) -> float:
    """Logarithm of the manipulability of the coordinates without tolerance at q (n,): of sqrt(det(J J^T))."""
    work = space.work
    stand(arm, q, space)
    coordinates(work.T, target, box[6] != 0.0, space.x, space.turn)
    rates(arm, target, box[6] != 0.0, space)
    if not equalities(box, space):
        return -50.0
    total = 0.0
    for r in range(6):
        total -= math.log(work.A[r, r])
    return total


@inner
def _wish(
    arm: Arm,
    world: World,
    target: Array,
    box: Array,
    aside: Aside,
    allowed: float,
    q: Array,
    space: Room,
) -> None:
    """What the arm would like to do beside the path at q (n,), at most `allowed` rad in any joint; to space.wish."""
    n, wish = q.shape[0], space.wish
    for k in range(n):
        half = 0.5 * (arm.bounds[1, k] - arm.bounds[0, k])
        u = (q[k] - 0.5 * (arm.bounds[1, k] + arm.bounds[0, k])) / max(half, 1e-9)
        space.wish[k] = -aside.limits * u * u * u / max(1.0 - u * u, 0.02)
    if aside.obstacles > 0.0:
        look(arm, world, target, box, world.required + aside.distance, q, space)
        for c in range(int(space.contacts.used[0])):
            contact_rates(arm, c, space)
            short = 1.0 - (space.contacts.rows[c, 0] - world.required) / aside.distance
            for k in range(n):
                wish[k] += aside.obstacles * short * space.work.column[k]
    if aside.singularities > 0.0:
        here = volume(arm, target, box, q, space)
        for k in range(n):
            space.trial[k] = q[k]
        for k in range(n):
            space.trial[k] += 1e-4
            wish[k] += aside.singularities * (volume(arm, target, box, space.trial, space) - here) / 1e-4
            space.trial[k] = q[k]
    longest = 1e-12
    for k in range(n):
        longest = max(longest, abs(wish[k]))
    for k in range(n):
        wish[k] *= min(1.0, allowed / longest)


@inner
def _settle(
    arm: Arm,
    world: World,
    target: Array,
    box: Array,
    low: Array,
    high: Array,
    accuracy: float,
    q: Array,
    space: Room,
) -> tuple[int, float, float]:
    """Programs from q (n,), in place, until the tool is at its target and all clear; code, error and clearance."""
    n = q.shape[0]
    work = space.work
    error, gap = HUGE, -HUGE
    wished = 0.0
    for k in range(n):
        wished = max(wished, abs(space.wish[k]))
    for _iteration in range(ITERATIONS):
        error, gap = look(arm, world, target, box, world.required + LOOK_AHEAD, q, space)
        if error <= accuracy and gap >= world.required and wished < 1e-9:
            return REACHED, error, gap
        wished = 0.0
        if not program(arm, world, target, box, low, high, space.wish, q, space):
            break
        longest = 0.0
        for k in range(n):
            space.wish[k] = 0.0
            moved = min(max(q[k] + work.step[k], low[k]), high[k]) - q[k]
            longest = max(longest, abs(moved))
            q[k] += moved
        if longest < 1e-12:
            break
    error, gap = look(arm, world, target, box, world.required + LOOK_AHEAD, q, space)
    if error > accuracy:
        return UNREACHED, error, gap
    return (REACHED if gap >= world.required else TOUCHING), error, gap


@kernel
def track(
    arm: Arm, couple: Couple, world: World, targets: Array, box: Array, max_step: Array, accuracy: float, aside: Aside,
    start: Array, out: Array, report: Array
) -> int:  # fmt: skip
    """From `start` (n,) through the targets (k, 12), each within `max_step` (n,) of the one before.

    Args:
        arm, couple: frames of the m joints, bounds of the n variables, how those follow from these (empty: n = m).
        targets: frames of the tool in the world: rotation (9, row-major), position (3).
        box: (7,) tolerance of each coordinate (0: none, inf: free), and 1 where it is in the target's axes, else 0.
        accuracy: metres of error that count as none; a radian weighs `ROTATION_WEIGHT`.
        out: (k, n) configurations; report: (k, 3) code, error and clearance (metres) of each target tried.

    Returns:
        how many targets were reached; the next one's row of `out` has the best that was found.
    """
    n = start.shape[0]
    space = new_room(arm, couple)
    low, high, q = np.empty(n), np.empty(n), np.empty(n)
    for i in range(targets.shape[0]):
        for k in range(n):
            before = start[k] if i == 0 else out[i - 1, k]
            q[k] = before
            low[k] = max(arm.bounds[0, k], before - max_step[k])
            high[k] = min(arm.bounds[1, k], before + max_step[k])
        _wish(arm, world, targets[i], box, aside, aside.longest, q, space)
        code, error, gap = _settle(arm, world, targets[i], box, low, high, accuracy, q, space)
        report[i, 0], report[i, 1], report[i, 2] = float(code), error, gap
        for k in range(n):
            out[i, k] = q[k]
        if code != REACHED:
            return i
    return int(targets.shape[0])


@kernel
def move(
    arm: Arm, couple: Couple, world: World, target: Array, box: Array, max_step: Array, accuracy: float, starts: Array,
    wishes: Array, out: Array, report: Array
) -> None:  # fmt: skip
    """From each of the starts (k, n) to one target (12,), with the part of a wish (k, n) that leaves the tool there.

    Args:
        arm, couple, target, box, max_step, accuracy: as of `track`.
        out: (k, n) configurations; report: (k, 2) code and clearance (metres).
    """
    n = starts.shape[1]
    space = new_room(arm, couple)
    low, high = np.empty(n), np.empty(n)
    for i in range(starts.shape[0]):
        q = out[i]
        for k in range(n):
            q[k] = starts[i, k]
            low[k] = max(arm.bounds[0, k], q[k] - max_step[k])
            high[k] = min(arm.bounds[1, k], q[k] + max_step[k])
            space.wish[k] = wishes[i, k]
        code, _, gap = _settle(arm, world, target, box, low, high, accuracy, q, space)
        report[i, 0], report[i, 1] = float(code), gap


@kernel
def volumes(arm: Arm, couple: Couple, targets: Array, box: Array, q: Array, out: Array) -> None:
    """Into out (k,): manipulability of the coordinates without tolerance at each q (k, n) and its target (k, 12)."""
    space = new_room(arm, couple)
    for i in range(q.shape[0]):
        out[i] = math.exp(volume(arm, targets[i], box, q[i], space))
