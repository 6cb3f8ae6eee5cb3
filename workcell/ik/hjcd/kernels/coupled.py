"""The search for robots whose joints follow others: Levenberg-Marquardt in the variables, from random ones.

First on the pose alone; what reaches it and collides is moved on with a hinge on penetration. Closed forms for single
joints and self-motion curves, which the search of other robots rests on, don't hold where several joints move as one.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from workcell.ik.hjcd.kernels.search import (
    BEST,
    FOUND,
    POSES,
    RESTARTS,
    SLID,
    SPENT,
    STARTED,
    Memory,
    note_miss,
)
from workcell.jit import inner, kernel
from workcell.kernels.chain import Arm, forward
from workcell.kernels.cholesky import factor, solve
from workcell.kernels.constants import HUGE
from workcell.kernels.contacts import Contacts, collect, contact_row, room
from workcell.kernels.coupling import Couple, follow, gather
from workcell.kernels.pose_error import draw, jacobian, move, pose_error, read_target
from workcell.kernels.structures import Work, World, scratch
from workcell.pose import Array

SEEDS = 4
"""Uniform configurations from which a restart takes the best."""
ITERATIONS, SLIDES = 40, 30
"""Steps on the pose alone, and then with obstacles."""
HINGE_MARGIN = 3e-4
"""Metres beyond the wanted clearance at which the hinge begins, so that a solution is not left on the edge."""
DEEPEST = 0.06
"""Metres of penetration from which sliding is tried."""
_ROUND, _PROGRESS = 6, 0.3
"""Steps after which the cost must have fallen to this share, or the descent gives up."""
_LONGEST = 0.7
"""Radians (metres) that a variable may move in one step."""


class _Room(NamedTuple):
    """Scratch: joints and slopes (m,), a row by joints (m,); H (n, n), gradient, step, trial, row by variables (n,)."""

    q: Array
    slope: Array
    by_joint: Array
    H: Array
    gradient: Array
    step: Array
    trial: Array
    row: Array


@inner
def _measure(
    arm: Arm, couple: Couple, target: Array, world: World, v: Array, hinged: bool, work: Work, own: _Room,
    contacts: Contacts,
) -> tuple[float, float]:  # fmt: skip
    """Sum of squared residuals at v (n,), and the smallest gap less the wanted one (0 where it isn't asked for)."""
    follow(couple, v, own.q, own.slope)
    forward(arm.frames, own.q, work.T)
    cost = pose_error(work.T, target, work.e)
    if not hinged:
        return cost, 0.0
    wanted = world.required + HINGE_MARGIN
    gap = collect(world, work.T, wanted, -HUGE, contacts)
    for c in range(int(contacts.used[0])):
        cost += (wanted - contacts.rows[c, 0]) ** 2
    return cost, gap - world.required


@inner
def _add_row(own: _Room, couple: Couple, residual: float) -> None:
    """Add a residual, whose derivatives by joints are in own.by_joint, to the normal equations."""
    gather(couple, own.slope, own.by_joint, own.row)
    for a in range(own.row.shape[0]):
        own.gradient[a] += own.row[a] * residual
        for b in range(a + 1):
            own.H[a, b] += own.row[a] * own.row[b]


@inner
def _normal_equations(
    arm: Arm, couple: Couple, world: World, hinged: bool, work: Work, own: _Room, contacts: Contacts
) -> None:
    own.H[:] = 0.0
    own.gradient[:] = 0.0
    jacobian(arm.frames, work.T, work.J)
    for r in range(6):
        for k in range(own.q.shape[0]):
            own.by_joint[k] = work.J[r, k]
        _add_row(own, couple, work.e[r])
    if hinged:
        for c in range(int(contacts.used[0])):
            contact_row(arm.frames, work.T, contacts.rows, c, own.by_joint)
            _add_row(own, couple, world.required + HINGE_MARGIN - contacts.rows[c, 0])


@inner
def _damped_step(v: Array, bounds: Array, damping: float, own: _Room) -> bool:
    """Into own.step; variables that are pushed out of their limits stand still. The diagonal of own.H is changed."""
    n = v.shape[0]
    for k in range(n):
        g = own.gradient[k]
        own.step[k] = g
        own.H[k, k] += damping
        if bounds[2, k] == 0.0 and ((v[k] >= bounds[1, k] and g > 0) or (v[k] <= bounds[0, k] and g < 0)):
            own.step[k] = 0.0
            for j in range(k):
                own.H[k, j] = 0.0
            for j in range(k + 1, n):
                own.H[j, k] = 0.0
            own.H[k, k] = 1.0
    if not factor(own.H):
        return False
    solve(own.H, own.step)
    return True


@inner
def _descend(
    arm: Arm, couple: Couple, target: Array, world: World, hinged: bool, iterations: int, accuracy: float,
    v: Array, work: Work, own: _Room, contacts: Contacts,
) -> tuple[float, float]:  # fmt: skip
    """Move v (n,) in place until the pose is reached (and, hinged, clear); (squared pose residual, gap)."""
    n = v.shape[0]
    cost, gap = _measure(arm, couple, target, world, v, hinged, work, own, contacts)
    damping, last = 0.01, cost
    for iteration in range(iterations):
        pose = 0.0
        for r in range(6):
            pose += work.e[r] * work.e[r]
        if pose < accuracy * accuracy and (not hinged or gap >= 0.3 * HINGE_MARGIN):
            return pose, gap
        if iteration % _ROUND == _ROUND - 1:
            if cost > _PROGRESS * last:
                return pose, gap
            last = cost
        trial, trial_gap = HUGE, gap
        for _attempt in range(5):
            _normal_equations(arm, couple, world, hinged, work, own, contacts)
            if not _damped_step(v, arm.bounds, damping * cost + 1e-13, own):
                return pose, gap
            longest = 0.0
            for k in range(n):
                longest = max(longest, abs(own.step[k]))
            move(v, own.step, min(1.0, _LONGEST / max(longest, 1e-300)), arm.bounds, own.trial)
            trial, trial_gap = _measure(arm, couple, target, world, own.trial, hinged, work, own, contacts)
            if trial < cost:
                break
            damping = min(8.0 * damping + 1e-4, 1e6)
            _measure(arm, couple, target, world, v, hinged, work, own, contacts)
        if not trial < cost:
            return pose, gap
        damping = max(0.2 * damping, 1e-6)
        cost, gap = trial, trial_gap
        for k in range(n):
            v[k] = own.trial[k]
    pose = 0.0
    for r in range(6):
        pose += work.e[r] * work.e[r]
    return pose, gap


@inner
def _start(
    arm: Arm, couple: Couple, target: Array, world: World, first: Array, memory: Memory, v: Array, work: Work,
    own: _Room, contacts: Contacts,
) -> None:  # fmt: skip
    """The next given start, or the best by pose error of some uniform ones, into v (n,)."""
    counts, n = memory.counts, v.shape[0]
    if counts[STARTED] < first.shape[0]:
        for k in range(n):
            v[k] = first[int(counts[STARTED]), k]
        counts[STARTED] += 1
        return
    best = HUGE
    for _ in range(SEEDS):
        draw(arm, memory.random, own.trial)
        cost, _gap = _measure(arm, couple, target, world, own.trial, False, work, own, contacts)
        if cost < best:
            best = cost
            for k in range(n):
                v[k] = own.trial[k]


@kernel
def search_coupled(
    arm: Arm, couple: Couple, world: World, pose: Array, first: Array, accuracy: float, enough: float,
    restarts: int, memory: Memory, out: Array,
) -> int:  # fmt: skip
    """Up to `restarts` starts; FOUND with a clear configuration in out (n,), or SPENT.

    Args:
        arm: frames of the m joints, bounds of the n variables.
        couple: how the joints follow from the variables.
        world, pose, first, accuracy, enough, memory: as in `search.search`; q is of the variables.
    """
    n, m = out.shape[0], couple.variable.shape[0]
    work, contacts, target, v = scratch(m), room(), np.empty(12), np.empty(n)
    own = _Room(
        np.empty(m), np.empty(m), np.empty(m), np.empty((n, n)), np.empty(n), np.empty(n), np.empty(n), np.empty(n)
    )  # fmt: skip
    counts = memory.counts
    read_target(pose, target)
    for _restart in range(restarts):
        counts[RESTARTS] += 1
        _start(arm, couple, target, world, first, memory, v, work, own, contacts)
        reached, _gap = _descend(
            arm, couple, target, world, False, ITERATIONS, accuracy, v, work, own, contacts
        )
        counts[BEST] = min(counts[BEST], reached)
        if reached > enough * enough:
            continue
        counts[POSES] += 1
        for k in range(n):
            out[k] = v[k]
        _cost, gap = _measure(arm, couple, target, world, v, True, work, own, contacts)
        if gap >= 0.0:
            return FOUND
        note_miss(memory, world, v, contacts)
        if gap < -DEEPEST:
            continue
        counts[SLID] += 1
        reached, gap = _descend(arm, couple, target, world, True, SLIDES, accuracy, v, work, own, contacts)
        if reached <= enough * enough and gap >= 0.0:
            for k in range(n):
                out[k] = v[k]
            return FOUND
    return SPENT
