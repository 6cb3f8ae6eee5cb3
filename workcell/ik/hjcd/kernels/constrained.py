"""Sequential quadratic programming: the smallest motion that reaches the pose and keeps every clearance."""

from __future__ import annotations

import math

import numpy as np

from workcell.ik.hjcd.kernels.newton import polish
from workcell.jit import inner, kernel
from workcell.kernels.chain import Arm, forward
from workcell.kernels.cholesky import factor6, gram, solve6
from workcell.kernels.constants import HUGE
from workcell.kernels.contacts import MOST_CONTACTS, Contacts, collect, contact_row, room
from workcell.kernels.null_space_qp import DEEPEST, LOOK_AHEAD, hildreth, project
from workcell.kernels.pose_error import jacobian, pose_error, read_target
from workcell.kernels.structures import Work, World, scratch
from workcell.pose import Array

WANTED = 3e-4
"""Metres beyond the required clearance that a step aims at."""
SWEEPS = 60
"""Passes over the constraints of one quadratic program."""
_LEAST = 1e-8
"""Square of a gradient's part in the null space from which its bound can be kept there."""


@inner
def _merit(arm: Arm, target: Array, world: World, q: Array, work: Work, contacts: Contacts) -> float:
    """Pose error plus the sum of the missing clearances, in metres; contacts within `LOOK_AHEAD` are collected."""
    forward(arm.frames, q, work.T)
    merit = math.sqrt(pose_error(work.T, target, work.e))
    collect(world, work.T, world.required + LOOK_AHEAD, -HUGE, contacts)
    for c in range(int(contacts.used[0])):
        merit += max(world.required + WANTED - contacts.rows[c, 0], 0.0)
    return merit


@inner
def _constraints(
    arm: Arm, world: World, q: Array, trust: float, work: Work, contacts: Contacts, rows: Array
) -> int:
    """Rows (m, 2 n + 3) of the program: gradient, its part in the null space, bound, square, multiplier.

    The smallest motion onto the pose (work.newton) is subtracted from the bounds; work.A holds the Gram factor.
    """
    n, m = q.shape[0], 0
    for c in range(int(contacts.used[0])):
        contact_row(arm.frames, work.T, contacts.rows, c, work.column)
        for k in range(n):
            rows[m, k] = work.column[k]
        rows[m, 2 * n] = min(world.required + WANTED - contacts.rows[c, 0], DEEPEST)
        m += 1
    for k in range(n):
        for side in range(2):
            room_left = abs(arm.bounds[side, k] - q[k])
            if room_left < trust and arm.bounds[2, k] == 0.0:
                for j in range(n):
                    rows[m, j] = 0.0
                rows[m, k] = 1.0 - 2.0 * side
                rows[m, 2 * n] = -room_left
                m += 1
    project(rows, m, work)
    return m


@inner
def _step(
    arm: Arm, world: World, q: Array, trust: float, work: Work, contacts: Contacts, rows: Array
) -> bool:
    """The solution of min |dq|^2, J dq = e, rows dq >= bounds, into work.step, by Hildreth's method on the dual."""
    n = q.shape[0]
    jacobian(arm.frames, work.T, work.J)
    gram(work.J, 1e-9, work.A)
    if not factor6(work.A):
        return False
    solve6(work.A, work.e, work.y)
    for k in range(n):
        work.newton[k] = 0.0
        for r in range(6):
            work.newton[k] += work.J[r, k] * work.y[r]
    m = _constraints(arm, world, q, trust, work, contacts, rows)
    hildreth(rows, m, SWEEPS, _LEAST, work.gradient)
    longest = 0.0
    for k in range(n):
        work.step[k] = work.newton[k] + work.gradient[k]
        longest = max(longest, abs(work.step[k]))
    for k in range(n):
        work.step[k] *= min(1.0, trust / max(longest, 1e-300))
    return True


@kernel
def refine(
    arm: Arm, world: World, pose: Array, iterations: int, accuracy: float, starts: Array, out: Array
) -> int:
    """From each row of starts (s, n): quadratic programs within a trust region until the pose is reached clear.

    Returns the row that led to `out` (n,), or -1.
    """
    n = out.shape[0]
    work, contacts, target = scratch(n), room(), np.empty(12)
    rows = np.empty((MOST_CONTACTS + 2 * n, 2 * n + 3))
    q, trial = np.empty(n), np.empty(n)
    read_target(pose, target)
    for s in range(starts.shape[0]):
        for k in range(n):
            q[k] = starts[s, k]
        trust = 0.2
        merit = _merit(arm, target, world, q, work, contacts)
        for _iteration in range(iterations):
            if merit < 1e-5 or trust < 1e-3 or not _step(arm, world, q, trust, work, contacts, rows):
                break
            for k in range(n):
                trial[k] = min(max(q[k] + work.step[k], arm.bounds[0, k]), arm.bounds[1, k])
            better = _merit(arm, target, world, trial, work, contacts)
            if better < merit:
                merit = better
                trust = min(1.5 * trust, 0.4)
                for k in range(n):
                    q[k] = trial[k]
            else:
                trust *= 0.35
                merit = _merit(arm, target, world, q, work, contacts)
        for k in range(n):
            out[k] = q[k]
        if polish(arm, target, accuracy, out, work) <= accuracy * accuracy:
            forward(arm.frames, out, work.T)
            if collect(world, work.T, world.required, world.required, contacts) >= world.required:
                return s
    return -1
