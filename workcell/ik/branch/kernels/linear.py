"""The linear step: the loop's closure at a middle link, linearised, with the remainder bounded.

With p a point and R the rotation of the middle link, seen from the base and from the target,

    E_1 ... E_m p_base = Ball E_n^-1 ... E_{m+1}^-1 p_target,      E_1 ... E_m = Ball E_n^-1 ... E_{m+1}^-1 D,

D = R_target R_base^T. Expanded in the departures d_j this is J d = rhs + remainder: second order by components (a
square d_j^2 lies in [0, h_j^2], so half of it moves the right side), third order by Taylor's integral form, and for
rotations only the skew part counts, where squares cancel when D is the identity.

The third order of a point: E_1 ... E_m p - p is the sum over j of g_j = E_1 ... E_{j-1} (E_j - I) p. With joint k
turning by t h_k, t from 0 to 1, s = h_1 + ... + h_{j-1} and l the length of z_j x (p - o_j), the third derivative of
g_j by t is at most 3 s^2 h l + 3 s h^2 l + h^3 l from the terms in which E_j is differentiated, and s^3 |(E_j - I) p|
<= s^3 t h l from the one in which it isn't. Under (1 - t)^2 / 2 these integrate to ((s + h)^3 - s^3) l / 6 + s^3 h l
/ 24. Where j slides only the first and the last remain, with l = 1, and j doesn't add to s. Elimination with full
pivoting, in units of the box and of the remainders, leaves the joints that can't be told apart (one for seven joints)
on the right: every other joint follows them like a tube.

The tolerance ball enters exactly to first order: a shift e and a small turn w about the target's point c move p_target
by e + w x (p_target - c) and the rotation by w, so a row with weights (u, v) sees |u| |e| + |v + (p_target - c) x u|
|w|.
"""

from __future__ import annotations

import numpy as np

from workcell.ik.branch.kernels.elimination import apply, eliminate
from workcell.ik.branch.kernels.motion import arm
from workcell.ik.branch.kernels.state import Chain, State
from workcell.jit import exact_inner, exact_kernel
from workcell.pose import Array

WIDEST = 1.2
"""Radians that all half widths together may have for the step to be tried."""


@exact_kernel
def contract_linear(chain: Chain, state: State) -> bool:
    """Contract every joint by the linearised closure; False if the box holds no solution.

    Where it could be applied `state.tangent[0, 0]` is 1, and row 1 + k (k from 0) says how real joint k follows:
    departure = tangent[k+1, 1] + tangent[k+1, 2] * (departure of joint tangent[0, 1]) + tangent[k+1, 3:9] . noise
    + tangent[k+1, 13:] . (departures of the other free joints), tangent[0, 2] being the number of all free ones. The
    noise is bounded by `elimination.spread` with the remainders tangent[0, 3:9] and the lever tangent[0, 9:12].
    """
    state.tangent[0, 0] = 0.0
    joints = state.lower.shape[0]
    total = 0.0
    for k in range(1, joints - 1):
        # A joint whose axis goes through the only point that is known doesn't count.
        if chain.slides[k] == 0.0 and (chain.turns or k < chain.middle):
            total += max(state.upper[k] - state.centre[k], state.centre[k] - state.lower[k])
    if total > WIDEST:
        return True
    n = joints - 2
    rows = np.zeros((6, n + 7))
    radius = np.zeros(6)
    half = np.empty(n)
    for k in range(n):
        half[k] = max(state.upper[k + 1] - state.centre[k + 1], state.centre[k + 1] - state.lower[k + 1])
    if not _assemble(chain, state, chain.middle, half, rows, radius):
        return True
    pivots = np.full(6, -1)
    eliminate(rows, radius, chain.ball, state.tangent[0, 9:12], half, pivots)
    return apply(chain, state, rows, radius, half, pivots)


@exact_inner
def _assemble(chain: Chain, state: State, middle: int, half: Array, rows: Array, radius: Array) -> bool:
    """Fill rows = [J | identity | rhs] and the remainder's radius; False where the sides are turned too far apart."""
    n = half.shape[0]
    near, far = state.frames[0, middle], state.frames[1, middle]
    foot = chain.feet[middle, 1]
    p, t = np.empty(3), np.empty(3)
    for a in range(3):
        p[a] = near[9 + a] + foot * near[3 * a + 2]
        t[a] = far[9 + a] + foot * far[3 * a + 2]
    D = np.empty((3, 3))
    trace = 0.0
    for a in range(3):
        for b in range(3):
            D[a, b] = (
                far[3 * a] * near[3 * b] + far[3 * a + 1] * near[3 * b + 1] + far[3 * a + 2] * near[3 * b + 2]
            )
        trace += D[a, a]
    if trace < 1.0 and chain.turns:
        return False
    skew = np.array([0.5 * (D[2, 1] - D[1, 2]), 0.5 * (D[0, 2] - D[2, 0]), 0.5 * (D[1, 0] - D[0, 1])])
    for a in range(3):
        rows[a, n + 6] = t[a] - p[a]
        rows[3 + a, n + 6] = skew[a]
        state.tangent[0, 9 + a] = t[a] - chain.ball[2 + a]
        rows[a, n + a] = 1.0
        rows[3 + a, n + 3 + a] = 1.0
    _near_side(state.lines[0], p, middle, half, rows, radius)
    _far_side(state.lines[1], t, middle, half, D, trace, skew, rows, radius)
    # The ball turns what the far joints have moved: second order in its rotation, or a product with their motion.
    lever = state.tangent[0, 9:12]
    length = np.sqrt(lever[0] ** 2 + lever[1] ** 2 + lever[2] ** 2)
    turned, moved = np.sqrt(max(3.0 - trace, 0.0)), 0.0
    for back in range(1, n + 1 - middle):
        turned += half[n - back] * (1.0 - state.lines[1, back, 9])
        moved += half[n - back] * arm(t[0], t[1], t[2], state.lines[1, back])
    for a in range(3):
        radius[a] += chain.ball[1] * (moved + chain.ball[1] * length)
        radius[3 + a] += chain.ball[1] * (2.0 * turned + chain.ball[1])
    if not chain.turns:
        rows[3:, :], radius[3:] = 0.0, 0.0
    return True


@exact_inner
def _near_side(lines: Array, p: Array, middle: int, half: Array, rows: Array, radius: Array) -> None:
    """The joints from the base to the middle link: columns and remainder."""
    n = half.shape[0]
    moment = np.empty(3)
    outer, cubic = 0.0, 0.0
    for j in range(1, middle + 1):
        z, h = lines[j], half[j - 1]
        if z[9] > 0.0:
            moment[:] = z[:3]
            cubic += (3.0 + 0.25 * outer) * outer**2 * h
        else:
            _cross(z, p[0] - z[3], p[1] - z[4], p[2] - z[5], moment)
            length = np.sqrt(moment[0] ** 2 + moment[1] ** 2 + moment[2] ** 2)
            cubic += ((outer + h) ** 3 - outer**3 + 0.25 * outer**3 * h) * length
            outer += h
        for a in range(3):
            rows[a, j - 1] = moment[a]
            rows[3 + a, j - 1] = 0.0 if z[9] > 0.0 else z[a]
        for i in range(1, j + 1):
            y, scale = lines[i], half[i - 1] * h
            if y[9] > 0.0:
                continue
            cx = y[1] * moment[2] - y[2] * moment[1]
            cy = y[2] * moment[0] - y[0] * moment[2]
            cz = y[0] * moment[1] - y[1] * moment[0]
            if i == j:
                scale *= 0.25
                rows[0, n + 6] -= scale * cx
                rows[1, n + 6] -= scale * cy
                rows[2, n + 6] -= scale * cz
            elif z[9] == 0.0:
                radius[3] += 0.5 * scale * abs(y[1] * z[2] - y[2] * z[1])
                radius[4] += 0.5 * scale * abs(y[2] * z[0] - y[0] * z[2])
                radius[5] += 0.5 * scale * abs(y[0] * z[1] - y[1] * z[0])
            radius[0] += scale * abs(cx)
            radius[1] += scale * abs(cy)
            radius[2] += scale * abs(cz)
    for a in range(3):
        radius[a] += cubic / 6.0
        radius[3 + a] += outer**3 / 6.0


@exact_inner
def _far_side(
    lines: Array, t: Array, middle: int, half: Array, D: Array, trace: float, skew: Array, rows: Array, radius: Array
) -> None:  # fmt: skip
    """The joints from the target to the middle link, by their index from the target: columns and remainder.

    The skew part of [z]D is (tr(D) z - D z) / 2, that of [y][z]D is (D^T y x z) / 2 - (y . z) skew(D).
    """
    n = half.shape[0]
    moment, turned, pair = np.empty(3), np.empty(3), np.empty(3)
    outer, cubic = 0.0, 0.0
    for back in range(1, n + 1 - middle):
        z, h, column = lines[back], half[n - back], n - back
        slides = z[9] > 0.0
        if slides:
            moment[:] = z[:3]
            cubic += (3.0 + 0.25 * outer) * outer**2 * h
        else:
            _cross(z, t[0] - z[3], t[1] - z[4], t[2] - z[5], moment)
            length = np.sqrt(moment[0] ** 2 + moment[1] ** 2 + moment[2] ** 2)
            cubic += ((outer + h) ** 3 - outer**3 + 0.25 * outer**3 * h) * length
            outer += h
        for a in range(3):
            rows[a, column] = moment[a]
            if slides:
                continue
            rows[3 + a, column] = 0.5 * (trace * z[a] - D[a, 0] * z[0] - D[a, 1] * z[1] - D[a, 2] * z[2])
        for i in range(1, back + 1):
            y, scale = lines[i], half[n - i] * h
            if y[9] > 0.0:
                continue
            dot = y[0] * z[0] + y[1] * z[1] + y[2] * z[2]
            for a in range(3):
                turned[a] = D[0, a] * y[0] + D[1, a] * y[1] + D[2, a] * y[2]
            _cross(turned, z[0], z[1], z[2], pair)
            cx = y[1] * moment[2] - y[2] * moment[1]
            cy = y[2] * moment[0] - y[0] * moment[2]
            cz = y[0] * moment[1] - y[1] * moment[0]
            if i == back:
                scale *= 0.25
                rows[0, n + 6] += scale * cx
                rows[1, n + 6] += scale * cy
                rows[2, n + 6] += scale * cz
            radius[0] += scale * abs(cx)
            radius[1] += scale * abs(cy)
            radius[2] += scale * abs(cz)
            if slides:
                continue
            for a in range(3):
                bend = 0.5 * pair[a] - dot * skew[a]
                if i == back:
                    rows[3 + a, n + 6] += scale * bend
                radius[3 + a] += scale * abs(bend)
    for a in range(3):
        radius[a] += cubic / 6.0
        radius[3 + a] += outer**3 / 6.0


@exact_inner
def _cross(z: Array, x: float, y: float, w: float, out: Array) -> None:
    out[0] = z[1] * w - z[2] * y
    out[1] = z[2] * x - z[0] * w
    out[2] = z[0] * y - z[1] * x
