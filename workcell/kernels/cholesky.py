"""Small dense linear algebra: Cholesky factors of 6x6 and n x n systems, in place."""

from __future__ import annotations

import math

from workcell.jit import inner
from workcell.pose import Array


@inner
def gram(J: Array, damping: float, A: Array) -> None:
    """Lower triangle of J J^T + damping I, into A (6, 6)."""
    for r in range(6):
        for c in range(r + 1):
            total = 0.0
            for k in range(J.shape[1]):
                total += J[r, k] * J[c, k]
            A[r, c] = total
        A[r, r] += damping


@inner
def factor6(A: Array) -> bool:
    """Cholesky factor in the lower triangle of A (6, 6), with inverse diagonal; False if not positive definite."""
    for j in range(6):
        d = A[j, j]
        for k in range(j):
            d -= A[j, k] * A[j, k]
        if not d > 1e-300:
            return False
        inverse = 1.0 / math.sqrt(d)
        A[j, j] = inverse
        for i in range(j + 1, 6):
            total = A[i, j]
            for k in range(j):
                total -= A[i, k] * A[j, k]
            A[i, j] = total * inverse
    return True


@inner
def solve6(A: Array, b: Array, x: Array) -> None:
    """x with L L^T x = b, given `factor6`; b and x (6,) may be the same array."""
    for i in range(6):
        total = b[i]
        for k in range(i):
            total -= A[i, k] * x[k]
        x[i] = total * A[i, i]
    for r in range(6):
        i = 5 - r
        total = x[i]
        for k in range(i + 1, 6):
            total -= A[k, i] * x[k]
        x[i] = total * A[i, i]


@inner
def factor(A: Array) -> bool:
    """As `factor6`, for any size."""
    n = A.shape[0]
    for j in range(n):
        d = A[j, j]
        for k in range(j):
            d -= A[j, k] * A[j, k]
        if not d > 1e-300:
            return False
        inverse = 1.0 / math.sqrt(d)
        A[j, j] = inverse
        for i in range(j + 1, n):
            total = A[i, j]
            for k in range(j):
                total -= A[i, k] * A[j, k]
            A[i, j] = total * inverse
    return True


@inner
def solve(A: Array, x: Array) -> None:
    """Overwrite x (n,) with the solution of L L^T x = x, given `factor`."""
    n = A.shape[0]
    for i in range(n):
        total = x[i]
        for k in range(i):
            total -= A[i, k] * x[k]
        x[i] = total * A[i, i]
    for r in range(n):
        i = n - 1 - r
        total = x[i]
        for k in range(i + 1, n):
            total -= A[k, i] * x[k]
        x[i] = total * A[i, i]
