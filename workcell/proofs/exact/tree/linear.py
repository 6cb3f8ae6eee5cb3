"""The closure of the chain at a middle link, to first order with remainders (6.7, *linear*).

With E_j a turn about line j by dq_j, links seen at the middles of the boxes: E_1 ... E_m = D E'_n ... E'_(m+1) C, C
what the two sides differ by. For a point p of link m, and for the rotations' skew parts,

    sum dq_j z_j x (p - o_j) = p_target - p_base + error,        sum dq_j z_j = skew(C) + error

over all joints, each line seen from its own side (which is where E'_j = a turn by -dq_j has gone). Second
derivatives of a side by joints i, j are no longer than the distance from the line of that one of the two which is
nearer to p, as far as it can get; so the first error is at most half of sum h_i h_j dist, and the ball. The second
is at most half of (sum h)^2 for either side, (sum of the target's h) |C - I|, and A.
"""

from __future__ import annotations

import numpy as np

from workcell.proofs.exact.tree.fixed import ONE, SHIFT, Ints, cross, down, root_up, up
from workcell.proofs.exact.tree.relations import Blur
from workcell.proofs.exact.tree.views import FixedArm, View

LARGEST_SUM = 3 * ONE // 2
"""Radians that the half widths of a box may sum to: beyond that, remainders say nothing, and overflow."""
_LARGEST_ERROR = 4 * ONE
_WEIGHTS = 28
_LONGEST = 2 * ONE
"""No place of the arm is farther from one of its lines: all of the chain together is a unit long."""


def narrow(arm: FixedArm, base: View, target: View, low: Ints, high: Ints, blur: Blur) -> tuple[Ints, Ints]:
    """Ends of the boxes that still hold every candidate; low > high where there is none.

    The halves of a box sum to `LARGEST_SUM` at most.
    """
    middle = (low + high) >> 1
    half = np.maximum(high - middle, middle - low)
    n = arm.joints
    m = (n + 1) // 2
    near_side = np.arange(n)[:, None] < m
    p, other = base.far[:, m], target.far[:, m]
    axis = np.where(near_side, base.along[:, 1:-1], target.along[:, 1:-1])
    point = np.where(near_side, base.near[:, 1:-1], target.near[:, 1:-1])
    columns = down(cross(axis, np.where(near_side, p[:, None], other[:, None]) - point))
    right_position, right_rotation, mismatch = other - p, *_skew(base.rotation[m], target.rotation[m])

    slack = 8 * arm.error
    lever = root_up((columns * columns).sum(axis=0)) + slack
    sums = half.sum(axis=0)
    near_sum = half[:m].sum(axis=0)
    far_sum = sums - near_sum
    from_pole = other - arm.pole[:, None]
    strayed = root_up((from_pole * from_pole).sum(axis=0)) + slack + up(half[m:] * lever[m:]).sum(axis=0)
    error_position = _second_order(half, lever, m) + blur.position + up(blur.rotation * strayed)
    error_position += slack + up(slack * sums)
    error_rotation = (up(near_sum * near_sum) + up(far_sum * far_sum) + 1) // 2 + up(far_sum * mismatch)
    error_rotation += blur.rotation + slack + up(slack * sums)

    small = error_position <= _LARGEST_ERROR
    error_position = np.minimum(error_position, _LARGEST_ERROR)
    weights = _weights(columns, axis, half, error_position, error_rotation)
    position, rotation = weights[:, :3], weights[:, 3:]
    rows = (position[:, :, None] * columns[None]).sum(axis=1) + (rotation[:, :, None] * axis[None]).sum(
        axis=1
    )
    rows >>= _WEIGHTS
    right = (position * right_position[None]).sum(axis=1) + (rotation * right_rotation[None]).sum(axis=1)
    right >>= _WEIGHTS
    error = up((root_up((position**2).sum(axis=1)) << SHIFT - _WEIGHTS) * error_position)
    error += up((root_up((rotation**2).sum(axis=1)) << SHIFT - _WEIGHTS) * error_rotation)
    others = up((np.abs(rows) + 1) * half[None])
    own = np.arange(n)
    pivot = rows[own, own]
    error += others.sum(axis=1) - others[own, own] + 8  # 8: the roundings of the pivot and of the right side
    usable = small & (pivot > ONE >> 10) & (np.abs(right) + error < _LARGEST_ERROR)
    divisor = np.where(usable, pivot, ONE)
    least = middle + (np.where(usable, right - error, 0) << SHIFT) // divisor
    most = middle - (np.where(usable, -right - error, 0) << SHIFT) // divisor
    return np.where(usable, np.maximum(low, least), low), np.where(usable, np.minimum(high, most), high)


def _skew(near: Ints, far: Ints) -> tuple[Ints, Ints]:
    """Half of C - C^T as a vector, and the size of C - I, rounded up; C = far near^T."""
    c = down((far[:, None] * near[None]).sum(axis=2))
    skew = np.stack([c[2, 1] - c[1, 2], c[0, 2] - c[2, 0], c[1, 0] - c[0, 1]]) >> 1
    c[np.arange(3), np.arange(3)] -= ONE
    c >>= 1  # its square is up to 8, and does not fit; halving rounds each of nine entries by less than 1
    return skew, 2 * root_up((c * c).sum(axis=(0, 1))) + 6


def _second_order(half: Ints, lever: Ints, m: int) -> Ints:
    """Half of the sum of h_i h_j times the lever of the one nearer to the middle link, stretched by what moves it."""
    error = np.zeros(half.shape[1], dtype=np.int64)
    for side in (range(m - 1, -1, -1), range(m, len(half))):  # from the middle link outwards
        stretched = np.zeros_like(error)
        beyond = half[side.start : side.stop if side.step > 0 else None : side.step].sum(axis=0)
        for j in side:
            beyond = beyond - half[j]
            weight = up(half[j] * (half[j] // 2 + 1 + beyond))
            error += up(weight * np.minimum(lever[j] + stretched, _LONGEST))
            stretched = stretched + up(half[j] * lever[j])
    return error


def _weights(columns: Ints, axis: Ints, half: Ints, error_position: Ints, error_rotation: Ints) -> Ints:
    """(n, 6, N) combinations of the six equations, one for each joint, in 2^-28: a guess.

    Regularised least squares: what is left of the other joints, and of the errors, is small together.
    """
    jacobian = np.concatenate([columns, axis]).transpose(2, 0, 1) / ONE
    spread = jacobian * (half.T[:, None, :] / ONE)
    errors = np.repeat(np.stack([error_position, error_rotation], axis=1) / ONE, 3, axis=1)
    normal = spread @ spread.transpose(0, 2, 1)
    normal[:, np.arange(6), np.arange(6)] += errors**2 + 1e-18
    weights = np.linalg.solve(normal, jacobian)
    weights /= np.abs(weights).max(axis=1, keepdims=True) + 1e-300
    weights = np.where(np.isfinite(weights), weights, 0.0)
    rounded: Ints = np.rint(weights * 0.5 * (1 << _WEIGHTS)).astype(np.int64).transpose(2, 1, 0)
    return rounded
