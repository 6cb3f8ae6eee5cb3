"""Random configurations of a mechanism, within its limits."""

from __future__ import annotations

import numpy as np

from workcell.model.mechanism.mechanism import Mechanism
from workcell.pose import Array


def random_configuration(
    mechanism: Mechanism, rng: np.random.Generator, *, reach: float | None = None
) -> Array:
    """A configuration (size,) with every joint anywhere within its limits, and followers where their leaders say.

    Hinges without limits are anywhere in a turn; slides without, and floating bodies, within `reach` metres of home.
    Balls are uniform in rotation, or in angle within a limit. Loops are not closed.

    Args:
        mechanism: whose.
        rng: draws.
        reach: metres; None: what `reach_of` says.
    """
    reach = reach_of(mechanism) if reach is None else reach
    q = np.array(mechanism.home)
    for joint, at in zip(mechanism.joints, mechanism.value_slices, strict=True):
        if joint.kind in ("hinge", "slide"):
            middle, half = q[at.start], np.pi if joint.kind == "hinge" else reach
            lower = joint.lower if np.isfinite(joint.lower) else min(middle, joint.upper) - half
            upper = joint.upper if np.isfinite(joint.upper) else max(middle, joint.lower) + half
            q[at] = rng.uniform(lower, upper)
            continue
        if joint.kind == "free":
            q[at.start : at.start + 3] += rng.uniform(-reach, reach, 3)
        q[at.stop - 4 : at.stop] = _turn(rng, joint.upper)
    for follower in mechanism.followers:
        x = q[mechanism.value_slices[follower.leader].start] if follower.leader >= 0 else 0.0
        joint = mechanism.joints[follower.joint]
        value = np.polynomial.polynomial.polyval(x, follower.coefficients)
        q[mechanism.value_slices[follower.joint]] = np.clip(value, joint.lower, joint.upper)
    return q


def reach_of(mechanism: Mechanism) -> float:
    """Metres that the mechanism's parts may be from each other: lengths of links and of closures, travels of slides."""
    length = 0.0
    for joint in mechanism.joints:
        length += float(np.linalg.norm(joint.T_parent_joint.position))
        if joint.kind == "slide" and np.isfinite(joint.upper - joint.lower):
            length += joint.upper - joint.lower
    ends = [np.linalg.norm(frame.position) for closure in mechanism.closures for frame in closure.frames]
    return min(max(length / 2, float(max(ends, default=0.0)), 0.1), 10.0)


def _turn(rng: np.random.Generator, upper: float) -> Array:
    """A unit quaternion: uniform, or of an angle up to a limit about any axis."""
    quat = rng.normal(size=4)
    if np.isfinite(upper) and upper < np.pi:
        axis, angle = quat[1:] / np.linalg.norm(quat[1:]), rng.uniform(0.0, upper)
        return np.concatenate([[np.cos(0.5 * angle)], np.sin(0.5 * angle) * axis])
    unit: Array = quat / np.linalg.norm(quat)
    return unit
