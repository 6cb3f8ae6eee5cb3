"""C2 and C3: joints from the invariants between two axes with one joint between them.

Take joint i, a point m and direction z_m of axis i - 1, and a point f and direction z_f of axis i + 1. Neither joint
i - 1 nor joint i + 1 changes

    |f - m|^2,   z_m . (f - m),   z_f . (f - m),   z_m . z_f,

and each is a + b cos q_i + c sin q_i, or a + b q_i + c q_i^2 where joint i slides, with coefficients of the robot
(`State.bands`). Seen from both ends they are known up
to the motion radii of the other joints. C2 contracts joint i by these four bands. C3 leaves out of the radii one more
joint j, on the near side of axis i - 1: the invariants' ranges over q_i then are bands in a + b cos q_j + c sin q_j,
whose coefficients follow from the frames at the centre (the departure of j is measured from that centre).

For a component along a direction z, rotations about axes parallel to z don't count: with u = E_2 x - x,
z . (E_1 E_2 x - x) = (E_1^-1 z) . u + z . (E_1 x - x), so the move by joint k enters with the factor
min(1, |z x z_k| + sum over outer joints l of 2 sin(h_l / 2) |z x z_l|), with |z . z_k| for |z x z_k| where joint k
slides. Where joint i - 1 or i + 1 slides, its own motion of m or f counts as well.
"""

from __future__ import annotations

import numpy as np

from workcell.ik.branch.kernels.arcs import clip_to_band, clip_to_parabola, range_of_band, range_of_parabola
from workcell.ik.branch.kernels.motion import (
    arm,
    ball_radius,
    direction_radius,
    own_slide,
    point_radius,
    sine_between,
)
from workcell.ik.branch.kernels.state import SLACK, Chain, State, dot, tighten
from workcell.jit import exact_inner, exact_kernel
from workcell.pose import Array


@exact_inner
def _along(
    z: Array, x: float, y: float, w: float, extra: float, lines: Array, sweep: Array, first: int, last: int, step: int,
    tilt: float,
) -> tuple[float, float]:  # fmt: skip
    """Move along z of a point (known to `extra`) under joints first, first + step ... before last, outermost first.

    Returns the bound and by how much z has been tilted by them, `tilt` included.
    """
    total, k = 0.0, first
    while k != last:
        if sweep[k] > 0.0:
            if lines[k, 9] > 0.0:
                total += sweep[k] * min(1.0, abs(dot(z, lines[k])) + tilt)
            else:
                sine = sine_between(z[0], z[1], z[2], lines[k])
                reach = arm(x, y, w, lines[k]) + extra
                total += sweep[k] * reach * min(1.0, sine + tilt)
                tilt += sweep[k] * sine
        k += step
    return total, tilt


@exact_kernel
def contract_invariants(chain: Chain, state: State) -> bool:
    """Apply C2 to every joint; False if the box holds no solution."""
    joints = state.lower.shape[0]
    for view in range(2):
        lines, others = state.lines[view], state.lines[1 - view]
        sweep, sweeps = state.sweep[view], state.sweep[1 - view]
        for i in range(1, joints - 1):
            beyond = joints - 2 - i
            m, f = lines[i - 1], others[beyond]
            own = own_slide(lines, sweep, i - 1) + own_slide(others, sweeps, beyond)
            ball = ball_radius(f[3], f[4], f[5], chain.ball) + own
            radius = (
                ball
                + point_radius(f[3], f[4], f[5], lines, sweep, i - 1)
                + point_radius(f[3], f[4], f[5], others, sweeps, beyond)
                + SLACK
            )
            dx, dy, dz = f[3] - m[3], f[4] - m[4], f[5] - m[5]
            length = np.sqrt(dx * dx + dy * dy + dz * dz)
            low, high = max(length - radius, 0.0) ** 2, (length + radius) ** 2
            if not _contract_by_row(chain, state, view, i, 0, low, high):
                return False

            inner, tilt = _along(m[:3], f[3], f[4], f[5], 0.0, lines, sweep, i - 2, -1, -1, 0.0)
            outer, tilt = _along(
                m[:3], f[3], f[4], f[5], 0.0, others, sweeps, 0, beyond, 1, tilt + chain.ball[1]
            )
            radius = min(inner + outer + ball + SLACK, radius)
            value = m[0] * dx + m[1] * dy + m[2] * dz
            if not _contract_by_row(chain, state, view, i, 1, value - radius, value + radius):
                return False
            if view == 0:
                radius = (
                    chain.ball[1]
                    + direction_radius(f[0], f[1], f[2], lines, sweep, i - 1)
                    + direction_radius(f[0], f[1], f[2], others, sweeps, beyond)
                    + SLACK
                )
                value = m[0] * f[0] + m[1] * f[1] + m[2] * f[2]
                if not _contract_by_row(chain, state, view, i, 3, value - radius, value + radius):
                    return False
    return True


@exact_inner
def _contract_by_row(
    chain: Chain, state: State, view: int, i: int, row: int, low: float, high: float
) -> bool:
    """Keep of the joint at index i of a view what brings one of its own invariants into [low, high]."""
    joint = i if view == 0 else state.lower.shape[0] - 1 - i
    a, b, c = state.bands[view, i, row]
    if chain.slides[joint] > 0.0:
        lower, upper = clip_to_parabola(a, b, c, low, high, state.lower[joint], state.upper[joint])
    else:
        lower, upper = clip_to_band(a, b, c, low, high, state.lower[joint], state.upper[joint])
    return lower <= upper and tighten(state, joint, lower, upper)


@exact_kernel
def contract_through(chain: Chain, state: State) -> bool:
    """Apply C3 to every joint; False if the box holds no solution."""
    joints = state.lower.shape[0]
    ranges = np.empty((4, 2))
    for view in range(2):
        for i in range(3, joints - 1):
            joint = i if view == 0 else joints - 1 - i
            for row in range(4):
                a, b, c = state.bands[view, i, row]
                if chain.slides[joint] > 0.0:
                    low, high = range_of_parabola(a, b, c, state.lower[joint], state.upper[joint])
                else:
                    low, high = range_of_band(a, b, c, state.lower[joint], state.upper[joint])
                ranges[row, 0], ranges[row, 1] = low, high
            for j in range(1, i - 1):
                if not _through(chain, state, view, i, j, ranges):
                    return False
    return True


@exact_inner
def _through(chain: Chain, state: State, view: int, i: int, j: int, ranges: Array) -> bool:
    """Contract joint j of a view by the invariants about joint i >= j + 2, whose ranges are given."""
    joints = state.lower.shape[0]
    lines, others = state.lines[view], state.lines[1 - view]
    sweep, sweeps = state.sweep[view], state.sweep[1 - view]
    beyond = joints - 2 - i
    m, f, axis = lines[i - 1], others[beyond], lines[j]
    zm, zf, z = m[:3], f[:3], axis[:3]

    # How far f moves under all joints outside m's side, and m under the joints between j and axis i - 1.
    own = own_slide(lines, sweep, i - 1) + own_slide(others, sweeps, beyond)
    ball = ball_radius(f[3], f[4], f[5], chain.ball) + own
    move_f = (
        ball
        + point_radius(f[3], f[4], f[5], lines, sweep, j)
        + point_radius(f[3], f[4], f[5], others, sweeps, beyond)
        + SLACK
    )
    move_m, turn_m = 0.0, 0.0
    for k in range(j + 1, i - 1):
        move_m += sweep[k] * arm(m[3], m[4], m[5], lines[k])
        turn_m += sweep[k] * sine_between(zm[0], zm[1], zm[2], lines[k])

    fx, fy, fz = f[3] - axis[3], f[4] - axis[4], f[5] - axis[5]
    mx, my, mz = m[3] - axis[3], m[4] - axis[4], m[5] - axis[5]
    dx, dy, dz = fx - mx, fy - my, fz - mz
    slides = axis[9] > 0.0
    radius = move_f + move_m
    low = max(np.sqrt(max(ranges[0, 0], 0.0)) - radius, 0.0) ** 2
    high = (np.sqrt(max(ranges[0, 1], 0.0)) + radius) ** 2
    if slides:
        a, b, c = dx * dx + dy * dy + dz * dz, -2.0 * (z[0] * dx + z[1] * dy + z[2] * dz), 1.0
    else:
        a, b, c = turning(fx, fy, fz, mx, my, mz, z)
        a, b, c = fx * fx + fy * fy + fz * fz + mx * mx + my * my + mz * mz - 2.0 * a, -2.0 * b, -2.0 * c
    if not _contract(state, view, j, slides, a, b, c, low, high):
        return False

    reach = sweep[j] * arm(f[3], f[4], f[5], axis)
    inner, _ = _along(zm, f[3], f[4], f[5], reach, lines, sweep, i - 2, j, -1, 0.0)
    radius = move_f + inner + SLACK
    if slides:
        a, b, c = zm[0] * dx + zm[1] * dy + zm[2] * dz, -dot(zm, z), 0.0
    else:
        a, b, c = turning(fx, fy, fz, zm[0], zm[1], zm[2], z)
        a -= zm[0] * mx + zm[1] * my + zm[2] * mz
    if not _contract(state, view, j, slides, a, b, c, ranges[1, 0] - radius, ranges[1, 1] + radius):
        return False

    reach = sweep[j] * arm(m[3], m[4], m[5], axis)
    outer, tilt = _along(zf, m[3], m[4], m[5], reach, others, sweeps, beyond - 1, -1, -1, 0.0)
    inner, tilt = _along(zf, m[3], m[4], m[5], reach, lines, sweep, 0, j, 1, tilt + chain.ball[1])
    ball = ball_radius(m[3], m[4], m[5], chain.ball) + chain.ball[1] * reach * (1.0 + chain.ball[1])
    radius = outer + inner + ball + own + move_m + SLACK
    if slides:
        a, b, c = zf[0] * dx + zf[1] * dy + zf[2] * dz, -dot(zf, z), 0.0
    else:
        a, b, c = turning(zf[0], zf[1], zf[2], mx, my, mz, z)
        a, b, c = zf[0] * fx + zf[1] * fy + zf[2] * fz - a, -b, -c
    if not _contract(state, view, j, slides, a, b, c, ranges[2, 0] - radius, ranges[2, 1] + radius):
        return False

    radius = (
        chain.ball[1]
        + turn_m
        + direction_radius(zf[0], zf[1], zf[2], lines, sweep, j)
        + direction_radius(zf[0], zf[1], zf[2], others, sweeps, beyond)
        + SLACK
    )
    if slides:
        a, b, c = dot(zf, zm), 0.0, 0.0
    else:
        a, b, c = turning(zf[0], zf[1], zf[2], zm[0], zm[1], zm[2], z)
    return _contract(state, view, j, slides, a, b, c, ranges[3, 0] - radius, ranges[3, 1] + radius)


@exact_inner
def turning(
    ux: float, uy: float, uz: float, vx: float, vy: float, vz: float, z: Array
) -> tuple[float, float, float]:
    """(a, b, c) of u . E(t) v = a + b cos t + c sin t, with E(t) the rotation by t about the unit direction z."""
    along = (ux * z[0] + uy * z[1] + uz * z[2]) * (vx * z[0] + vy * z[1] + vz * z[2])
    cosine = ux * vx + uy * vy + uz * vz - along
    sine = ux * (z[1] * vz - z[2] * vy) + uy * (z[2] * vx - z[0] * vz) + uz * (z[0] * vy - z[1] * vx)
    return along, cosine, sine


@exact_inner
def _contract(
    state: State, view: int, j: int, slides: bool, a: float, b: float, c: float, low: float, high: float
) -> bool:
    """Keep of the joint at index j of a view the departures t at which a function lies in [low, high].

    It is a + b cos t + c sin t, or a + b t + c t^2.
    """
    joint = j if view == 0 else state.lower.shape[0] - 1 - j
    centre = state.centre[joint]
    # From the target the joint moves the other way.
    first, last = state.lower[joint] - centre, state.upper[joint] - centre
    if slides:
        lower, upper = clip_to_parabola(a, b if view == 0 else -b, c, low, high, first, last)
    else:
        lower, upper = clip_to_band(a, b, c if view == 0 else -c, low, high, first, last)
    return lower <= upper and tighten(state, joint, centre + lower, centre + upper)
