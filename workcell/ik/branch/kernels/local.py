"""Finding solutions: Levenberg-Marquardt on the pose with a hinge on penetration, from a box's centre."""

from __future__ import annotations

import numpy as np

from workcell.ik.branch.kernels.coupled import couple, gather
from workcell.ik.branch.kernels.obstacles import sphere_centre
from workcell.ik.branch.kernels.state import Chain, forward
from workcell.ik.branch.kernels.world import World, signed_distance
from workcell.jit import exact_inner
from workcell.kernels.constants import ROTATION_WEIGHT
from workcell.pose import Array

_HINGE_MARGIN = 2e-4
_HINGE_WEIGHT = 0.15
"""Beside a metre of pose error; soft, so that a start reaches the pose first and then slides clear."""
_STIFF_WEIGHT = 30.0
_ALMOST = 3e-3
"""Metres of penetration below which the last iterations let the pose give way, within its tolerance, to the
clearance."""
_NEAR = 0.05
"""Residual (m) below which obstacles begin to count: a start that misses the pose is dropped before it costs more."""


@exact_inner
def search_from(
    chain: Chain, world: World, lower: Array, upper: Array, q: Array, tolerance: Array, iterations: int, best_gap: Array
) -> bool:  # fmt: skip
    """Improve `q` (N,) within [lower, upper] in place; True once it solves the problem.

    `tolerance` (2,) is what counts as reached (m, rad); the clearance must be at least `world.clearance[0]`; by how
    much the best configuration in reach of the target missed that is kept in `best_gap` (1,).
    """
    joints = q.shape[0]
    n = joints - 2
    frames = np.empty((joints, 12))
    error, J = np.empty(6), np.empty((6, n))
    H, g = np.empty((n, n)), np.empty(n)
    best, damping = np.inf, 1e-4
    stiff = False
    for iteration in range(2 * iterations):
        couple(chain, q)
        forward(chain, q, frames)
        away, turned = _pose_residual(chain, frames, error, J)
        if stiff:
            _forgive(error, away, turned, tolerance)
        cost = 0.0
        for r in range(6):
            cost += error[r] * error[r]
        _normal_equations(error, J, H, g)
        gap = np.inf
        if cost < _NEAR * _NEAR:
            penalty, gap = _hinge(chain, world, frames, _STIFF_WEIGHT if stiff else _HINGE_WEIGHT, H, g)
            cost += penalty
            if away < tolerance[0] and turned < tolerance[1]:
                best_gap[0] = max(best_gap[0], gap)
                if gap >= 0.0:
                    return True
        elif iteration >= 5 and cost > 0.25:
            return False
        if iteration >= iterations and not stiff:
            if not gap > -_ALMOST or cost > _ALMOST:
                return False
            stiff, best, damping = True, np.inf, 1e-4
        if cost < best:
            best = cost
            damping = max(damping * 0.2, 1e-9)
        else:
            damping = max(damping * 10.0, 1e-6)
            if damping > 1e3:
                return False
        gather(chain, q, H, g)
        for j in range(n):
            H[j, j] += damping + 1e-9
        if not _solve(H, g):
            return False
        longest = 0.0
        for j in range(n):
            longest = max(longest, abs(g[j]))
        scale = min(1.0, 0.7 / longest) if longest > 0.0 else 0.0
        if longest < 1e-12:
            return False
        for j in range(n):
            q[j + 1] = min(max(q[j + 1] + scale * g[j], lower[j + 1]), upper[j + 1])
    return False


@exact_inner
def _pose_residual(chain: Chain, frames: Array, error: Array, J: Array) -> tuple[float, float]:
    """Residual (goal less frame), its Jacobian by joint angles, and the pose error (m, rad)."""
    n = frames.shape[0] - 2
    F, goal = frames[n + 1], chain.goal
    # The tool's own frame is what counts: the target's centre is carried along.
    local = np.empty(3)
    for a in range(3):
        local[a] = (
            goal[a] * (chain.ball[2] - goal[9])
            + goal[3 + a] * (chain.ball[3] - goal[10])
            + goal[6 + a] * (chain.ball[4] - goal[11])
        )
    point = np.empty(3)
    away = 0.0
    for a in range(3):
        point[a] = F[9 + a] + F[3 * a] * local[0] + F[3 * a + 1] * local[1] + F[3 * a + 2] * local[2]
        error[a] = chain.ball[2 + a] - point[a]
        away += error[a] ** 2
    D = np.empty((3, 3))
    for a in range(3):
        for b in range(3):
            D[a, b] = goal[3 * a] * F[3 * b] + goal[3 * a + 1] * F[3 * b + 1] + goal[3 * a + 2] * F[3 * b + 2]
    wx, wy, wz = 0.5 * (D[2, 1] - D[1, 2]), 0.5 * (D[0, 2] - D[2, 0]), 0.5 * (D[1, 0] - D[0, 1])
    sine, cosine = np.sqrt(wx * wx + wy * wy + wz * wz), 0.5 * (D[0, 0] + D[1, 1] + D[2, 2] - 1.0)
    turned = np.arctan2(sine, cosine)
    factor = ROTATION_WEIGHT * (turned / sine if sine > 1e-9 else 1.0)
    error[3], error[4], error[5] = factor * wx, factor * wy, factor * wz
    if not chain.turns:
        error[3:], turned = 0.0, 0.0
    for j in range(n):
        line = frames[j + 1]
        zx, zy, zz = line[2], line[5], line[8]
        if chain.slides[j + 1] > 0.0:
            J[0, j], J[1, j], J[2, j], J[3:, j] = zx, zy, zz, 0.0
            continue
        u, v, w = point[0] - line[9], point[1] - line[10], point[2] - line[11]
        J[0, j], J[1, j], J[2, j] = zy * w - zz * v, zz * u - zx * w, zx * v - zy * u
        J[3, j], J[4, j], J[5, j] = ROTATION_WEIGHT * zx, ROTATION_WEIGHT * zy, ROTATION_WEIGHT * zz
    return np.sqrt(away), turned


@exact_inner
def _forgive(error: Array, away: float, turned: float, tolerance: Array) -> None:
    """Take from the residual what the tolerances allow, nearly."""
    for r in range(6):
        size, allowed = (away, 0.95 * tolerance[0]) if r < 3 else (turned, 0.95 * tolerance[1])
        error[r] *= max(1.0 - allowed / size, 0.0) if size > 0.0 else 0.0


@exact_inner
def _normal_equations(error: Array, J: Array, H: Array, g: Array) -> None:
    n = J.shape[1]
    for i in range(n):
        g[i] = 0.0
        for r in range(6):
            g[i] += J[r, i] * error[r]
        for j in range(i + 1):
            total = 0.0
            for r in range(6):
                total += J[r, i] * J[r, j]
            H[i, j] = total
            H[j, i] = total


@exact_inner
def _hinge(
    chain: Chain, world: World, frames: Array, weight: float, H: Array, g: Array
) -> tuple[float, float]:
    """Add the hinge of every sphere too near an obstacle or another sphere to H and g.

    Returns the penalty and the smallest clearance less the wanted one.
    """
    gradient, row = np.empty(3), np.empty(frames.shape[0] - 2)
    penalty, smallest = 0.0, np.inf
    margin = world.clearance[0] + _HINGE_MARGIN
    for s in range(world.spheres.shape[0]):
        sphere = world.spheres[s]
        k = int(sphere[0])
        x, y, z = sphere_centre(frames[k], sphere)
        radius = sphere[4] + margin
        for o in range(world.obstacles.shape[0]):
            box = world.obstacles[o]
            if (
                x < box[16] - radius or x > box[19] + radius
                or y < box[17] - radius or y > box[20] + radius
                or z < box[18] - radius or z > box[21] + radius
            ):  # fmt: skip
                continue
            gap = signed_distance(world, o, x, y, z, gradient) - radius
            smallest = min(smallest, gap + _HINGE_MARGIN)
            if gap < 0.0:
                row[:] = 0.0
                _add_motion(chain, frames, k, x, y, z, gradient, 1.0, row)
                penalty += _add_square(row, gap, weight, H, g)
    for p in range(world.pairs.shape[0]):
        one, two = world.spheres[world.pairs[p, 0]], world.spheres[world.pairs[p, 1]]
        first, last = int(one[0]), int(two[0])
        ax, ay, az = sphere_centre(frames[first], one)
        bx, by, bz = sphere_centre(frames[last], two)
        length = np.sqrt((bx - ax) ** 2 + (by - ay) ** 2 + (bz - az) ** 2)
        gap = length - one[4] - two[4] - margin
        smallest = min(smallest, gap + _HINGE_MARGIN)
        if gap < 0.0 and length > 1e-9:
            gradient[0], gradient[1], gradient[2] = (bx - ax) / length, (by - ay) / length, (bz - az) / length
            row[:] = 0.0
            _add_motion(chain, frames, last, bx, by, bz, gradient, 1.0, row)
            _add_motion(chain, frames, first, ax, ay, az, gradient, -1.0, row)
            if np.any(row != 0.0):
                penalty += _add_square(row, gap, weight, H, g)
    return penalty, smallest


@exact_inner
def _add_motion(
    chain: Chain, frames: Array, k: int, x: float, y: float, z: float, way: Array, sign: float, row: Array
) -> None:
    """Add to row (n,) how fast a point of link k moves along `way` as each joint does."""
    for j in range(min(k, row.shape[0])):
        line = frames[j + 1]
        if chain.slides[j + 1] > 0.0:
            row[j] += sign * (way[0] * line[2] + way[1] * line[5] + way[2] * line[8])
            continue
        u, v, w = x - line[9], y - line[10], z - line[11]
        row[j] += sign * (
            way[0] * (line[5] * w - line[8] * v)
            + way[1] * (line[8] * u - line[2] * w)
            + way[2] * (line[2] * v - line[5] * u)
        )


@exact_inner
def _add_square(row: Array, gap: float, weight: float, H: Array, g: Array) -> float:
    """Add the square of a gap with gradient `row` to the normal equations."""
    for i in range(row.shape[0]):
        g[i] -= weight * row[i] * gap
        for j in range(row.shape[0]):
            H[i, j] += weight * row[i] * row[j]
    return weight * gap * gap


@exact_inner
def _solve(H: Array, g: Array) -> bool:
    """Solve H x = g by Cholesky, in place (x in g); False if H is not positive definite."""
    n = g.shape[0]
    for j in range(n):
        for k in range(j):
            H[j, j] -= H[j, k] * H[j, k]
        if not H[j, j] > 0.0:
            return False
        H[j, j] = np.sqrt(H[j, j])
        for i in range(j + 1, n):
            for k in range(j):
                H[i, j] -= H[i, k] * H[j, k]
            H[i, j] /= H[j, j]
    for i in range(n):
        for k in range(i):
            g[i] -= H[i, k] * g[k]
        g[i] /= H[i, i]
    for i in range(n - 1, -1, -1):
        for k in range(i + 1, n):
            g[i] -= H[k, i] * g[k]
        g[i] /= H[i, i]
    return True
