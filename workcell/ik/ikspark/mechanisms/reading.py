"""What a rank-1 point says: the configuration, in whole turns that the limits allow, and how exact it is."""

from __future__ import annotations

import numpy as np
from numpy.polynomial import polynomial

from workcell.ik.ikspark.mechanisms.lift import MechanismLift
from workcell.ik.ikspark.mechanisms.relaxation import Relaxation
from workcell.pose import Array

_TURN = 2.0 * np.pi


def read(relaxation: Relaxation, x: Array) -> Array:
    """The configuration (size,) of a point (N,) of rank 1."""
    problem, lift = relaxation.problem, relaxation.lift
    mechanism, q = lift.mechanism, lift.read(x)
    for k, (joint, at) in enumerate(zip(mechanism.joints, mechanism.value_slices, strict=True)):
        if joint.kind == "hinge":
            low, high = map(float, relaxation.interval[k])
            reference = None if problem.q_reference is None else float(problem.q_reference[at.start])
            q[at.start] = _into(float(q[at.start]), low, high, reference)
    for follower in mechanism.followers:
        # which of its turns a joint that follows is in, its leader knows
        at = mechanism.value_slices[follower.joint].start
        leader = 0.0 if follower.leader < 0 else q[mechanism.value_slices[follower.leader].start]
        wanted = float(polynomial.polyval(leader, follower.coefficients))
        if mechanism.joints[follower.joint].kind == "hinge":
            q[at] += _TURN * round((wanted - q[at]) / _TURN)
    return q


def _into(angle: float, lower: float, upper: float, reference: float | None) -> float:
    """The angle by whole turns into an interval, or as near to it as turns bring it; nearest to the reference."""
    if reference is None:
        reference = 0.5 * (lower + upper) if np.isfinite(lower + upper) else 0.0
    found = angle + _TURN * round((reference - angle) / _TURN)
    for turned in (found, found - _TURN, found + _TURN):
        if lower - 1e-6 <= turned <= upper + 1e-6:
            return float(np.clip(turned, lower, upper))
    return found


def off_rotations(lift: MechanismLift, x: Array) -> float:
    """Largest Frobenius distance of a link's rotation, as the variables have it, from the nearest true one."""
    R = lift.rotations[..., :-1] @ x + lift.rotations[..., -1]
    singular = np.linalg.svd(R, compute_uv=False)
    return float(np.linalg.norm(singular - 1.0, axis=1).max(initial=0.0))
