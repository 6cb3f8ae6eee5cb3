"""The closure of the chain at a middle link, linearised, with everything left out bounded.

Position: E_1 .. E_m p = Ball E_n^-1 .. E_(m+1)^-1 t, p and t one point of the middle link seen from the base and from
the target. Rotation: E_1 .. E_m = Ball E_n^-1 .. E_(m+1)^-1 D. The skew part of a product of two small rotations'
generators is half their vector product, that of a square is zero; D departs from the identity by at most `apart`,
which enters as remainder. Third order of rotations: their product by t h_j, differentiated three times in t, is at
most (sum h_j)^3. Third order of points: E_1 .. E_m p - p = sum of E_1 .. E_(j-1) (E_j - 1) p. With s the sum of the h
before joint j and l its lever at p, such a term differentiated three times is at most ((s + h)^3 - s^3) l where E_j
is differentiated and s^3 t h l where it is not; under Taylor's integral that is ((s + h)^3 - s^3) l / 6 + s^3 h l /
24. Where joint j slides: s^2 h / 2 + s^3 h / 24.

Rounding: the rows that are used are the weights found by elimination times the system itself, computed afresh. So the
elimination may err as it likes; what rounding remains is that of six products each, and of the system, both within the
two slacks in every component's bound.
"""

from __future__ import annotations

import numpy as np

from workcell.ik.branch.checker.closure import Box, Robot, narrow, off_axis
from workcell.ik.branch.checker.vectors import Vector, cross, dot, minus, move, norm, vector
from workcell.jit import exact_inner
from workcell.pose import Array

_OFF = 1e-12
"""How far from 1 and 0 the coefficients of solved joints may be for `Box.follow`; times all half widths it is
below EPS."""
WIDEST = 1.3
"""Radians of all half widths together beyond which nothing can come of it."""


@exact_inner
def follow_closure(robot: Robot, box: Box) -> bool:
    """Contract all joints by the linear closure; False if it can't hold. Leaves in `box.follow` how joints follow:

    departure of joint k = follow[k, 0] + follow[k, 1] * (departure of joint follow[0, 1]) + follow[k, 2:8] . noise
    + follow[k, 12:] . (departures of the other free joints), where follow[0, 11] is 1 if there are such; the noise
    bounded by `noise_along` with follow[0, 2:8] and follow[0, 8:11]; valid where follow[0, 0] is 1.
    """
    joints = box.lower.shape[0]
    box.follow[0, 0] = 0.0
    h = np.zeros(joints)
    total = 0.0
    for k in range(joints):
        h[k] = max(box.upper[k] - box.centre[k], box.centre[k] - box.lower[k])
        if robot.lines[k, 9] == 0.0 and (robot.turns or k < robot.middle):
            total += h[k]
    if total > WIDEST:
        return True
    A = np.zeros((6, joints + 7))
    bound, lever = np.zeros(6), np.zeros(3)
    if not _system(robot, box, robot.middle, h, A, bound, lever):
        return True
    owner = np.full(6, -1)
    system = A.copy()
    _solve(robot, A, bound, lever, h, owner)
    _recompute(A, system)
    return _use(robot, box, A, bound, lever, owner)


@exact_inner
def _recompute(A: Array, system: Array) -> None:
    """Replace the rows of A by their weights times the system."""
    noise = A.shape[1] - 7
    for r in range(6):
        for k in range(A.shape[1]):
            if noise <= k < noise + 6:
                continue
            total = 0.0
            for s in range(6):
                total += A[r, noise + s] * system[s, k]
            A[r, k] = total


@exact_inner
def noise_along(weights: Array, bound: Array, lever: Array, ball: Array) -> float:
    """Largest weights (6,) . noise: each component within `bound`, and the tolerance ball acting at `lever`."""
    total = 0.0
    for r in range(6):
        total += abs(weights[r]) * bound[r]
    u, v = vector(weights, 0), vector(weights, 3)
    w = cross((lever[0], lever[1], lever[2]), u)
    turn = norm((v[0] + w[0], v[1] + w[1], v[2] + w[2]))
    return total + ball[0] * norm(u) + ball[1] * turn  # type: ignore[no-any-return]


@exact_inner
def _system(robot: Robot, box: Box, m: int, h: Array, A: Array, bound: Array, lever: Array) -> bool:
    """A = [coefficients of all joints | noise | right side]."""
    joints = h.shape[0]
    point = vector(robot.lines[m], 6)
    p, t = move(box.motions[0, m], point), move(box.motions[1, m], point)
    D = np.empty((3, 3))
    for a in range(3):
        for b in range(3):
            D[a, b] = dot(vector(box.motions[1, m], 3 * a), vector(box.motions[0, m], 3 * b))
    apart = np.sqrt(max(3.0 - D[0, 0] - D[1, 1] - D[2, 2], 0.0))
    if apart > 1.4 and robot.turns:
        return False
    last = joints + 6
    A[0, last], A[1, last], A[2, last] = minus(t, p)
    A[3, last], A[4, last], A[5, last] = (
        0.5 * (D[2, 1] - D[1, 2]),
        0.5 * (D[0, 2] - D[2, 0]),
        0.5 * (D[1, 0] - D[0, 1]),
    )
    for r in range(6):
        A[r, joints + r] = 1.0
        bound[r] = 2.0 * robot.scale[0]
    _side(box, 0, 1, m, 1, p, D, 0.0, h, A, bound)
    _side(box, 1, joints - 2, m + 1, -1, t, D, apart, h, A, bound)
    far, moved = 0.0, 0.0
    for k in range(m + 1, joints - 1):
        far += 0.0 if robot.lines[k, 9] > 0.0 else h[k]
        moved += h[k] * off_axis(t, box.sides[1, k])
    c = minus(t, vector(robot.ball, 2))
    for r in range(3):
        lever[r] = c[r]
        bound[r] += robot.ball[1] * (moved + robot.ball[1] * norm(c))
        bound[3 + r] += robot.ball[1] * (far + apart + robot.ball[1])
    if not robot.turns:
        # The rows of the rotation say nothing: 0 = 0.
        A[3:, :joints], A[3:, last], bound[3:] = 0.0, 0.0, 0.0
    return True


@exact_inner
def _side(
    box: Box, side: int, first: int, last: int, step: int, p: Vector, D: Array, apart: float, h: Array, A: Array,
    bound: Array,
) -> None:  # fmt: skip
    """Columns of the joints first .. last (outermost first) of one side, and their remainders."""
    right = A.shape[1] - 1
    sign = -1.0 if side == 0 else 1.0
    total, cubic, j = 0.0, 0.0, first
    while (step > 0 and j <= last) or (step < 0 and j >= last):
        z = vector(box.sides[side, j], 0)
        slides = box.sides[side, j, 9] > 0.0
        w = z if slides else cross(z, minus(p, vector(box.sides[side, j], 3)))
        if slides:
            cubic += (3.0 + 0.25 * total) * total**2 * h[j]
        else:
            cubic += ((total + h[j]) ** 3 - total**3 + 0.25 * total**3 * h[j]) * norm(w)
            total += h[j]
        Dz = z if side == 0 else (
            0.5 * ((D[1, 1] + D[2, 2]) * z[0] - D[0, 1] * z[1] - D[0, 2] * z[2]),
            0.5 * ((D[0, 0] + D[2, 2]) * z[1] - D[1, 0] * z[0] - D[1, 2] * z[2]),
            0.5 * ((D[0, 0] + D[1, 1]) * z[2] - D[2, 0] * z[0] - D[2, 1] * z[1]),
        )  # fmt: skip
        for r in range(3):
            A[r, j], A[3 + r, j] = w[r], 0.0 if slides else Dz[r]
        i = first
        while i != j + step:
            y = vector(box.sides[side, i], 0)
            bend, twist, size = cross(y, w), cross(y, z), h[i] * h[j]
            for r in range(3):
                if box.sides[side, i, 9] > 0.0:
                    continue  # what slides outside doesn't turn what is inside
                if slides:
                    bound[r] += size * abs(bend[r])
                elif i == j:
                    # Half a square in [0, h^2 / 2]: its middle to the right side, half its range to the remainder.
                    A[r, right] += sign * 0.25 * size * bend[r]
                    bound[r] += 0.25 * size * abs(bend[r])
                    bound[3 + r] += 0.5 * size * apart
                else:
                    bound[r] += size * abs(bend[r])
                    bound[3 + r] += size * (0.5 * abs(twist[r]) + apart)
            i += step
        j += step
    for r in range(3):
        bound[r] += cubic / 6.0
        bound[3 + r] += total**3 / 6.0


@exact_inner
def _solve(robot: Robot, A: Array, bound: Array, lever: Array, h: Array, owner: Array) -> None:
    """Solve each row for the joint that stands out most from its noise (in half widths), clearing it elsewhere."""
    joints = h.shape[0]
    used = np.zeros(joints)
    for _ in range(6):
        row, joint, best = -1, -1, 0.05
        for r in range(6):
            if owner[r] >= 0:
                continue
            noise = noise_along(A[r, joints : joints + 6], bound, lever, robot.ball)
            for k in range(joints):
                if used[k] == 0.0 and abs(A[r, k]) > 1e-6 and abs(A[r, k]) * h[k] > best * noise:
                    row, joint, best = r, k, abs(A[r, k]) * h[k] / noise
        if row < 0:
            return
        owner[row], used[joint] = joint, 1.0
        pivot = A[row, joint]
        for k in range(joints + 7):
            A[row, k] /= pivot
        for r in range(6):
            factor = A[r, joint]
            if r != row and factor != 0.0:
                for k in range(joints + 7):
                    A[r, k] -= factor * A[row, k]


@exact_inner
def _use(robot: Robot, box: Box, A: Array, bound: Array, lever: Array, owner: Array) -> bool:
    """Contract by the rows: in each, what a joint can be is what the other joints and the noise allow."""
    joints = box.lower.shape[0]
    for r in range(6):
        noise = noise_along(A[r, joints : joints + 6], bound, lever, robot.ball) + robot.scale[0]
        for k in range(joints):
            if k > 0 and (abs(A[r, k]) < 1e-3 or box.upper[k] == box.lower[k]):
                continue
            low, high = A[r, joints + 6] - noise, A[r, joints + 6] + noise
            for j in range(joints):
                if j != k:
                    one, two = (
                        A[r, j] * (box.lower[j] - box.centre[j]),
                        A[r, j] * (box.upper[j] - box.centre[j]),
                    )
                    low, high = low - max(one, two), high - min(one, two)
            if k == 0:
                # Joint 0 stands still: zero must be left.
                if low > 0.0 or high < 0.0:
                    return False
                continue
            one, two = box.centre[k] + low / A[r, k], box.centre[k] + high / A[r, k]
            if not narrow(box, k, min(one, two), max(one, two)):
                return False
    _remember(robot.turns, box, A, bound, lever, owner)
    return True


@exact_inner
def _remember(turns: bool, box: Box, A: Array, bound: Array, lever: Array, owner: Array) -> None:
    """Write `box.follow` where no more joints are left without a row than must be."""
    joints = box.lower.shape[0]
    free, count = -1, 0
    for k in range(1, joints - 1):
        for r in range(6):
            if owner[r] >= 0 and abs(A[r, k] - (1.0 if owner[r] == k else 0.0)) > _OFF and _owned(owner, k):
                return
        if not _owned(owner, k):
            count += 1
            if free < 0 or box.chord[k] > box.chord[free]:
                free = k
    if count > max(1, joints - 2 - (6 if turns else 3)):
        return
    follow = box.follow
    follow[:, :] = 0.0
    follow[0, 0], follow[0, 1], follow[0, 11] = 1.0, free, 1.0 if count > 1 else 0.0
    follow[0, 2:8], follow[0, 8:11] = bound, lever
    for k in range(1, joints - 1):
        if not _owned(owner, k):
            follow[k, 1 if k == free else 12 + k] = 1.0
            for r in range(6):
                if owner[r] >= 0:
                    follow[owner[r], 1 if k == free else 12 + k] = -A[r, k]
    for r in range(6):
        if owner[r] >= 0:
            follow[owner[r], 0] = A[r, joints + 6]
            follow[owner[r], 2:8] = A[r, joints : joints + 6]


@exact_inner
def _owned(owner: Array, k: int) -> bool:
    """Whether some row was solved for joint k."""
    owned = False
    for r in range(owner.shape[0]):
        owned = owned or owner[r] == k
    return owned
