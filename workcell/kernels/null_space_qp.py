"""Quadratic programs in a pose's null space: the smallest motion that keeps linear bounds (Hildreth's method).

A row (2 n + 3) holds a gradient, its part in the null space, its bound, the square of that part, and its multiplier.
"""

from __future__ import annotations

import math

from workcell.jit import inner
from workcell.kernels.cholesky import solve6
from workcell.kernels.structures import Work
from workcell.pose import Array

LOOK_AHEAD = 0.03
"""Metres of clearance within which a pair is a constraint of a program."""
DEEPEST = 0.02
"""Metres that a step asks a pair to move apart at most: linearisation holds no further."""


@inner
def project(rows: Array, m: int, work: Work) -> None:
    """Each of m gradients' part in the null space of work.J, its square, and the bound less work.newton's share.

    work.A holds the Gram factor of work.J, work.newton the motion that meets the equalities. Multipliers begin at zero.
    """
    n = work.newton.shape[0]
    for c in range(m):
        for r in range(6):
            work.y[r] = 0.0
            for k in range(n):
                work.y[r] += work.J[r, k] * rows[c, k]
        solve6(work.A, work.y, work.y)
        square = 0.0
        for k in range(n):
            part = rows[c, k]
            for r in range(6):
                part -= work.J[r, k] * work.y[r]
            rows[c, n + k] = part
            square += part * part
            rows[c, 2 * n] -= rows[c, k] * work.newton[k]
        rows[c, 2 * n + 1], rows[c, 2 * n + 2] = square, 0.0


@inner
def hildreth(rows: Array, m: int, sweeps: int, least: float, out: Array) -> None:
    """The smallest motion out (n,) of the null space that meets the bounds of m rows.

    Squares below `least` don't count.
    """
    n = out.shape[0]
    for k in range(n):
        out[k] = 0.0
    for _sweep in range(sweeps):
        change = 0.0
        for c in range(m):
            if rows[c, 2 * n + 1] < least:
                continue
            slack = -rows[c, 2 * n]
            for k in range(n):
                slack += rows[c, n + k] * out[k]
            delta = max(-slack / rows[c, 2 * n + 1], -rows[c, 2 * n + 2])
            if delta != 0.0:
                rows[c, 2 * n + 2] += delta
                for k in range(n):
                    out[k] += delta * rows[c, n + k]
                change = max(change, abs(delta) * math.sqrt(rows[c, 2 * n + 1]))
        if change < 1e-7:
            break
