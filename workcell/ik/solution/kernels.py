"""Kinematics and distances of the proofs of solutions, at one configuration; shared with nobody.

Rounding, u = 2^-53. A rotation of the chain is a product of two factors a joint: the joint's frame, which `Robot` has
to 27 u an entry, and Rodrigues' formula, whose entries err by 8 u. A product of matrices with unit rows adds 3 u an
entry. In Frobenius norm a joint adds less than 80 + 24 + 18 = 122 u, and n joints with base and tool less than
122 (n + 2) u. A point errs by that times the chain's length, and by 8 (n + 2) u of the distances that occur for its
sums; so do the six equations, their derivatives, and distances to obstacles, whose frames err by 8 u more. All of that
is below the `rounding` of `box`, 512 (n + 2) u times the longest distance (or 1), which is taken three times.
"""

from __future__ import annotations

import math

import numpy as np

from workcell.jit import exact_inner, exact_kernel
from workcell.pose import Array

BOX, SPHERE, CYLINDER = 0.0, 1.0, 2.0
"""Kinds of obstacles, as the first number of their rows."""


@exact_inner
def _times(A: Array, B: Array, out: Array) -> None:
    for i in range(3):
        for j in range(3):
            out[i, j] = A[i, 0] * B[0, j] + A[i, 1] * B[1, j] + A[i, 2] * B[2, j]


@exact_inner
def _turn(a: Array, angle: float, out: Array) -> None:
    """The rotation by an angle about the unit vector a."""
    c, s = math.cos(angle), math.sin(angle)
    v = 1.0 - c
    out[0, 0], out[1, 1], out[2, 2] = c + v * a[0] * a[0], c + v * a[1] * a[1], c + v * a[2] * a[2]
    out[0, 1], out[1, 0] = v * a[0] * a[1] - s * a[2], v * a[0] * a[1] + s * a[2]
    out[0, 2], out[2, 0] = v * a[0] * a[2] + s * a[1], v * a[0] * a[2] - s * a[1]
    out[1, 2], out[2, 1] = v * a[1] * a[2] - s * a[0], v * a[1] * a[2] + s * a[0]


@exact_kernel
def stand(
    ends: Array, frames: Array, offsets: Array, axes: Array, q: Array, spheres: Array,
    equations: Array, slopes: Array, centres: Array,
) -> float:  # fmt: skip
    """Where the chain stands at q (n,): how far it is from its target, and where its spheres are.

    Args:
        ends: (3, 12) rotation row by row and position of the base, of the tool in the last link, and of the target.
        frames: (n, 3, 3) of the joints in the link before.
        offsets: (n, 3) of the joints in the link before.
        axes: (n, 3) of the joints.
        q: radians.
        spheres: (s, 5) link, centre in it, radius.
        equations: (6,) out: the tool's position less the target's; the axis of the turn M = R R_target^T between them
            times its sine.
        slopes: (6, n) out: their derivatives.
        centres: (s, 3) out: the spheres' centres in the world.

    Returns:
        |M - I| (Frobenius), which is 2 sqrt(2) times the sine of half its angle.
    """
    n = q.shape[0]
    R, o, z = np.empty((n + 2, 3, 3)), np.empty((n + 2, 3)), np.empty((n, 3))
    turned, M = np.empty((3, 3)), np.empty((3, 3))
    R[0], o[0] = ends[0, :9].copy().reshape(3, 3), ends[0, 9:]
    for k in range(n):
        for i in range(3):
            o[k + 1, i] = o[k, i] + (
                R[k, i, 0] * offsets[k, 0] + R[k, i, 1] * offsets[k, 1] + R[k, i, 2] * offsets[k, 2]
            )
        _times(R[k], frames[k], M)
        _turn(axes[k], q[k], turned)
        _times(M, turned, R[k + 1])
        for i in range(3):
            z[k, i] = M[i, 0] * axes[k, 0] + M[i, 1] * axes[k, 1] + M[i, 2] * axes[k, 2]
    for i in range(3):
        o[n + 1, i] = o[n, i] + (
            R[n, i, 0] * ends[1, 9] + R[n, i, 1] * ends[1, 10] + R[n, i, 2] * ends[1, 11]
        )
        equations[i] = o[n + 1, i] - ends[2, 9 + i]
    _times(R[n], ends[1, :9].copy().reshape(3, 3), R[n + 1])
    _times(R[n + 1], ends[2, :9].copy().reshape(3, 3).T.copy(), M)
    equations[3], equations[4] = 0.5 * (M[2, 1] - M[1, 2]), 0.5 * (M[0, 2] - M[2, 0])
    equations[5] = 0.5 * (M[1, 0] - M[0, 1])
    trace = M[0, 0] + M[1, 1] + M[2, 2]
    for k in range(n):
        dx, dy, dz = o[n + 1, 0] - o[k + 1, 0], o[n + 1, 1] - o[k + 1, 1], o[n + 1, 2] - o[k + 1, 2]
        slopes[0, k] = z[k, 1] * dz - z[k, 2] * dy
        slopes[1, k] = z[k, 2] * dx - z[k, 0] * dz
        slopes[2, k] = z[k, 0] * dy - z[k, 1] * dx
        for i in range(3):
            slopes[3 + i, k] = 0.5 * (
                trace * z[k, i] - M[i, 0] * z[k, 0] - M[i, 1] * z[k, 1] - M[i, 2] * z[k, 2]
            )
    for s in range(spheres.shape[0]):
        link = int(spheres[s, 0])
        for i in range(3):
            centres[s, i] = o[link, i] + (
                R[link, i, 0] * spheres[s, 1] + R[link, i, 1] * spheres[s, 2] + R[link, i, 2] * spheres[s, 3]
            )
    square = 0.0
    for i in range(3):
        for j in range(3):
            square += (M[i, j] - (1.0 if i == j else 0.0)) ** 2
    return math.sqrt(square)


@exact_kernel
def least_gap(centres: Array, spare: Array, obstacles: Array) -> float:
    """Smallest signed distance of spheres to obstacles, each less `spare` (s,); infinite where there are none.

    Args:
        centres: (s, 3) metres.
        spare: (s,) radius, and what else is to be subtracted.
        obstacles: (k, 16) kind, rotation row by row, centre, three sizes: half extents of a box, radius of a sphere,
            radius and half length of a cylinder along its z.
    """
    least = np.inf
    for s in range(centres.shape[0]):
        for k in range(obstacles.shape[0]):
            row = obstacles[k]
            dx, dy, dz = centres[s, 0] - row[10], centres[s, 1] - row[11], centres[s, 2] - row[12]
            if row[0] == SPHERE:
                gap = math.sqrt(dx * dx + dy * dy + dz * dz) - row[13]
            else:
                x = row[1] * dx + row[4] * dy + row[7] * dz
                y = row[2] * dx + row[5] * dy + row[8] * dz
                w = row[3] * dx + row[6] * dy + row[9] * dz
                if row[0] == BOX:
                    a, b, c = abs(x) - row[13], abs(y) - row[14], abs(w) - row[15]
                else:
                    a, b, c = math.sqrt(x * x + y * y) - row[13], abs(w) - row[14], -np.inf
                most = max(a, max(b, c))
                if most <= 0.0:
                    gap = most
                else:
                    a, b, c = max(a, 0.0), max(b, 0.0), max(c, 0.0)
                    gap = math.sqrt(a * a + b * b + c * c)
            least = min(least, gap - spare[s])
    return least
