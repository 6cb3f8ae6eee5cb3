"""Joints that follow others by polynomials, for the checker: it keeps of a box what the polynomials allow."""

from __future__ import annotations

import numpy as np

from workcell.ik.branch.checker.closure import Box, Robot, narrow
from workcell.ik.branch.checker.vectors import EPS
from workcell.jit import exact_inner
from workcell.pose import Array


@exact_inner
def keep_coupled(robot: Robot, box: Box) -> bool:
    """Narrow every joint that follows to the values at its leader's, and the leader where slopes tell; False: empty.

    Values and slopes are bounded by interval arithmetic on Horner's rule, widened by `EPS` times what the terms' sizes
    add up to: some thousand times what doubles err by.
    """
    for row in range(robot.coupled.shape[0]):
        k, leader = int(robot.coupled[row, 0]), int(robot.coupled[row, 1])
        coefficients = robot.coupled[row, 2:]
        low, high = box.lower[leader], box.upper[leader]
        middle = 0.5 * (low + high)
        slack = EPS * _size(coefficients, max(abs(low), abs(high)))
        first, last = _values(coefficients, low, high)
        least, most = _slopes(coefficients, low, high)
        at, _ = _values(coefficients, middle, middle)
        # the mean value theorem is the sharper one on small boxes
        half = (0.5 * (high - low)) * max(abs(least), abs(most))
        first, last = max(first, at - half) - slack, min(last, at + half) + slack
        if not narrow(box, k, first, last):
            return False
        least, most = least - slack, most + slack
        if least > 1e-9 or most < -1e-9:
            a, b = box.lower[k] - at - slack, box.upper[k] - at + slack
            one, two, three, four = a / least, a / most, b / least, b / most
            first, last = middle + min(one, two, three, four), middle + max(one, two, three, four)
            if not narrow(box, leader, first - EPS, last + EPS):
                return False
    return True


@exact_inner
def _size(coefficients: Array, reach: float) -> float:
    """At least the sizes of a polynomial's terms, and of its derivative's, added up."""
    total, power = 1.0, 1.0
    for i in range(coefficients.shape[0]):
        total += (i + 1.0) * abs(coefficients[i]) * max(power, 1.0)
        power *= max(reach, 1.0)
    return total


@exact_inner
def _values(coefficients: Array, low: float, high: float) -> tuple[float, float]:
    """An interval that holds a polynomial's values on [low, high]."""
    first = last = coefficients[coefficients.shape[0] - 1]
    for i in range(coefficients.shape[0] - 2, -1, -1):
        a, b, c, d = first * low, first * high, last * low, last * high
        first, last = min(a, b, c, d) + coefficients[i], max(a, b, c, d) + coefficients[i]
    return first, last


@exact_inner
def _slopes(coefficients: Array, low: float, high: float) -> tuple[float, float]:
    """An interval that holds its derivative's values there."""
    count = coefficients.shape[0]
    rates = np.zeros(max(count - 1, 1))
    for i in range(1, count):
        rates[i - 1] = i * coefficients[i]
    return _values(rates, low, high)
