"""How far a tool is from a singularity: smallest over largest singular value of its Jacobian, with gradient.

The Jacobian is the geometric one (metres and radians as they are). Its smaller Gram matrix is diagonalised by Jacobi's
rotations; the singular values' rates follow from the rates of the Jacobian's columns.
"""

from __future__ import annotations

import math

from workcell.jit import lean
from workcell.motion.live.kernels.limbs import Limbs, Place
from workcell.pose import Array

_SWEEPS = 12
_NOTHING = 1e-12


@lean
def eigen(A: Array, V: Array) -> None:
    """Eigenvalues on the diagonal of a symmetric A (d, d), changed, and vectors in the columns of V (d, d)."""
    d = A.shape[0]
    for i in range(d):
        for j in range(d):
            V[i, j] = 1.0 if i == j else 0.0
    for _ in range(_SWEEPS):
        off, size = 0.0, 0.0
        for i in range(d):
            size += A[i, i] * A[i, i]
            for j in range(i):
                off += A[i, j] * A[i, j]
        if off <= 1e-22 * size:
            return
        for i in range(1, d):
            for j in range(i):
                if A[i, j] == 0.0:
                    continue
                tau = (A[i, i] - A[j, j]) / (2.0 * A[i, j])
                t = (1.0 if tau >= 0.0 else -1.0) / (abs(tau) + math.sqrt(1.0 + tau * tau))
                c = 1.0 / math.sqrt(1.0 + t * t)
                s = t * c
                for k in range(d):
                    a, b = A[k, j], A[k, i]
                    A[k, j], A[k, i] = c * a - s * b, s * a + c * b
                for k in range(d):
                    a, b = A[j, k], A[i, k]
                    A[j, k], A[i, k] = c * a - s * b, s * a + c * b
                for k in range(d):
                    a, b = V[k, j], V[k, i]
                    V[k, j], V[k, i] = c * a - s * b, s * a + c * b


@lean
def conditioning(J: Array, A: Array, V: Array, vectors: Array) -> float:
    """The ratio for J (6, n). A and V (d, d), d = min(6, n), are scratch.

    Vectors (4, 6 + n): left (6) and right (n) singular vectors of the smallest in row 0 and of the largest in row 1.
    """
    n = J.shape[1]
    d = A.shape[0]
    for i in range(d):
        for j in range(i + 1):
            total = 0.0
            if d == 6:
                for k in range(n):
                    total += J[i, k] * J[j, k]
            else:
                for k in range(6):
                    total += J[k, i] * J[k, j]
            A[i, j], A[j, i] = total, total
    eigen(A, V)
    small, large = 0, 0
    for i in range(1, d):
        if A[i, i] < A[small, small]:
            small = i
        if A[i, i] > A[large, large]:
            large = i
    for which in range(2):
        at = small if which == 0 else large
        value = math.sqrt(max(A[at, at], 0.0))
        share = 1.0 / max(value, _NOTHING)
        if d == 6:
            for i in range(6):
                vectors[which, i] = V[i, at]
            for k in range(n):
                total = 0.0
                for i in range(6):
                    total += J[i, k] * V[i, at]
                vectors[which, 6 + k] = share * total
        else:
            for k in range(n):
                vectors[which, 6 + k] = V[k, at]
            for i in range(6):
                total = 0.0
                for k in range(n):
                    total += J[i, k] * V[k, at]
                vectors[which, i] = share * total
        vectors[which + 2, 0] = value
    return float(vectors[2, 0] / max(vectors[3, 0], _NOTHING))


@lean
def conditioning_gradient(
    limbs: Limbs, place: Place, tool: int, J: Array, vectors: Array, out: Array
) -> None:
    """Gradient of the ratio by the variables, into out (n,): J and vectors as `conditioning` left them.

    Columns turn with every joint below them: the rates of column j by joint k are k's turn of it where k is below j,
    and j's turn of k's linear part where it is above. Couplings of degree one, whose slopes are constant, are exact.
    """
    n = J.shape[1]
    small, large = vectors[2, 0], max(vectors[3, 0], _NOTHING)
    for a in range(n):
        out[a] = 0.0
    T, tree, couple = place.T, limbs.tree, limbs.couple
    x, y, z = place.tools[tool, 9], place.tools[tool, 10], place.tools[tool, 11]
    upper = int(limbs.tools[tool, 0])
    while upper > 0:
        slide_j = tree.frames[upper, 12] != 0.0
        var_j, slope_j = couple.variable[upper - 1], place.slopes[upper - 1]
        jx, jy, jz = T[upper, 2], T[upper, 5], T[upper, 8]
        px, py, pz = x - T[upper, 9], y - T[upper, 10], z - T[upper, 11]
        lx, ly, lz = (jx, jy, jz) if slide_j else (jy * pz - jz * py, jz * px - jx * pz, jx * py - jy * px)
        lower = upper
        while lower > 0:
            var_k, slope_k = couple.variable[lower - 1], place.slopes[lower - 1]
            kx, ky, kz = T[lower, 2], T[lower, 5], T[lower, 8]
            slide_k = tree.frames[lower, 12] != 0.0
            for which in range(2):
                u = vectors[which]
                # column `upper` as joint `lower` moves
                rate = 0.0
                if not slide_k:
                    rate = (
                        u[0] * (ky * lz - kz * ly) + u[1] * (kz * lx - kx * lz) + u[2] * (kx * ly - ky * lx)
                    )
                    if not slide_j:
                        rate += (
                            u[3] * (ky * jz - kz * jy)
                            + u[4] * (kz * jx - kx * jz)
                            + u[5] * (kx * jy - ky * jx)
                        )
                rate *= slope_j * slope_k
                share = 1.0 / large if which == 0 else -small / (large * large)
                out[var_k] += share * rate * u[6 + var_j]
                if lower != upper and not slide_k:
                    # column `lower` as joint `upper` moves: its lever's end goes along
                    rate = (
                        u[0] * (ky * lz - kz * ly) + u[1] * (kz * lx - kx * lz) + u[2] * (kx * ly - ky * lx)
                    )
                    out[var_j] += share * rate * slope_j * slope_k * u[6 + var_k]
            lower = tree.parents[lower]
        upper = tree.parents[upper]
