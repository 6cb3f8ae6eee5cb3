"""Damped least squares to one pose after another, compiled: the point IK that live IK is measured beside."""

from __future__ import annotations

from workcell.jit import inner, kernel
from workcell.kernels.chain import Arm, forward
from workcell.kernels.cholesky import factor6, gram, solve6
from workcell.kernels.pose_error import draw, jacobian, move, pose_error, read_target
from workcell.kernels.random import RandomState
from workcell.kernels.structures import Work, scratch
from workcell.pose import Array

CLOSE = 1e-12
"""Squared pose error (metres, weighted radians) that counts as none."""
ITERATIONS = 60
"""Of one descent."""
_LONGEST = 0.5
"""Radians (metres) that a joint moves in one iteration at most."""


@inner
def descend(arm: Arm, target: Array, q: Array, work: Work) -> float:
    """Levenberg-Marquardt within the limits from q (n,), which is changed; returns the squared pose error there."""
    forward(arm.frames, q, work.T)
    cost = pose_error(work.T, target, work.e)
    damping = 1e-4
    for _ in range(ITERATIONS):
        if cost < CLOSE:
            break
        jacobian(arm.frames, work.T, work.J)
        gram(work.J, damping * (1e-4 + cost), work.A)
        if not factor6(work.A):
            damping *= 10.0
            continue
        solve6(work.A, work.e, work.y)
        longest = 0.0
        for k in range(q.shape[0]):
            total = 0.0
            for r in range(6):
                total += work.J[r, k] * work.y[r]
            work.step[k] = total
            longest = max(longest, abs(total))
        share = 1.0 if longest <= _LONGEST else _LONGEST / longest
        move(q, work.step, share, arm.bounds, work.trial)
        forward(arm.frames, work.trial, work.T)
        trial = pose_error(work.T, target, work.e)
        if trial < cost:
            for k in range(q.shape[0]):
                q[k] = work.trial[k]
            cost, damping = trial, max(0.2 * damping, 1e-7)
        else:
            damping *= 8.0
            if damping > 1e6:
                break
            forward(arm.frames, q, work.T)
            cost = pose_error(work.T, target, work.e)
    return cost


@kernel
def reach(arm: Arm, pose: Array, start: Array, tries: int, random: RandomState, q: Array) -> float:
    """Descend to a pose (7,) from `start` (n,), and from `tries` random configurations where that does not arrive.

    Args:
        arm: the chain.
        pose: position and quaternion wxyz.
        start: where the first descent begins.
        tries: random starts that may follow it.
        random: (1,) state of their numbers.
        q: (n,) the configuration that is nearest to the pose, out.

    Returns:
        The squared pose error there.
    """
    work = scratch(q.shape[0])
    target = work.T[0].copy()
    read_target(pose, target)
    other = start.copy()
    q[:] = start
    best = descend(arm, target, q, work)
    for _ in range(tries):
        if best < CLOSE:
            break
        draw(arm, random, other)
        cost = descend(arm, target, other, work)
        if cost < best:
            best = cost
            q[:] = other
    return best


@kernel
def follow(arm: Arm, poses: Array, start: Array, way: Array, costs: Array) -> None:
    """Descend to poses (k, 7) one after the other, each from the last answer.

    Answers go into `way` (k, n), their squared pose errors into `costs` (k,).
    """
    work = scratch(start.shape[0])
    target = work.T[0].copy()
    q = start.copy()
    for i in range(poses.shape[0]):
        read_target(poses[i], target)
        costs[i] = descend(arm, target, q, work)
        way[i] = q
