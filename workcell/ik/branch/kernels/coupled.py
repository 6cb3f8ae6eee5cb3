"""C5: joints that follow others by polynomials: the interval of who follows from that of who leads, and back."""

from __future__ import annotations

import numpy as np

from workcell.ik.branch.kernels.state import SLACK, Chain, State, tighten
from workcell.jit import exact_inner
from workcell.pose import Array


@exact_inner
def couple(chain: Chain, q: Array) -> None:
    """Put the joints of q (N,) that follow others where they belong."""
    last = chain.polynomials.shape[1] - 1
    for f in range(chain.follows.shape[0]):
        x, value = q[chain.follows[f, 1]], chain.polynomials[f, last]
        for power in range(last - 1, -1, -1):
            value = value * x + chain.polynomials[f, power]
        q[chain.follows[f, 0]] = value


@exact_inner
def slope_at(chain: Chain, f: int, x: float) -> float:
    """Derivative of the f-th joint that follows, where its leader is at x."""
    last, rate = chain.polynomials.shape[1] - 1, 0.0
    for power in range(last, 0, -1):
        rate = rate * x + power * chain.polynomials[f, power]
    return rate


@exact_inner
def gather(chain: Chain, q: Array, H: Array, g: Array) -> None:
    """Normal equations H (n, n), g (n,) by joints, at q (N,), made those of the joints that lead; in place."""
    n = g.shape[0]
    for f in range(chain.follows.shape[0]):
        k, leader = chain.follows[f, 0] - 1, chain.follows[f, 1] - 1
        slope = slope_at(chain, f, q[leader + 1])
        g[leader] += slope * g[k]
        for j in range(n):
            H[leader, j] += slope * H[k, j]
        for j in range(n):
            H[j, leader] += slope * H[j, k]
        g[k] = 0.0
        for j in range(n):
            H[k, j] = 0.0
            H[j, k] = 0.0
        H[k, k] = 1.0


@exact_inner
def contract_coupled(chain: Chain, state: State) -> bool:
    """Contract every joint that follows by who leads it, and the other way round; False if nothing is left.

    Around the middle c of the leader's interval, p(c + t) = sum s_i t^i with |t| <= h: the value stays within
    |s_1| h + |s_2| h^2 + ... of s_0, and the slope within 2 |s_2| h + 3 |s_3| h^2 + ... of s_1.
    """
    size = chain.polynomials.shape[1]
    s = np.empty(size)
    for f in range(chain.follows.shape[0]):
        k, leader = chain.follows[f, 0], chain.follows[f, 1]
        c = 0.5 * (state.lower[leader] + state.upper[leader])
        h = max(state.upper[leader] - c, c - state.lower[leader])
        rounding = _shifted(chain.polynomials[f], c, h, s)
        away, bent, power = 0.0, 0.0, 1.0
        for i in range(1, size):
            if i > 1:
                bent += i * abs(s[i]) * power
            power *= h
            away += abs(s[i]) * power
        away += rounding
        if not tighten(state, k, s[0] - away, s[0] + away):
            return False
        steep = abs(s[1]) - bent - rounding
        if steep > 1e-9:
            # x - c = (q_k - s_0) / slope, and every slope has the sign of s_1
            low, high = state.lower[k] - s[0] - rounding, state.upper[k] - s[0] + rounding
            if s[1] < 0.0:
                low, high = -high, -low
            flat = abs(s[1]) + bent + rounding
            first = c + low / (steep if low < 0.0 else flat)
            last = c + high / (steep if high > 0.0 else flat)
            if not tighten(state, leader, first - SLACK, last + SLACK):
                return False
    return True


@exact_inner
def _shifted(polynomial: Array, c: float, h: float, s: Array) -> float:
    """Coefficients s of the polynomial around c; returns what rounding may add to its values within h."""
    size, reach, total, power = polynomial.shape[0], abs(c) + h, 0.0, 1.0
    for i in range(size):
        s[i] = polynomial[i]
        total += abs(polynomial[i]) * power
        power *= reach
    for i in range(size - 1):
        for j in range(size - 2, i - 1, -1):
            s[j] += c * s[j + 1]
    return SLACK * (1.0 + total)
