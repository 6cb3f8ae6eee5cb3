"""The steps of PJ-IK, HJCD-IK's second phase as published: weights, the damped step, the dogleg.

Section IV-B, Eqs. 12-15 of HJCD-IK (see `workcell.ik.hjcd.solver`). The paper says of W that it "normalizes the rows
of the Jacobian and adaptively scales the translational and rotational components of the residual", no more; the
scale here is ours, and D is the identity.
"""

from __future__ import annotations

import math

from workcell.jit import kernel
from workcell.kernels.cholesky import factor6, gram, solve6
from workcell.pose import Array

LEAST_SHARE = 0.2
"""Of position and rotation, the smaller error's scale; the two scales add up to 2."""
_FLAT = 1e-3
"""Rows shorter than this share of the longest of their kind are not made longer than by it."""


@kernel
def weigh(J: Array, e: Array, w: Array) -> None:
    """The diagonal of W into w (6,), for a Jacobian J (6, n) and its residual e (6,): position rows, rotation rows.

    Each row of J is divided by its length; then position and rotation are scaled by their shares of the residual, so
    that the larger error comes first.
    """
    position = math.sqrt(e[0] * e[0] + e[1] * e[1] + e[2] * e[2])
    rotation = math.sqrt(e[3] * e[3] + e[4] * e[4] + e[5] * e[5])
    share = min(max(2.0 * position / max(position + rotation, 1e-300), LEAST_SHARE), 2.0 - LEAST_SHARE)
    for first in (0, 3):
        longest = 1e-300
        for r in range(first, first + 3):
            total = 0.0
            for k in range(J.shape[1]):
                total += J[r, k] * J[r, k]
            w[r] = math.sqrt(total)
            longest = max(longest, w[r])
        scale = share if first == 0 else 2.0 - share
        for r in range(first, first + 3):
            w[r] = scale / max(w[r], _FLAT * longest)


@kernel
def apply_weights(w: Array, J: Array, e: Array) -> float:
    """J_w = W J and e_w = W e, in place; returns |e_w|^2."""
    total = 0.0
    for r in range(6):
        e[r] *= w[r]
        total += e[r] * e[r]
        for k in range(J.shape[1]):
            J[r, k] *= w[r]
    return total


@kernel
def damped_step(J: Array, e: Array, damping: float, radius: float, A: Array, y: Array, step: Array) -> bool:
    """The step (n,) of (J^T J + damping I) step = J^T e (Eq. 12), no longer than `radius`.

    By (J J^T + damping I) y = e and step = J^T y, which is the same and has six unknowns for any n. A (6, 6) and y (6,)
    are room. False where rounding leaves no factor.
    """
    gram(J, damping, A)
    if not factor6(A):
        return False
    solve6(A, e, y)
    square = 0.0
    for k in range(step.shape[0]):
        total = 0.0
        for r in range(6):
            total += J[r, k] * y[r]
        step[k] = total
        square += total * total
    if square > radius * radius:
        share = radius / math.sqrt(square)
        for k in range(step.shape[0]):
            step[k] *= share
    return True


@kernel
def dogleg(gradient: Array, image: float, newton: Array, radius: float, step: Array) -> None:
    """The point (n,) at `radius` on the path from zero over the steepest descent's best to the Gauss-Newton step.

    Eqs. 14-15: the first leg ends at (g.g / |J g|^2) g. The end of the path where it is no longer than `radius`.

    Args:
        gradient: (n,) g = J^T e.
        image: |J g|^2.
        newton: (n,) Gauss-Newton step.
        radius: of the trust region.
        step: (n,) where it goes.
    """
    n = gradient.shape[0]
    square, whole = 0.0, 0.0
    for k in range(n):
        square += gradient[k] * gradient[k]
        whole += newton[k] * newton[k]
    if whole <= radius * radius:
        for k in range(n):
            step[k] = newton[k]
        return
    steepest = square / max(image, 1e-300)
    if steepest * math.sqrt(square) >= radius:
        for k in range(n):
            step[k] = radius / math.sqrt(square) * gradient[k]
        return
    # |c + b d| = radius with c the corner of the path and d the second leg
    dd, cd, cc = 0.0, 0.0, steepest * steepest * square
    for k in range(n):
        leg = newton[k] - steepest * gradient[k]
        dd += leg * leg
        cd += steepest * gradient[k] * leg
    b = (-cd + math.sqrt(max(cd * cd + dd * (radius * radius - cc), 0.0))) / max(dd, 1e-300)
    for k in range(n):
        step[k] = steepest * gradient[k] + b * (newton[k] - steepest * gradient[k])
