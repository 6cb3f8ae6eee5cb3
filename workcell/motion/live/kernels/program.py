"""Small convex quadratic programs by the dual active-set method (Goldfarb and Idnani 1983).

    minimise 1/2 (x - c)' H (x - c)   subject to   rows x >= bounds

H is given by its inverse, c is where `x` stands at first. A last variable may stand for slack that all soft rows share.
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from workcell.jit import inlined, lean
from workcell.pose import Array

_STEPS = 200
_FLAT = 1e-13


class Program(NamedTuple):
    """Room for a program of n variables and up to m rows.

    Attributes:
        inverse: (n, n) of H; factor: (n, n) scratch.
        x: (n,); rows: (m, n); bounds: (m,); used: (1,) how many there are.
        active: (n + 1,) rows that hold with equality, count of them in `used[1]`; force: (n + 1,) multipliers.
        pulls: (n + 1, n) inverse times active rows; gram: (n + 1, n + 1); push, r, z: scratch.
        inside: (m,) whether a row is active.
    """

    inverse: Array
    factor: Array
    x: Array
    rows: Array
    bounds: Array
    used: NDArray[np.int64]
    active: NDArray[np.int64]
    force: Array
    pulls: Array
    gram: Array
    push: Array
    r: Array
    z: Array
    inside: NDArray[np.bool_]


@lean
def invert(H: Array, program: Program) -> bool:
    """The inverse of a positive definite H (n, n), into program.inverse; False where it is not."""
    n, L, B = H.shape[0], program.factor, program.inverse
    for j in range(n):
        d = H[j, j]
        for k in range(j):
            d -= L[j, k] * L[j, k]
        if not d > 1e-300:
            return False
        L[j, j] = math.sqrt(d)
        for i in range(j + 1, n):
            total = H[i, j]
            for k in range(j):
                total -= L[i, k] * L[j, k]
            L[i, j] = total / L[j, j]
    for c in range(n):
        for i in range(n):
            total = 1.0 if i == c else 0.0
            for k in range(i):
                total -= L[i, k] * B[k, c]
            B[i, c] = total / L[i, i]
        for back in range(n):
            i = n - 1 - back
            total = B[i, c]
            for k in range(i + 1, n):
                total -= L[k, i] * B[k, c]
            B[i, c] = total / L[i, i]
    return True


@inlined
def add_row(program: Program, bound: float) -> int:
    """A new row of zeros with its bound, to be filled in by the caller; which it is."""
    at = program.used[0]
    program.used[0] = at + 1
    program.bounds[at] = bound
    for k in range(program.rows.shape[1]):
        program.rows[at, k] = 0.0
    return int(at)


@lean
def _directions(program: Program, row: int, k: int) -> tuple[float, float]:
    """Steps z of x and r of the k multipliers as row's own grows; the rate of the row's value, and that if free."""
    B, n, C = program.inverse, program.x.shape[0], program.rows
    free = 0.0
    for i in range(n):
        total = 0.0
        for j in range(n):
            total += B[i, j] * C[row, j]
        program.push[i], program.z[i] = total, total
        free += total * C[row, i]
    G, r = program.gram, program.r
    # the factor of the Gram matrix stands in its lower triangle
    for i in range(k):
        total = 0.0
        for j in range(n):
            total += C[program.active[i], j] * program.push[j]
        for j in range(i):
            total -= G[i, j] * r[j]
        r[i] = total / G[i, i]
    for back in range(k):
        i = k - 1 - back
        total = r[i]
        for j in range(i + 1, k):
            total -= G[j, i] * r[j]
        r[i] = total / G[i, i]
        for j in range(n):
            program.z[j] -= r[i] * program.pulls[i, j]
    rate = 0.0
    for j in range(n):
        rate += program.z[j] * C[row, j]
    return rate, free


@lean
def _factor_gram(program: Program, k: int) -> None:
    n, G, C = program.x.shape[0], program.gram, program.rows
    for i in range(k):
        for j in range(i + 1):
            total = 0.0
            for c in range(n):
                total += C[program.active[i], c] * program.pulls[j, c]
            for c in range(j):
                total -= G[i, c] * G[j, c]
            if i == j:
                G[i, i] = math.sqrt(max(total, 1e-300))
            else:
                G[i, j] = total / G[j, j]


@lean
def solve(program: Program, tolerance: float) -> bool:
    """Move x to the minimum; False where no x fits all rows to `tolerance`, or after too many steps."""
    n, count, C, x = program.x.shape[0], program.used[0], program.rows, program.x
    k = 0
    for c in range(count):
        program.inside[c] = False
    program.used[1] = 0
    row, own = -1, 0.0
    for _ in range(_STEPS):
        if row < 0:
            worst = -tolerance
            for c in range(count):
                if program.inside[c]:
                    continue
                slack = -program.bounds[c]
                for j in range(n):
                    slack += C[c, j] * x[j]
                if slack < worst:
                    worst, row = slack, c
            if row < 0:
                program.used[1] = k
                return True
            own = 0.0
        rate, free = _directions(program, row, k)
        slack = -program.bounds[row]
        for j in range(n):
            slack += C[row, j] * x[j]
        blocked = not rate > _FLAT * free
        full = np.inf if blocked else -slack / rate
        length, drop = full, -1
        for i in range(k):
            if program.r[i] > 1e-14 and program.force[i] < length * program.r[i]:
                length, drop = program.force[i] / program.r[i], i
        if length == np.inf:
            program.used[1] = k
            return False
        for i in range(k):
            program.force[i] -= length * program.r[i]
        own += length
        if not blocked:
            for j in range(n):
                x[j] += length * program.z[j]
        if drop < 0:
            program.active[k], program.force[k], program.inside[row] = row, own, True
            for j in range(n):
                program.pulls[k, j] = program.push[j]
            k += 1
            row = -1
        else:
            program.inside[program.active[drop]] = False
            for i in range(drop, k - 1):
                program.active[i], program.force[i] = program.active[i + 1], program.force[i + 1]
                for j in range(n):
                    program.pulls[i, j] = program.pulls[i + 1, j]
            k -= 1
        _factor_gram(program, k)
    program.used[1] = k
    return False
