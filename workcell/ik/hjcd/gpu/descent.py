"""Greedy orientation-aware coordinate descent in a Warp thread.

Section IV, Eqs. 8-11 of HJCD-IK (see `workcell.ik.hjcd.solver`).
"""
# mypy: ignore-errors

import functools
from collections.abc import Callable

import warp as wp

from workcell.ik.hjcd.gpu.chain import WEIGHT, D, Residual, Target, chain, pose_error

Moves = wp.types.vector(length=4, dtype=D)
"""Joint and motion for position, joint and motion for rotation; joint -1 where none helps."""


@functools.cache
def best_turns(n: int) -> Callable[..., object]:
    """The function that finds the joint whose motion leaves the smallest position error, and that for rotation."""
    kinematics = chain(n)
    Vector, Columns = kinematics.Vector, kinematics.Columns
    N = wp.constant(n)

    @wp.func
    def turns(
        frames: wp.array2d(dtype=D), bounds: wp.array2d(dtype=D), lines: Columns, p: wp.vec3d, e: Residual,
        q: Vector,
    ):  # fmt: skip
        """`Moves`; the formulas are those of `workcell.ik.hjcd.kernels.descent`."""
        away, turned = wp.vec3d(e[0], e[1], e[2]), wp.vec3d(e[3], e[4], e[5])
        square, angle = wp.dot(away, away), wp.length(turned) / WEIGHT
        w = wp.cos(D(0.5) * angle)
        scale = wp.sin(D(0.5) * angle) / wp.max(WEIGHT * angle, D(1e-12))
        moves = Moves(D(-1.0), D(0.0), D(-1.0), D(0.0))
        nearest, straightest = square * (D(1.0) - D(1e-6)), w + D(1e-9)
        for k in range(N):
            z = wp.vec3d(lines[0, k], lines[1, k], lines[2, k])
            lower, upper = bounds[0, k] - q[k], bounds[1, k] - q[k]
            if frames[k + 1, 12] != D(0.0):
                along = wp.dot(z, away)
                t = wp.min(wp.max(along, lower), upper)
                left = square - D(2.0) * t * along + t * t
                if left < nearest:
                    nearest = left
                    moves[0] = D(k)
                    moves[1] = t
            else:
                u = p - wp.vec3d(lines[3, k], lines[4, k], lines[5, k])
                v = u + away
                flat = wp.dot(u, v) - wp.dot(z, u) * wp.dot(z, v)
                cross = wp.dot(z, wp.cross(u, v))
                t = wp.min(wp.max(wp.atan2(cross, flat), lower), upper)
                left = square + D(2.0) * (flat - flat * wp.cos(t) - cross * wp.sin(t))
                if left < nearest:
                    nearest = left
                    moves[0] = D(k)
                    moves[1] = t
                r = scale * wp.dot(z, turned)
                t = wp.min(wp.max(D(2.0) * wp.atan2(r, w), lower), upper)
                cosine = wp.abs(w * wp.cos(D(0.5) * t) + r * wp.sin(D(0.5) * t))
                if cosine > straightest:
                    straightest = cosine
                    moves[2] = D(k)
                    moves[3] = t
        return moves

    return turns


@functools.cache
def descent(n: int) -> Callable[..., object]:
    """The function that descends one configuration of n joints."""
    kinematics, turns = chain(n), best_turns(n)
    Vector, forward = kinematics.Vector, kinematics.forward

    @wp.func
    def descend(
        frames: wp.array2d(dtype=D), bounds: wp.array2d(dtype=D), target: Target, sweeps: int, start: Vector
    ):
        """Where up to `sweeps` greedy updates lead from a start, and the squared residual there."""
        q = start
        lines, R, p = forward(frames, q)
        e = pose_error(R, p, target)
        sweep = int(0)  # noqa: RUF046, UP018 -- a variable to Warp, not a constant
        while sweep < sweeps:
            moves = turns(frames, bounds, lines, p, e, q)
            first, second = int(moves[0]), int(moves[2])
            if first < 0 and second < 0:
                break
            anneal = D(0.75) + D(0.25) * (D(1.0) - D(sweep) / D(sweeps))
            if first == second:
                if wp.abs(moves[1]) >= wp.abs(moves[3]):
                    q[first] = q[first] + moves[1]
                else:
                    q[first] = q[first] + anneal * moves[3]
            else:
                if first >= 0:
                    q[first] = q[first] + moves[1]
                if second >= 0:
                    q[second] = q[second] + anneal * moves[3]
            lines, R, p = forward(frames, q)
            e = pose_error(R, p, target)
            sweep = sweep + 1
        return q, wp.dot(e, e)

    return descend
