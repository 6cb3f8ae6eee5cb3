"""Intersections of an interval with the arcs on which a cosine lies in a band."""

from __future__ import annotations

import numpy as np

from workcell.ik.branch.kernels.state import SLACK
from workcell.jit import exact_inner, exact_kernel
from workcell.kernels.constants import TURN


@exact_inner
def gap_before(u: float, inner: float, outer: float) -> float:
    """How far to go up from `u` in [0, 2 pi) to reach the arcs inner <= |t| <= outer (mod 2 pi).

    inner <= outer <= pi.
    """
    if u <= outer:
        return max(inner - u, 0.0)
    if u <= TURN - inner:
        return max(TURN - outer - u, 0.0)
    return TURN + inner - u


@exact_inner
def clip_to_arcs(phase: float, inner: float, outer: float, lower: float, upper: float) -> tuple[float, float]:
    """Hull of {t in [lower, upper]: inner <= |t - phase + 2 pi k| <= outer}; lower > upper where that is empty."""
    if inner > 0.0:
        inner = max(inner - SLACK, 0.0)
    outer = min(outer + SLACK, np.pi)
    u = lower - phase
    u -= TURN * np.floor(u / TURN)
    v = phase - upper
    v -= TURN * np.floor(v / TURN)
    return lower + gap_before(u, inner, outer), upper - gap_before(v, inner, outer)


@exact_kernel
def clip_to_band(
    a: float, b: float, c: float, low: float, high: float, lower: float, upper: float
) -> tuple[float, float]:
    """Hull of {t in [lower, upper]: low <= a + b cos t + c sin t <= high}; lower > upper where that is empty.

    The band is widened by the rounding of its ends before the arc cosine, so that the result is sure even where the
    cosine is flat.
    """
    amplitude = np.sqrt(b * b + c * c)
    slack = SLACK * (1.0 + abs(a) + amplitude)
    low, high = low - a - slack, high - a + slack
    if low <= -amplitude and high >= amplitude:
        return lower, upper
    if low > amplitude or high < -amplitude:
        return 1.0, -1.0
    inner = 0.0 if high >= amplitude else np.arccos(high / amplitude)
    outer = np.pi if low <= -amplitude else np.arccos(low / amplitude)
    return clip_to_arcs(np.arctan2(c, b), inner, outer, lower, upper)


@exact_kernel
def clip_to_parabola(
    a: float, b: float, c: float, low: float, high: float, lower: float, upper: float
) -> tuple[float, float]:
    """Hull of {t in [lower, upper]: low <= a + b t + c t^2 <= high} for c = 0 or 1; lower > upper where it is empty."""
    slack = SLACK * (1.0 + abs(a) + b * b)
    low, high = low - a - slack, high - a + slack
    if c == 0.0:
        if abs(b) < 1e-9:
            reach = abs(b) * max(abs(lower), abs(upper))
            return (lower, upper) if low <= reach and high >= -reach else (1.0, -1.0)
        one, two = low / b, high / b
        return max(lower, min(one, two)), min(upper, max(one, two))
    foot = -0.5 * b
    low, high = low + foot * foot, high + foot * foot
    if high < 0.0:
        return 1.0, -1.0
    outer, inner = np.sqrt(high), np.sqrt(max(low, 0.0))
    first, last = max(lower, foot - outer), min(upper, foot + outer)
    if first > foot - inner:
        first = max(first, foot + inner)
    if last < foot + inner:
        last = min(last, foot - inner)
    return first, last


@exact_kernel
def range_of_parabola(a: float, b: float, c: float, lower: float, upper: float) -> tuple[float, float]:
    """Smallest and largest a + b t + c t^2 for t in [lower, upper], c = 0 or 1."""
    one, two = a + lower * (b + c * lower), a + upper * (b + c * upper)
    low, high = min(one, two), max(one, two)
    if c > 0.0 and lower < -0.5 * b < upper:
        low = a - 0.25 * b * b
    slack = SLACK * (1.0 + abs(a) + b * b + max(abs(one), abs(two)))
    return low - slack, high + slack


@exact_kernel
def range_of_band(a: float, b: float, c: float, lower: float, upper: float) -> tuple[float, float]:
    """Smallest and largest a + b cos t + c sin t for t in [lower, upper]."""
    amplitude = np.sqrt(b * b + c * c)
    slack = SLACK * (1.0 + abs(a) + amplitude)
    if amplitude < slack:
        return a - 2.0 * slack, a + 2.0 * slack
    phase = np.arctan2(c, b)
    at_lower, at_upper = np.cos(lower - phase), np.cos(upper - phase)
    low, high = min(at_lower, at_upper), max(at_lower, at_upper)
    turns = np.ceil((lower - phase) / TURN - SLACK)
    if phase + turns * TURN <= upper + SLACK:
        high = 1.0
    turns = np.ceil((lower - phase - np.pi) / TURN - SLACK)
    if phase + np.pi + turns * TURN <= upper + SLACK:
        low = -1.0
    return a + amplitude * low - slack, a + amplitude * high + slack
