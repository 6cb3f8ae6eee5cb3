"""The closure of the chain to first order, with remainders: each joint is bounded by the others (6.7, *linear*).

With E_j a turn about line j by dq_j, and links seen at the middles of the boxes, what is fixed to link m closes the
chain: E_1 ... E_m p = D E'_n ... E'_(m+1) p', where p is a place or a direction as the base sees it, p' the same as
the target sees it, and E'_j a turn by -dq_j. To first order, each line seen from its own side,

    sum dq_j z_j x (p - o_j) = p' - p + error            (of directions: z_j x p)

The second derivative of a side by joints i and j is no longer than the lever of that one of the two that is nearer
to p: its distance from the line (of directions: the sine of the angle), as large as the joints between can make it.
So the error is at most half of the sum of h_i h_j levers, and the ball. A joint that hardly moves p is left out,
and what it moves is error too. With whole rotations, E_1 ... E_m = D E'_n ... E'_(m+1) C, and of skew parts

    sum dq_j z_j = skew(C) + error

up to half of (sum h)^2 for either side, (sum of the target's h) |C - I|, and A.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from workcell.proofs.exact.tree.fixed import ONE, SHIFT, Flags, Ints, cross, down, root_up, up
from workcell.proofs.exact.tree.relations import Blur
from workcell.proofs.exact.tree.views import FixedArm, View

LARGEST_SUM = 3 * ONE // 2
"""Radians that the half widths of moving joints may sum to: beyond, remainders say nothing, and overflow."""
_LARGEST_ERROR = 4 * ONE
_WEIGHTS = 28
_LONGEST = 2 * ONE
"""No place of the arm is farther from one of its lines: all of the chain together is a unit long."""
_STILL = ONE >> 14
"""A joint with a shorter lever is left out."""


@dataclass(frozen=True, slots=True)
class Equations:
    """Three equations of each of N boxes: sum dq_j columns_j = right, up to an error of that length.

    Attributes:
        columns: (3, n, N); zero where a joint is left out.
        right: (3, N).
        error: (N,).
        moving: (n, N) which joints are not left out.
    """

    columns: Ints
    right: Ints
    error: Ints
    moving: Flags


def place(arm: FixedArm, base: View, target: View, half: Ints, blur: Blur, line: int) -> Equations:
    """A point of a line, between 1 and n."""
    p, other = base.far[:, line], target.far[:, line]
    near_side = np.arange(arm.joints)[:, None] < line
    arms = np.where(near_side, p[:, None] - base.near[:, 1:-1], other[:, None] - target.near[:, 1:-1])
    columns = _columns(base, target, arms, line)
    from_pole = other - arm.pole[:, None]
    away = root_up((from_pole * from_pole).sum(axis=0))
    return _closed(arm, columns, other - p, half, line, blur, away)


def direction(arm: FixedArm, base: View, target: View, half: Ints, blur: Blur, line: int) -> Equations:
    """The direction of a line, between 1 and n."""
    u, other = base.along[:, line], target.along[:, line]
    near_side = np.arange(arm.joints)[:, None] < line
    columns = _columns(base, target, np.where(near_side, u[:, None], other[:, None]), line)
    return _closed(arm, columns, other - u, half, line, Blur(blur.rotation, 0), np.zeros_like(u[0]))


def rotation(arm: FixedArm, base: View, target: View, half: Ints, blur: Blur, line: int) -> Equations:
    """The rotation of the link that follows a line."""
    near_side = np.arange(arm.joints)[:, None] < line
    axis = np.where(near_side, base.along[:, 1:-1], target.along[:, 1:-1])
    right, mismatch = _skew(base.rotation[line], target.rotation[line])
    slack, few = 8 * arm.error, np.minimum(half, LARGEST_SUM)
    near, far = np.minimum(few[:line].sum(axis=0), 2 * ONE), np.minimum(few[line:].sum(axis=0), 2 * ONE)
    error = (up(near * near) + up(far * far) + 1) // 2 + up(far * mismatch)
    error += blur.rotation + slack + up(slack * (near + far))
    return Equations(axis, right, error, np.ones(half.shape, dtype=bool))


def _columns(base: View, target: View, arms: Ints, line: int) -> Ints:
    near_side = np.arange(arms.shape[1])[:, None] < line
    axis = np.where(near_side, base.along[:, 1:-1], target.along[:, 1:-1])
    columns = down(cross(axis, arms))
    columns[:, line - 1] = 0  # the line's own joint leaves it alone
    return columns


def _closed(
    arm: FixedArm, columns: Ints, right: Ints, half: Ints, line: int, blur: Blur, away: Ints
) -> Equations:
    """Equations with the remainders of both sides; `away` is how far the point is from the target's pole."""
    slack = 5 * arm.error
    lever = root_up((columns * columns).sum(axis=0)) + slack
    lever[line - 1] = 0
    chord = np.minimum(half, 2 * ONE)
    step = up(chord * lever)
    n = len(half)
    moving = np.zeros(half.shape, dtype=bool)
    error = np.zeros(half.shape[1], dtype=np.int64)
    for side in (range(line - 1, -1, -1), range(line, n)):  # from the line outwards
        stretched = np.zeros_like(error)
        for j in side:
            longest = np.minimum(lever[j] + stretched, _LONGEST)
            moving[j] = longest > _STILL
            error += np.where(moving[j], 0, up(chord[j] * longest))
            stretched = stretched + step[j]
    few = np.where(moving, np.minimum(half, LARGEST_SUM), 0)
    sums = np.minimum(few.sum(axis=0), 2 * ONE)
    for side in (range(line - 1, -1, -1), range(line, n)):
        stretched = np.zeros_like(error)
        beyond = np.minimum(few[min(side) : max(side) + 1].sum(axis=0), 2 * ONE) if side else stretched
        for j in side:
            beyond = np.maximum(beyond - few[j], 0)
            weight = up(few[j] * (few[j] // 2 + 1 + beyond))
            error += up(np.minimum(weight, _LONGEST) * np.minimum(lever[j] + stretched, _LONGEST))
            stretched = stretched + step[j]
    strayed = np.minimum(away + slack + step[line:].sum(axis=0), _LONGEST)
    error += blur.position + up(blur.rotation * strayed) + 2 * slack + up(2 * slack * sums)
    return Equations(np.where(moving, columns, 0), right, error, moving)


def narrow(blocks: list[Equations], middle: Ints, low: Ints, high: Ints) -> tuple[Ints, Ints]:
    """Ends of the boxes that still hold every candidate; low > high where there is none."""
    half = np.maximum(high - middle, middle - low)
    moving = np.any([block.moving for block in blocks], axis=0)
    half = np.where(moving, np.minimum(half, 2 * LARGEST_SUM), 0)
    usable = half.sum(axis=0) <= LARGEST_SUM
    for block in blocks:
        usable = usable & (block.error <= _LARGEST_ERROR)
    half = np.where(usable, half, 0)
    errors = [np.minimum(block.error, _LARGEST_ERROR) for block in blocks]
    columns = np.concatenate([block.columns for block in blocks])
    weights = _weights(columns, half, errors)
    n, count = half.shape
    rows = np.zeros((n, n, count), dtype=np.int64)
    right = np.zeros((n, count), dtype=np.int64)
    error = np.zeros((n, count), dtype=np.int64)
    for k, block in enumerate(blocks):
        weight = weights[:, 3 * k : 3 * k + 3]
        rows += (weight[:, :, None] * block.columns[None]).sum(axis=1)
        right += (weight * block.right[None]).sum(axis=1)
        size = root_up((weight * weight).sum(axis=1)) << SHIFT - _WEIGHTS
        error += up(size * errors[k])
    rows >>= _WEIGHTS
    right >>= _WEIGHTS
    own = np.arange(n)
    pivot = rows[own, own]
    others = up((np.abs(rows) + 1) * half[None])
    error += others.sum(axis=1) - others[own, own] + 8  # 8: the roundings of the pivot and of the right side
    told = usable & (pivot > ONE >> 10) & (np.abs(right) + error < _LARGEST_ERROR)
    divisor = np.where(told, pivot, ONE)
    least = middle + (np.where(told, right - error, 0) << SHIFT) // divisor
    most = middle - (np.where(told, -right - error, 0) << SHIFT) // divisor
    return np.where(told, np.maximum(low, least), low), np.where(told, np.minimum(high, most), high)


def _skew(near: Ints, far: Ints) -> tuple[Ints, Ints]:
    """Half of C - C^T as a vector, and the size of C - I, rounded up; C = far near^T."""
    c = down((far[:, None] * near[None]).sum(axis=2))
    skew = np.stack([c[2, 1] - c[1, 2], c[0, 2] - c[2, 0], c[1, 0] - c[0, 1]]) >> 1
    c[np.arange(3), np.arange(3)] -= ONE
    c >>= 1  # its square is up to 8, and does not fit; halving rounds each of nine entries by less than 1
    return skew, 2 * root_up((c * c).sum(axis=(0, 1))) + 6


def _weights(columns: Ints, half: Ints, errors: list[Ints]) -> Ints:
    """(n, equations, N) combinations of the equations, one for each joint, in 2^-28, none longer than one: a guess.

    Regularised least squares: what is left of the other joints, and of the errors, is small together.
    """
    jacobian = columns.transpose(2, 0, 1) / ONE
    spread = jacobian * (half.T[:, None, :] / ONE)
    each = np.repeat(np.stack(errors, axis=1) / ONE, 3, axis=1)
    normal = spread @ spread.transpose(0, 2, 1)
    diagonal = np.arange(len(columns))
    normal[:, diagonal, diagonal] += each**2 + 1e-18
    weights = np.linalg.solve(normal, jacobian)
    weights /= 2.0 * np.abs(weights).max(axis=1, keepdims=True) + 1e-300
    weights = np.where(np.isfinite(weights), weights, 0.0)
    rounded: Ints = np.rint(weights * (1 << _WEIGHTS)).astype(np.int64).transpose(2, 1, 0)
    return rounded
