"""Solving the linearised closure for the joints, and what follows for each of them."""

from __future__ import annotations

import numpy as np

from workcell.ik.branch.kernels.state import SLACK, Chain, State, tighten
from workcell.jit import exact_inner
from workcell.pose import Array


@exact_inner
def spread(weights: Array, radius: Array, lever: Array, ball: Array) -> float:
    """Largest value of weights (6,) . noise: remainders within `radius` (6,), the tolerance ball on `lever` (3,)."""
    u, v, w = weights[0], weights[1], weights[2]
    total = SLACK
    for k in range(6):
        total += abs(weights[k]) * (radius[k] + SLACK)
    a = weights[3] + lever[1] * w - lever[2] * v
    b = weights[4] + lever[2] * u - lever[0] * w
    c = weights[5] + lever[0] * v - lever[1] * u
    shift, turn = np.sqrt(u * u + v * v + w * w), np.sqrt(a * a + b * b + c * c)
    return total + ball[0] * shift + ball[1] * turn  # type: ignore[no-any-return]


@exact_inner
def eliminate(rows: Array, radius: Array, ball: Array, lever: Array, half: Array, pivots: Array) -> None:
    """Gauss-Jordan with full pivoting on rows = [J | P | rhs]; pivots[r] is the joint solved for in row r, or -1.

    Joints count in half widths, rows in their radius: a joint that its row can't tell from zero is left alone.
    """
    n, columns = half.shape[0], rows.shape[1]
    taken = np.zeros(n)
    for _ in range(6):
        best, row, column = 0.05, -1, -1
        for r in range(6):
            if pivots[r] < 0:
                noise = spread(rows[r, n : n + 6], radius, lever, ball)
                for j in range(n):
                    if (
                        taken[j] == 0.0
                        and abs(rows[r, j]) * half[j] > best * noise
                        and abs(rows[r, j]) > 1e-6
                    ):
                        best, row, column = abs(rows[r, j]) * half[j] / noise, r, j
        if row < 0:
            return
        pivots[row] = column
        taken[column] = 1.0
        scale = 1.0 / rows[row, column]
        for k in range(columns):
            rows[row, k] *= scale
        for r in range(6):
            if r != row and rows[r, column] != 0.0:
                factor = rows[r, column]
                for k in range(columns):
                    rows[r, k] -= factor * rows[row, k]
                rows[r, column] = 0.0


@exact_inner
def apply(chain: Chain, state: State, rows: Array, radius: Array, half: Array, pivots: Array) -> bool:
    """Contract by every row: any joint in it lies where the others and the remainder allow."""
    n = half.shape[0]
    for r in range(6):
        noise = spread(rows[r, n : n + 6], radius, state.tangent[0, 9:12], chain.ball)
        low, high = rows[r, n + 6] - noise, rows[r, n + 6] + noise
        for j in range(n):
            first = rows[r, j] * (state.lower[j + 1] - state.centre[j + 1])
            second = rows[r, j] * (state.upper[j + 1] - state.centre[j + 1])
            low -= max(first, second)
            high -= min(first, second)
        # Now low <= 0 <= high must hold with all joints on the right; leave one out to contract it.
        if low > 0.0 or high < 0.0:
            return False
        for j in range(n):
            w = rows[r, j]
            if abs(w) < 1e-3:
                continue
            centre = state.centre[j + 1]
            first, second = w * (state.lower[j + 1] - centre), w * (state.upper[j + 1] - centre)
            one, two = (low + max(first, second)) / w, (high + min(first, second)) / w
            if not tighten(state, j + 1, centre + min(one, two), centre + max(one, two)):
                return False
    _keep_tangent(chain, state, rows, radius, pivots)
    return True


@exact_inner
def _keep_tangent(chain: Chain, state: State, rows: Array, radius: Array, pivots: Array) -> None:
    """Write how the joints follow the free ones (see `linear.contract_linear`), unless more are free than must be."""
    n = rows.shape[1] - 7
    solved = np.zeros(n)
    for r in range(6):
        if pivots[r] >= 0:
            solved[pivots[r]] = 1.0
    free, count = -1, 0
    for j in range(n):
        if solved[j] == 0.0:
            count += 1
            if free < 0 or state.sweep[0, j + 1] > state.sweep[0, free + 1]:
                free = j
    if count > max(1, n - (6 if chain.turns else 3)):
        return
    tangent = state.tangent
    tangent[1:, :] = 0.0
    tangent[0, 0], tangent[0, 1], tangent[0, 2] = 1.0, free, count
    for k in range(6):
        tangent[0, 3 + k] = radius[k]
    for j in range(n):
        if solved[j] == 0.0:
            tangent[1 + j, 2 if j == free else 13 + j] = 1.0
    for r in range(6):
        j = pivots[r]
        if j < 0:
            continue
        tangent[1 + j, 1] = rows[r, n + 6]
        for k in range(6):
            tangent[1 + j, 3 + k] = rows[r, n + k]
        for k in range(n):
            if solved[k] == 0.0:
                tangent[1 + j, 2 if k == free else 13 + k] = -rows[r, k]
