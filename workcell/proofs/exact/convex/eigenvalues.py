"""An upper bound of the largest eigenvalue of a symmetric matrix of four rows."""

from __future__ import annotations

from workcell.proofs.exact.spans import Span

BITS_BELOW = 48
"""Bisections: the bound is within 2^-48 of the matrix's size."""


def largest_eigenvalue(matrix: list[list[Span]]) -> Span:
    """A span whose upper end no eigenvalue exceeds.

    The middles of the entries are a matrix M of whole numbers. l I - M is positive definite exactly where all its
    leading minors are above zero, which determinants in whole numbers decide; l is found by bisection. The entries'
    own widths change an eigenvalue by no more than the largest sum of a row of them.
    """
    size = range(len(matrix))
    middle = [[0] * len(matrix) for _ in size]
    widths = [0] * len(matrix)
    for i in size:
        for j in size:
            low, high = matrix[i][j].low, matrix[i][j].high
            middle[i][j] = (low + high) // 2 if j >= i else middle[j][i]
            widths[i] += max(high - middle[i][j], middle[i][j] - low)
    bound = max(sum(abs(entry) for entry in row) for row in middle) + 1
    low, high = -bound, bound
    step = max(2 * bound >> BITS_BELOW, 1)
    while high - low > step:
        between = (low + high) // 2
        if _positive_definite([[between * (i == j) - middle[i][j] for j in size] for i in size]):
            high = between
        else:
            low = between
    return Span(low - max(widths), high + max(widths))


def _positive_definite(matrix: list[list[int]]) -> bool:
    """Whether all leading minors are above zero, by elimination without fractions (Bareiss)."""
    rows = [list(row) for row in matrix]
    before = 1
    for k in range(len(rows)):
        pivot = rows[k][k]
        if pivot <= 0:
            return False
        for i in range(k + 1, len(rows)):
            for j in range(k + 1, len(rows)):
                rows[i][j] = (rows[i][j] * pivot - rows[i][k] * rows[k][j]) // before
        before = pivot
    return True
