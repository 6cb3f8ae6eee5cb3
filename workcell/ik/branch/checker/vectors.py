"""Vectors as tuples of three numbers, equations of one angle, and the slack that rounds every bound outwards.

Rounding. Instead of rounding each operation outwards, every bound is moved outwards by `EPS` times max(1, L^2), L the
largest distance in metres (at most `LONGEST` of `check`). That exceeds what doubles can err by, u = 2^-53 each
operation:

1. Sine, cosine and the square root err by u; `screw` composes rotations whose entries are at most 1: a product and its
   factors add at most 16 u to an entry, so after 20 joints it errs by 320 u, and a translation, T o - R o, by the sum
   over joints of (2 sqrt(3) 16 u j + 10 u) L < 11400 u L.
2. So a direction errs by less than 1e-13 and a point by less than 1.4e-12 L.
3. What bands are made of are products of two differences of such points or directions, at most 2 L long: they err by
   less than 2 (2 L) (2.8e-12 L) + 20 u (2 L)^2 < 1.2e-11 L^2, radii and levers by less than 3e-11 max(1, L).
4. A band is widened by the slack before its arc cosine is taken, which errs by an ulp then: where the cosine is flat,
   so is what the widening does to the angle, and the other way round. `EPS` is added to the angle on top.
5. `linear` doesn't trust its elimination, see there. What divides by a coefficient has been widened before.
6. Sums have fewer than 100 terms of the sizes above.

All of that stays below a third of the slack. The tests compare with extended precision.
"""

from __future__ import annotations

import numpy as np

from workcell.jit import exact_inner
from workcell.pose import Array

Vector = tuple[float, float, float]

EPS = 1e-10
"""Metres, radians or unit-free: how far bounds are moved outwards for lengths up to a metre (see above)."""


@exact_inner
def dot(a: Vector, b: Vector) -> float:
    """Scalar product."""
    return a[0] * b[0] + a[1] * b[1] + a[2] * b[2]


@exact_inner
def cross(a: Vector, b: Vector) -> Vector:
    """Vector product."""
    return (a[1] * b[2] - a[2] * b[1], a[2] * b[0] - a[0] * b[2], a[0] * b[1] - a[1] * b[0])


@exact_inner
def minus(a: Vector, b: Vector) -> Vector:
    """Difference."""
    return (a[0] - b[0], a[1] - b[1], a[2] - b[2])


@exact_inner
def plus(a: Vector, scale: float, b: Vector) -> Vector:
    """a + scale b."""
    return (a[0] + scale * b[0], a[1] + scale * b[1], a[2] + scale * b[2])


@exact_inner
def norm(a: Vector) -> float:
    """Length."""
    return np.sqrt(a[0] * a[0] + a[1] * a[1] + a[2] * a[2])  # type: ignore[no-any-return]


@exact_inner
def vector(values: Array, start: int) -> Vector:
    """Three numbers of an array."""
    return (values[start], values[start + 1], values[start + 2])


@exact_inner
def turn(T: Array, v: Vector) -> Vector:
    """A direction turned by a motion T (12,): rotation (9, row-major), translation (3)."""
    return (
        T[0] * v[0] + T[1] * v[1] + T[2] * v[2],
        T[3] * v[0] + T[4] * v[1] + T[5] * v[2],
        T[6] * v[0] + T[7] * v[1] + T[8] * v[2],
    )


@exact_inner
def move(T: Array, v: Vector) -> Vector:
    """A point moved by it."""
    return plus(turn(T, v), 1.0, (T[9], T[10], T[11]))


@exact_inner
def screw(T: Array, z: Vector, o: Vector, angle: float, out: Array) -> None:
    """out = T * rotation by `angle` about the line through o along z (Rodrigues' formula)."""
    c, s = np.cos(angle), np.sin(angle)
    for column in range(3):
        e = (1.0 if column == 0 else 0.0, 1.0 if column == 1 else 0.0, 1.0 if column == 2 else 0.0)
        w = plus(cross(z, e), 0.0, e)
        r = (
            c * e[0] + s * w[0] + (1.0 - c) * z[column] * z[0],
            c * e[1] + s * w[1] + (1.0 - c) * z[column] * z[1],
            c * e[2] + s * w[2] + (1.0 - c) * z[column] * z[2],
        )
        t = turn(T, r)
        out[column], out[3 + column], out[6 + column] = t
    # The line stays: T' o = T o.
    fixed, moved = move(T, o), turn(out, o)
    out[9], out[10], out[11] = fixed[0] - moved[0], fixed[1] - moved[1], fixed[2] - moved[2]


@exact_inner
def slide(T: Array, z: Vector, way: float, out: Array) -> None:
    """out = T * translation by `way` along z."""
    out[:] = T
    out[9], out[10], out[11] = plus((T[9], T[10], T[11]), way, turn(T, z))


@exact_inner
def angles_in_band(
    a: float, b: float, c: float, low: float, high: float, lower: float, upper: float, eps: float
) -> tuple[float, float]:
    """Hull of {t in [lower, upper]: low <= a + b cos t + c sin t <= high}; (1, -1) where that is empty."""
    size = np.sqrt(b * b + c * c)
    low, high = low - a - eps * (1.0 + size), high - a + eps * (1.0 + size)
    if low > size or high < -size:
        return 1.0, -1.0
    if low <= -size and high >= size:
        return lower, upper
    nearest = max(np.arccos(high / size) - EPS, 0.0) if high < size else 0.0
    farthest = min(np.arccos(low / size) + EPS, np.pi) if low > -size else np.pi
    # The angles are nearest <= |t - phase| <= farthest, turn after turn: what comes first after `lower`, and by
    # symmetry last before `upper`.
    phase = np.arctan2(c, b)
    first = lower + _wait(lower - phase, nearest, farthest) - EPS
    last = upper - _wait(phase - upper, nearest, farthest) + EPS
    return max(first, lower), min(last, upper)


@exact_inner
def _wait(u: float, nearest: float, farthest: float) -> float:
    """How far up from u the nearest number t is with nearest <= |t + 2 pi k| <= farthest for some k."""
    turns = 2.0 * np.pi
    u -= turns * np.floor(u / turns)
    if u < nearest:
        return nearest - u
    if u <= farthest:
        return 0.0
    return max(turns - farthest - u, 0.0) if u <= turns - nearest else turns + nearest - u


@exact_inner
def band_over(a: float, b: float, c: float, lower: float, upper: float, eps: float) -> tuple[float, float]:
    """Bounds on a + b cos t + c sin t over [lower, upper]: the ends, and the crests in between."""
    size = np.sqrt(b * b + c * c)
    one, two = b * np.cos(lower) + c * np.sin(lower), b * np.cos(upper) + c * np.sin(upper)
    low, high = min(one, two), max(one, two)
    phase = np.arctan2(c, b)
    k = np.floor((lower - phase) / np.pi) - 1.0
    while phase + np.pi * k <= upper + EPS:
        if phase + np.pi * k >= lower - EPS:
            if int(k) % 2 == 0:
                high = size
            else:
                low = -size
        k += 1.0
    return a + low - eps * (1.0 + size), a + high + eps * (1.0 + size)


@exact_inner
def places_in_band(
    a: float, b: float, c: float, low: float, high: float, lower: float, upper: float, eps: float
) -> tuple[float, float]:
    """Hull of {t in [lower, upper]: low <= a + b t + c t^2 <= high}, c = 0 or 1; (1, -1) where that is empty."""
    wide = eps * (1.0 + abs(b))
    if c == 0.0:
        if abs(b) < 1e-6:
            far = abs(b) * max(abs(lower), abs(upper)) + wide
            return (lower, upper) if low - far <= a <= high + far else (1.0, -1.0)
        one, two = (low - wide - a) / b, (high + wide - a) / b
        return max(lower, min(one, two) - EPS), min(upper, max(one, two) + EPS)
    # a + b t + t^2 = (t - foot)^2 + a - foot^2
    foot = -0.5 * b
    low, high = low - wide - a + foot * foot, high + wide - a + foot * foot
    if high < 0.0:
        return 1.0, -1.0
    far, near = np.sqrt(high) + EPS, max(np.sqrt(max(low, 0.0)) - EPS, 0.0)
    first, last = 1.0, -1.0
    for start, end in ((foot - far, foot - near), (foot + near, foot + far)):
        start, end = max(start, lower), min(end, upper)
        if start <= end:
            if first > last:
                first, last = start, end
            first, last = min(first, start), max(last, end)
    return first, last


@exact_inner
def parabola_over(
    a: float, b: float, c: float, lower: float, upper: float, eps: float
) -> tuple[float, float]:
    """Bounds on a + b t + c t^2 over [lower, upper], c = 0 or 1: the ends, and the foot in between."""
    one, two = a + lower * (b + c * lower), a + upper * (b + c * upper)
    low, high = min(one, two), max(one, two)
    if c > 0.0 and lower < -0.5 * b < upper:
        low = a - 0.25 * b * b
    return low - eps * (1.0 + abs(b)), high + eps * (1.0 + abs(b))
