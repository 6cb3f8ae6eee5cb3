"""What the kernels share: the chain, the box under examination, and the axes as seen from both ends.

Joint `k` of the kernels runs from 0 to N - 1 = n + 1: joints 0 and n + 1 stand still and carry a line fixed to the base
and one fixed to the tool, so that both ends of the chain take part in every inequality between axes.
Every joint turns about, or slides along, the z axis of its frame. *View* 0 counts joints from the base, view 1 from
the target; what is known at index k of one view belongs to index N - 1 - k of the other.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from workcell.jit import exact_inner, exact_kernel
from workcell.pose import Array

SLACK = 1e-12
"""Added to every bound for rounding: lengths are metres below 10, so doubles err by 1e-14."""


class Chain(NamedTuple):
    """The robot and its target.

    Attributes:
        fixed: (N, 12) joint frame in the frame before it: rotation (9, row-major), position (3).
        feet: (N, 2) where along its axis each joint comes closest to the axis before and after it.
        slides: (N,) 1 for a prismatic joint, 0 for a revolute one.
        around: (N, 4, 3) per joint i, in its frame without its own motion, point and direction of axis i - 1, and in
            the frame it carries those of axis i + 1.
        weights: (2, N) how much a joint's width counts when a box is split: before the linear step works, and after.
        middle: the joint at whose link the linear step closes the loop.
        turns: whether the target's rotation counts; else only its position is known.
        goal: (12,) wanted frame of joint N - 1.
        ball: (5,) radius of the target's position (m) and rotation (rad) and the point it turns about (3).
        follows: (f, 2) joints that follow others by a polynomial, and those that lead them.
        polynomials: (f, d + 1) what they follow by, in rising powers.
    """

    fixed: Array
    feet: Array
    slides: Array
    around: Array
    weights: Array
    middle: int
    turns: bool
    goal: Array
    ball: Array
    follows: NDArray[np.int64]
    polynomials: Array


class State(NamedTuple):
    """A box of joint angles and the chain at a configuration inside it.

    Attributes:
        lower, upper, centre: (N,) the box, and the angles at which everything below was computed.
        sweep: (2, N) per view the chord 2 sin(h / 2) of the largest departure h from `centre`; h of a sliding joint.
        frames: (2, N, 12) link frames at `centre` in joint order, from the base and from the target.
        lines: (2, N, 10) per view the axis' direction, its point nearest the previous axis, and nearest the next; and
            1 for a sliding joint. The points belong to the link that the joint moves.
        bands: (2, N, 4, 3) per view and joint i the coefficients (a, b, c) of a + b cos q + c sin q, or of
            a + b q + c q^2 for a sliding joint, of the invariants between its neighbours' axes, see `invariants`.
        tangent: (n + 1, 12 + N) the linear step's result, see `linear.contract_linear`.
    """

    lower: Array
    upper: Array
    centre: Array
    sweep: Array
    frames: Array
    lines: Array
    bands: Array
    tangent: Array


@exact_kernel
def new_state(chain: Chain) -> State:
    """Room for the boxes of a chain."""
    joints = chain.slides.shape[0]
    state = State(
        np.zeros(joints),
        np.zeros(joints),
        np.zeros(joints),
        np.zeros((2, joints)),
        np.zeros((2, joints, 12)),
        np.zeros((2, joints, 10)),
        np.zeros((2, joints, 4, 3)),
        np.zeros((joints - 1, 12 + joints)),
    )
    for k in range(joints):
        state.lines[0, k, 9] = state.lines[1, joints - 1 - k, 9] = chain.slides[k]
    for i in range(1, joints - 1):
        _set_bands(chain, state, i, 0.0)
    return state


@exact_kernel
def recentre(chain: Chain, state: State) -> None:
    """Move `centre` to the box's middle and compute the frames and lines there; what `tangent` said is void."""
    joints = state.lower.shape[0]
    state.tangent[0, 0] = 0.0
    for k in range(joints):
        state.centre[k] = 0.5 * (state.lower[k] + state.upper[k])
        _set_sweep(state, k)
        if chain.slides[k] > 0.0 and k > 1:
            _set_bands(chain, state, k - 1, state.centre[k])
    place(chain, state.centre, state.frames)
    for k in range(joints):
        back = joints - 1 - k
        for side in range(2):
            frame, line = state.frames[side, k], state.lines[side, k if side == 0 else back]
            near, far = chain.feet[k, side], chain.feet[k, 1 - side]
            for a in range(3):
                z = frame[3 * a + 2]
                line[a] = z
                line[3 + a] = frame[9 + a] + near * z
                line[6 + a] = frame[9 + a] + far * z


@exact_inner
def _set_sweep(state: State, k: int) -> None:
    half = max(state.upper[k] - state.centre[k], state.centre[k] - state.lower[k])
    chord = 0.0
    if half > 0.0:
        # The chord is never longer than the arc, and hardly shorter where that is short.
        flat = half < 0.2 or state.lines[0, k, 9] > 0.0
        chord = (half if flat else 2.0 * np.sin(0.5 * min(half, np.pi))) + SLACK
    state.sweep[0, k] = chord
    state.sweep[1, state.lower.shape[0] - 1 - k] = chord


@exact_inner
def _set_bands(chain: Chain, state: State, i: int, slid: float) -> None:
    """The invariants about joint i, when the next joint has slid by `slid`."""
    around = chain.around[i]
    y, zy, zx = around[0], around[1], around[3]
    x = around[2] + slid * zx
    back = chain.slides.shape[0] - 1 - i
    bands = np.empty((4, 3))
    if chain.slides[i] > 0.0:
        d = x - y
        bands[0] = (dot(d, d), 2.0 * d[2], 1.0)
        bands[1] = (dot(zy, d), zy[2], 0.0)
        bands[2] = (dot(zx, d), zx[2], 0.0)
        bands[3] = (dot(zy, zx), 0.0, 0.0)
    else:
        _turning(y, x, bands[0])
        bands[0] *= -2.0
        bands[0, 0] += dot(x, x) + dot(y, y)
        _turning(zy, x, bands[1])
        bands[1, 0] -= dot(zy, y)
        _turning(y, zx, bands[2])
        bands[2] *= -1.0
        bands[2, 0] += dot(zx, x)
        _turning(zy, zx, bands[3])
    state.bands[0, i] = bands
    state.bands[1, back, 0], state.bands[1, back, 3] = bands[0], bands[3]
    state.bands[1, back, 1], state.bands[1, back, 2] = -bands[2], -bands[1]


@exact_inner
def dot(u: Array, v: Array) -> float:
    """Scalar product."""
    return u[0] * v[0] + u[1] * v[1] + u[2] * v[2]  # type: ignore[no-any-return]


@exact_inner
def _turning(u: Array, v: Array, out: Array) -> None:
    """(a, b, c) of u . Rz(t) v = a + b cos t + c sin t."""
    out[0], out[1], out[2] = u[2] * v[2], u[0] * v[0] + u[1] * v[1], u[1] * v[0] - u[0] * v[1]


@exact_inner
def tighten(state: State, k: int, lower: float, upper: float) -> bool:
    """Intersect joint k's interval with [lower, upper]; False if nothing is left."""
    if lower - SLACK > state.lower[k]:
        state.lower[k] = lower - SLACK
    if upper + SLACK < state.upper[k]:
        state.upper[k] = upper + SLACK
    if state.lower[k] > state.upper[k]:
        return False
    _set_sweep(state, k)
    return True


@exact_inner
def place(chain: Chain, q: Array, frames: Array) -> None:
    """Frames of all joints at `q` (N,), from the base (frames[0]) and, backwards, from the target (frames[1])."""
    joints = q.shape[0]
    forward(chain, q, frames[0])
    back = frames[1]
    back[joints - 1] = chain.goal
    for k in range(joints - 1, 0, -1):
        f, B, P = chain.fixed[k], back[k], back[k - 1]
        angle, slid = (0.0, q[k]) if chain.slides[k] > 0.0 else (q[k], 0.0)
        cosine, sine = np.cos(angle), np.sin(angle)
        for a in range(3):
            x = B[3 * a] * cosine - B[3 * a + 1] * sine
            y = B[3 * a] * sine + B[3 * a + 1] * cosine
            z = B[3 * a + 2]
            for b in range(3):
                P[3 * a + b] = x * f[3 * b] + y * f[3 * b + 1] + z * f[3 * b + 2]
        for a in range(3):
            origin = B[9 + a] - slid * B[3 * a + 2]
            P[9 + a] = origin - P[3 * a] * f[9] - P[3 * a + 1] * f[10] - P[3 * a + 2] * f[11]


@exact_inner
def forward(chain: Chain, q: Array, frames: Array) -> None:
    """Frames (N, 12) of all joints at `q` (N,), from the base."""
    for k in range(q.shape[0]):
        f, F = chain.fixed[k], frames[k]
        angle, slid = (0.0, q[k]) if chain.slides[k] > 0.0 else (q[k], 0.0)
        cosine, sine = np.cos(angle), np.sin(angle)
        for a in range(3):
            if k == 0:
                x, y, z, p = f[3 * a], f[3 * a + 1], f[3 * a + 2], f[9 + a]
            else:
                P = frames[k - 1]
                u, v, w = P[3 * a], P[3 * a + 1], P[3 * a + 2]
                x = u * f[0] + v * f[3] + w * f[6]
                y = u * f[1] + v * f[4] + w * f[7]
                z = u * f[2] + v * f[5] + w * f[8]
                p = P[9 + a] + u * f[9] + v * f[10] + w * f[11]
            F[3 * a] = x * cosine + y * sine
            F[3 * a + 1] = y * cosine - x * sine
            F[3 * a + 2] = z
            F[9 + a] = p + slid * z
