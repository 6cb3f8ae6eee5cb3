"""Forward kinematics, pose error and Jacobian in a Warp thread."""
# mypy: ignore-errors
# Annotations in kernels are Warp's types, which no type checker knows.

import functools
from types import SimpleNamespace

import warp as wp

from workcell.kernels import constants

D = wp.float64
Residual = wp.types.vector(length=6, dtype=D)
Target = wp.types.vector(length=7, dtype=D)
"""Position and quaternion wxyz."""

WEIGHT = wp.constant(D(constants.ROTATION_WEIGHT))
HUGE = wp.constant(D(constants.HUGE))
_TURN = wp.constant(D(constants.TURN))
_PI = wp.constant(D(3.141592653589793))


@wp.func
def target_rotation(target: Target):
    """The target's rotation matrix."""
    w, x, y, z = target[3], target[4], target[5], target[6]
    one, two = D(1.0), D(2.0)
    return wp.mat33d(
        one - two * (y * y + z * z), two * (x * y - w * z), two * (x * z + w * y),
        two * (x * y + w * z), one - two * (x * x + z * z), two * (y * z - w * x),
        two * (x * z - w * y), two * (y * z + w * x), one - two * (x * x + y * y),
    )  # fmt: skip


@wp.func
def _copysign(size: D, sign: D):
    return wp.where(sign < D(0.0), -wp.abs(size), wp.abs(size))


@wp.func
def pose_error(R: wp.mat33d, p: wp.vec3d, target: Target):
    """Position error and weighted rotation vector from the tool to its target (6,)."""
    E = target_rotation(target) * wp.transpose(R)
    half = D(0.5)
    x, y, z = half * (E[2, 1] - E[1, 2]), half * (E[0, 2] - E[2, 0]), half * (E[1, 0] - E[0, 1])
    sine = wp.sqrt(x * x + y * y + z * z)
    cosine = half * (E[0, 0] + E[1, 1] + E[2, 2] - D(1.0))
    factor = WEIGHT
    if sine < D(1e-6) and cosine < D(0.0):
        # A half turn: the axis comes from the diagonal, any sign serves.
        x = wp.sqrt(wp.max(E[0, 0] + D(1.0), D(0.0)))
        y = wp.sqrt(wp.max(E[1, 1] + D(1.0), D(0.0)))
        z = wp.sqrt(wp.max(E[2, 2] + D(1.0), D(0.0)))
        if x >= y and x >= z:
            y, z = _copysign(y, E[0, 1] + E[1, 0]), _copysign(z, E[0, 2] + E[2, 0])
        elif y >= z:
            x, z = _copysign(x, E[0, 1] + E[1, 0]), _copysign(z, E[1, 2] + E[2, 1])
        else:
            x, y = _copysign(x, E[0, 2] + E[2, 0]), _copysign(y, E[1, 2] + E[2, 1])
        factor = WEIGHT * _PI / wp.sqrt(x * x + y * y + z * z)
    elif sine > D(1e-9):
        factor = WEIGHT * wp.atan2(sine, cosine) / sine
    return Residual(target[0] - p[0], target[1] - p[1], target[2] - p[2], factor * x, factor * y, factor * z)


@functools.cache
def chain(n: int) -> SimpleNamespace:
    """Types and functions for n joints: `Vector` (n,), `Columns` (6, n), `forward`, `jacobian`, `move`."""
    Vector = wp.types.vector(length=n, dtype=D)
    Columns = wp.types.matrix(shape=(6, n), dtype=D)
    N = wp.constant(n)

    @wp.func
    def forward(frames: wp.array2d(dtype=D), q: Vector):
        """Joint axes with points on them (6, n), and the tool's rotation and position, in the world."""
        lines = Columns()
        R = wp.mat33d(
            frames[0, 0], frames[0, 1], frames[0, 2], frames[0, 3], frames[0, 4], frames[0, 5],
            frames[0, 6], frames[0, 7], frames[0, 8],
        )  # fmt: skip
        p = wp.vec3d(frames[0, 9], frames[0, 10], frames[0, 11])
        for i in range(1, N + 2):
            p = p + R * wp.vec3d(frames[i, 9], frames[i, 10], frames[i, 11])
            R = R * wp.mat33d(
                frames[i, 0], frames[i, 1], frames[i, 2], frames[i, 3], frames[i, 4], frames[i, 5],
                frames[i, 6], frames[i, 7], frames[i, 8],
            )  # fmt: skip
            if i <= N:
                z = wp.vec3d(R[0, 2], R[1, 2], R[2, 2])
                if frames[i, 12] == D(0.0):
                    c, s = wp.cos(q[i - 1]), wp.sin(q[i - 1])
                    R = R * wp.mat33d(c, -s, D(0.0), s, c, D(0.0), D(0.0), D(0.0), D(1.0))
                else:
                    p = p + q[i - 1] * z
                for r in range(3):
                    lines[r, i - 1] = z[r]
                    lines[r + 3, i - 1] = p[r]
        return lines, R, p

    @wp.func
    def jacobian(frames: wp.array2d(dtype=D), lines: Columns, p: wp.vec3d):
        """Geometric Jacobian (6, n) of the tool, its rotation rows weighted like the residual's."""
        J = Columns()
        for k in range(N):
            z = wp.vec3d(lines[0, k], lines[1, k], lines[2, k])
            if frames[k + 1, 12] == D(0.0):
                v = wp.cross(z, p - wp.vec3d(lines[3, k], lines[4, k], lines[5, k]))
                for r in range(3):
                    J[r, k] = v[r]
                    J[r + 3, k] = WEIGHT * z[r]
            else:
                for r in range(3):
                    J[r, k] = z[r]
        return J

    @wp.func
    def move(q: Vector, step: Vector, share: D, bounds: wp.array2d(dtype=D)):
        """q + share * step within the limits: by a whole turn where one fits, else clamped."""
        out = Vector()
        for k in range(N):
            value = q[k] + share * step[k]
            if bounds[2, k] != D(0.0):
                if value > bounds[1, k]:
                    value = value - _TURN * wp.ceil((value - bounds[1, k]) / _TURN)
                elif value < bounds[0, k]:
                    value = value + _TURN * wp.ceil((bounds[0, k] - value) / _TURN)
            out[k] = wp.min(wp.max(value, bounds[0, k]), bounds[1, k])
        return out

    return SimpleNamespace(Vector=Vector, Columns=Columns, forward=forward, jacobian=jacobian, move=move)
