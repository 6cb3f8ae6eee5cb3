"""One program of a tool path's tracking: the motion nearest to a wish that keeps tool and all else in bounds.

The solution of

    min |dq - d|^2   with   a_i dq = -x_i        for the coordinates of the tool that have no tolerance,
                            |x_i + a_i dq| <= w_i for those that have one,
                            gap + gap' dq >= the clearance to keep, for every pair that is near,
                            joint limits and the largest step,

where x are the tool's coordinates from its target in the tolerance's axes, a their rates, and d the wish. Equalities
are solved in closed form; the rest by Hildreth's method on the dual, in their null space.
"""

from __future__ import annotations

from workcell.jit import inner
from workcell.kernels.chain import Arm
from workcell.kernels.cholesky import factor6, gram, solve6
from workcell.kernels.constants import ROTATION_WEIGHT
from workcell.kernels.null_space_qp import DEEPEST, LOOK_AHEAD, hildreth, project
from workcell.kernels.structures import World
from workcell.motion.tool_paths.kernels.coordinates import Room, contact_rates, rates
from workcell.pose import Array

SWEEPS = 40
"""Passes over the constraints of one program."""
_LEAST = 1e-7
"""Square of a gradient's part in the null space from which its bound can be kept there."""
WANTED = 2e-4
"""Metres beyond the required clearance that a step aims at."""
INSIDE = 0.98
"""Share of a tolerance that steps aim at."""
_DAMPING = 1e-10


@inner
def _inequality(n: int, m: int, bound: float, rows: Array) -> int:
    """Close row m of the program, whose first n numbers are set; returns the next row."""
    rows[m, 2 * n] = bound
    return m + 1


@inner
def _collect_rows(arm: Arm, world: World, box: Array, low: Array, high: Array, q: Array, space: Room) -> int:
    """Rows of the inequalities (see `refine`): contacts, tolerances, joint bounds; returns how many."""
    n, m = q.shape[0], 0
    work, rows, x, required = space.work, space.rows, space.x, world.required
    for c in range(int(space.contacts.used[0])):
        gap = space.contacts.rows[c, 0]
        if gap < required + LOOK_AHEAD:
            contact_rates(arm, c, space)
            for k in range(n):
                rows[m, k] = work.column[k]
            m = _inequality(n, m, min(required + WANTED - gap, DEEPEST), rows)
    for r in range(6):
        if box[r] > 0.0 and box[r] < 1e3:
            weight = 1.0 if r < 3 else ROTATION_WEIGHT
            for sign in (1.0, -1.0):
                for k in range(n):
                    rows[m, k] = -sign * work.J[r, k]
                m = _inequality(n, m, weight * (sign * x[r] - INSIDE * box[r]), rows)
    for k in range(n):
        for sign in (1.0, -1.0):
            for j in range(n):
                rows[m, j] = 0.0
            rows[m, k] = -sign
            m = _inequality(n, m, q[k] - high[k] if sign > 0 else low[k] - q[k], rows)
    return m


@inner
def equalities(box: Array, space: Room) -> bool:
    """Keep the rows of work.J that have no tolerance, the others zero; factor their Gram matrix into work.A."""
    work = space.work
    n = work.newton.shape[0]
    for r in range(6):
        if box[r] > 0.0:
            for k in range(n):
                work.J[r, k] = 0.0
    gram(work.J, _DAMPING, work.A)
    for r in range(6):
        if box[r] > 0.0:
            work.A[r, r] = 1.0
    return factor6(work.A)


@inner
def program(
    arm: Arm,
    world: World,
    target: Array,
    box: Array,
    low: Array,
    high: Array,
    wish: Array,
    q: Array,
    space: Room,
) -> bool:
    """One program at q (n,), after `look`; its solution into work.step. False where the equalities have no solution."""
    n = q.shape[0]
    work, rows = space.work, space.rows
    rates(arm, target, box[6] != 0.0, space)
    m = _collect_rows(arm, world, box, low, high, q, space)
    if not equalities(box, space):
        return False
    for r in range(6):
        weight = 1.0 if r < 3 else ROTATION_WEIGHT
        work.e[r] = -weight * space.x[r] if box[r] == 0.0 else 0.0
        for k in range(n):
            work.e[r] -= work.J[r, k] * wish[k]
    solve6(work.A, work.e, work.y)
    for k in range(n):
        work.newton[k] = wish[k]
        for r in range(6):
            work.newton[k] += work.J[r, k] * work.y[r]
    project(rows, m, work)
    hildreth(rows, m, SWEEPS, _LEAST, work.gradient)
    for k in range(n):
        work.step[k] = work.newton[k] + work.gradient[k]
    return True
