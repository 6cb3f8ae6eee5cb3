"""Levenberg-Marquardt on the pose with a hinge on penetration: near misses slide clear along the obstacles."""

from __future__ import annotations

from workcell.jit import inner
from workcell.kernels.chain import Arm, forward
from workcell.kernels.cholesky import factor, solve
from workcell.kernels.constants import HUGE
from workcell.kernels.contacts import Contacts, collect, contact_row
from workcell.kernels.pose_error import jacobian, move, pose_error
from workcell.kernels.structures import Work, World
from workcell.pose import Array

HINGE_MARGIN = 3e-4
"""Metres beyond the wanted clearance at which the hinge begins, so that a solution is not left on the edge."""


@inner
def _cost(
    arm: Arm, target: Array, world: World, q: Array, work: Work, contacts: Contacts
) -> tuple[float, float]:
    """Sum of squared residuals at q, and the smallest gap less the wanted one."""
    forward(arm.frames, q, work.T)
    cost = pose_error(work.T, target, work.e)
    wanted = world.required + HINGE_MARGIN
    gap = collect(world, work.T, wanted, -HUGE, contacts)
    for c in range(int(contacts.used[0])):
        cost += (wanted - contacts.rows[c, 0]) ** 2
    return cost, gap - world.required


@inner
def _normal_equations(arm: Arm, world: World, work: Work, contacts: Contacts) -> None:
    """work.H (n, n, lower triangle) and work.gradient (n,) of half the cost, at the frames in work.T."""
    n = work.step.shape[0]
    H, g, row = work.H, work.gradient, work.column
    jacobian(arm.frames, work.T, work.J)
    for a in range(n):
        g[a] = 0.0
        for r in range(6):
            g[a] += work.J[r, a] * work.e[r]
        for b in range(a + 1):
            H[a, b] = 0.0
            for r in range(6):
                H[a, b] += work.J[r, a] * work.J[r, b]
    for c in range(int(contacts.used[0])):
        contact_row(arm.frames, work.T, contacts.rows, c, row)
        short = world.required + HINGE_MARGIN - contacts.rows[c, 0]
        for a in range(n):
            g[a] += row[a] * short
            for b in range(a + 1):
                H[a, b] += row[a] * row[b]


@inner
def _hold(q: Array, bounds: Array, damping: float, work: Work) -> None:
    """Damp the diagonal; joints pushed out of their limits are taken out of the equations."""
    for k in range(q.shape[0]):
        g = work.gradient[k]
        work.step[k] = g
        work.H[k, k] += damping
        if bounds[2, k] == 0.0 and ((q[k] >= bounds[1, k] and g > 0) or (q[k] <= bounds[0, k] and g < 0)):
            work.step[k] = 0.0
            for j in range(k):
                work.H[k, j] = 0.0
            for j in range(k + 1, q.shape[0]):
                work.H[j, k] = 0.0
            work.H[k, k] = 1.0


@inner
def slide(
    arm: Arm,
    target: Array,
    world: World,
    iterations: int,
    accuracy: float,
    q: Array,
    work: Work,
    contacts: Contacts,
) -> float:
    """Move q (n,) in place towards a clear configuration that reaches the target.

    Returns the smallest gap less the wanted clearance where the pose residual is below `accuracy`, else -1e3.
    """
    n = q.shape[0]
    cost, gap = _cost(arm, target, world, q, work, contacts)
    damping, last = 0.03, cost
    for iteration in range(iterations):
        pose = 0.0
        for r in range(6):
            pose += work.e[r] * work.e[r]
        if gap >= 0.5 * HINGE_MARGIN and pose < accuracy * accuracy:
            return gap
        if iteration % 6 == 5:
            if cost > 0.3 * last:
                return -1e3
            last = cost
        _normal_equations(arm, world, work, contacts)
        for _attempt in range(4):
            _hold(q, arm.bounds, damping * cost + 1e-13, work)
            if not factor(work.H):
                return -1e3
            solve(work.H, work.step)
            longest = 0.0
            for k in range(n):
                longest = max(longest, abs(work.step[k]))
            move(q, work.step, min(1.0, 0.5 / max(longest, 1e-300)), arm.bounds, work.trial)
            trial, trial_gap = _cost(arm, target, world, work.trial, work, contacts)
            if trial < cost:
                break
            damping = min(8.0 * damping + 1e-4, 1e4)
            _cost(arm, target, world, q, work, contacts)
            _normal_equations(arm, world, work, contacts)
        else:
            return -1e3
        damping = max(0.3 * damping, 1e-6)
        cost, gap = trial, trial_gap
        for k in range(n):
            q[k] = work.trial[k]
    return -1e3
