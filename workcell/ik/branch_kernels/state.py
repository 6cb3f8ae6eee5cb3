"""What the kernels share: the chain, the box under examination, and the axes as seen from both ends.

Joint `k` of the kernels runs from 0 to N - 1 = n + 1: joints 0 and n + 1 stand still and carry a line fixed to the base
and one fixed to the tool, so that both ends of the chain take part in every inequality between axes.
Every joint's axis is the z axis of its frame. *View* 0 counts joints from the base, view 1 from the target; what is
known at index k of one view belongs to index N - 1 - k of the other.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import NamedTuple, TypeVar, cast

import numpy as np
from numba import njit

from workcell.pose import Array

Function = TypeVar("Function", bound=Callable[..., object])

SLACK = 1e-12
"""Added to every bound for rounding: lengths are metres below 10, so doubles err by 1e-14."""


def kernel(function: Function) -> Function:
    """Compile on first use, cached on disk. No fast-math: the bounds are proofs."""
    return cast(Function, njit(cache=True, nogil=True, error_model="numpy")(function))


def inner(function: Function) -> Function:
    """The same for what only other kernels call: the wrappers for Python are left out, they take long to compile."""
    compiled = njit(
        cache=True, nogil=True, error_model="numpy", no_cpython_wrapper=True, no_cfunc_wrapper=True
    )
    return cast(Function, compiled(function))


class Chain(NamedTuple):
    """The robot and its target.

    Attributes:
        fixed: (N, 12) joint frame in the frame before it: rotation (9, row-major), position (3).
        feet: (N, 2) where along its axis each joint comes closest to the axis before and after it.
        bands: (2, N, 4, 3) per view and joint i the coefficients (a, b, c) of a + b cos q + c sin q of the invariants
            between its neighbours' axes, see `invariants`.
        goal: (12,) wanted frame of joint N - 1.
        ball: (5,) radius of the target's position (m) and rotation (rad) and the point it turns about (3).
    """

    fixed: Array
    feet: Array
    bands: Array
    goal: Array
    ball: Array


class State(NamedTuple):
    """A box of joint angles and the chain at a configuration inside it.

    Attributes:
        lower, upper, centre: (N,) the box, and the angles at which everything below was computed.
        sweep: (2, N) per view the chord 2 sin(h / 2) of the largest departure h from `centre`.
        frames: (2, N, 12) link frames at `centre` in joint order, from the base and from the target.
        lines: (2, N, 9) per view the axis' direction, its point nearest the previous axis, and nearest the next.
        tangent: (n + 1, 12) the linear step's result, see `linear.contract_linear`.
    """

    lower: Array
    upper: Array
    centre: Array
    sweep: Array
    frames: Array
    lines: Array
    tangent: Array


@kernel
def new_state(joints: int) -> State:
    """Room for a chain of N joints, the two fixed ones included."""
    return State(
        np.zeros(joints),
        np.zeros(joints),
        np.zeros(joints),
        np.zeros((2, joints)),
        np.zeros((2, joints, 12)),
        np.zeros((2, joints, 9)),
        np.zeros((joints - 1, 12)),
    )


@kernel
def recentre(chain: Chain, state: State) -> None:
    """Move `centre` to the box's middle and compute the frames and lines there; what `tangent` said is void."""
    joints = state.lower.shape[0]
    state.tangent[0, 0] = 0.0
    for k in range(joints):
        state.centre[k] = 0.5 * (state.lower[k] + state.upper[k])
        _set_sweep(state, k)
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


@inner
def _set_sweep(state: State, k: int) -> None:
    half = max(state.upper[k] - state.centre[k], state.centre[k] - state.lower[k])
    chord = 2.0 * np.sin(0.5 * min(half, np.pi)) + SLACK if half > 0.0 else 0.0
    state.sweep[0, k] = chord
    state.sweep[1, state.lower.shape[0] - 1 - k] = chord


@inner
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


@inner
def place(chain: Chain, q: Array, frames: Array) -> None:
    """Frames of all joints at `q` (N,), from the base (frames[0]) and, backwards, from the target (frames[1])."""
    joints = q.shape[0]
    forward(chain.fixed, q, frames[0])
    back = frames[1]
    back[joints - 1] = chain.goal
    for k in range(joints - 1, 0, -1):
        f, B, P = chain.fixed[k], back[k], back[k - 1]
        cosine, sine = np.cos(q[k]), np.sin(q[k])
        for a in range(3):
            x = B[3 * a] * cosine - B[3 * a + 1] * sine
            y = B[3 * a] * sine + B[3 * a + 1] * cosine
            z = B[3 * a + 2]
            for b in range(3):
                P[3 * a + b] = x * f[3 * b] + y * f[3 * b + 1] + z * f[3 * b + 2]
        for a in range(3):
            P[9 + a] = B[9 + a] - P[3 * a] * f[9] - P[3 * a + 1] * f[10] - P[3 * a + 2] * f[11]


@inner
def forward(fixed: Array, q: Array, frames: Array) -> None:
    """Frames (N, 12) of all joints at `q` (N,), from the base."""
    for k in range(q.shape[0]):
        f, F = fixed[k], frames[k]
        cosine, sine = np.cos(q[k]), np.sin(q[k])
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
            F[9 + a] = p
