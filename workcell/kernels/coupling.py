"""Joints that follow variables by polynomials: values and slopes, and derivatives gathered by variable."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from workcell.jit import inner
from workcell.pose import Array


class Couple(NamedTuple):
    """How m joints follow from n variables.

    Attributes:
        variable: (m,) the variable that each joint follows.
        coefficients: (m, d + 1) of its value, in rising powers of that variable.
    """

    variable: NDArray[np.int64]
    coefficients: Array


@inner
def follow(couple: Couple, v: Array, q: Array, slope: Array) -> None:
    """Joint values q (m,) and their slopes (m,) at variables v (n,)."""
    last = couple.coefficients.shape[1] - 1
    for k in range(q.shape[0]):
        x = v[couple.variable[k]]
        value, rate = couple.coefficients[k, last], 0.0
        for power in range(last - 1, -1, -1):
            rate = rate * x + value
            value = value * x + couple.coefficients[k, power]
        q[k], slope[k] = value, rate


@inner
def spread(couple: Couple, k: int, middle: float, half: float) -> tuple[float, float]:
    """Bounds on the sizes of a joint's first and second derivative within `half` of its variable's value `middle`."""
    size = couple.coefficients.shape[1]
    steep, bent, reach, power, before = 0.0, 0.0, abs(middle) + half, 1.0, 0.0
    affine = True
    for i in range(2, size):
        affine = affine and couple.coefficients[k, i] == 0.0
    if affine:
        return abs(couple.coefficients[k, 1]), 0.0
    # the slope in the middle, and how far the bend's bound lets it stray from there
    slope = 0.0
    for i in range(size - 1, 0, -1):
        slope = slope * middle + i * couple.coefficients[k, i]
    for i in range(2, size):
        bent += i * (i - 1.0) * abs(couple.coefficients[k, i]) * power
        before = power
        power = before * reach
    steep = abs(slope) + bent * half
    return steep * (1.0 + 1e-9) + 1e-12, bent * (1.0 + 1e-9) + 1e-12


@inner
def gather(couple: Couple, slope: Array, row: Array, out: Array) -> None:
    """Derivatives by the variables, into out (n,), of those by the joints in row (m,)."""
    for a in range(out.shape[0]):
        out[a] = 0.0
    for k in range(row.shape[0]):
        out[couple.variable[k]] += slope[k] * row[k]
