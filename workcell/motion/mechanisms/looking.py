"""What lies between the waypoints of a mechanism's way, looked at moment by moment. This is no proof."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from workcell.ik.mechanisms.result import Measured
from workcell.model.mechanism.following import given_joints
from workcell.motion.mechanisms.path import MechanismMotion
from workcell.pose import Array

Measure = Callable[[Array], Measured]
"""The judge's measure of a configuration (size,)."""


@dataclass(frozen=True, slots=True)
class Looked:
    """What was seen along a motion.

    Attributes:
        times: seconds of the moments that were looked at.
        spacing: largest change of what motors move from one of them to the next, radians or metres.
        closure_error: worst that a tie misses, metres or radians.
        clearance: smallest signed distance, metres; inf where nothing could meet.
        reason: what is wrong at the first moment at which something is, in words; empty: nothing is.
    """

    times: tuple[float, ...]
    spacing: float
    closure_error: float
    clearance: float
    reason: str

    @property
    def words(self) -> str:
        """What was looked at, and what it showed."""
        clear = "" if np.isinf(self.clearance) else f", {1e3 * self.clearance:.1f} mm clear or more"
        return (
            f"looked at {len(self.times)} times, motors {self.spacing:.2g} apart at most, by the compiled model: "
            f"ties within {self.closure_error:.1e}{clear}"
        )


def look_along(motion: MechanismMotion, measure: Measure, spacing: float) -> Looked:
    """Measure a motion wherever a motor has moved by `spacing` (radians or metres) since the moment before.

    Both ends are looked at. A spacing that a single time step exceeds looks at every step.
    """
    motors = [motion.mechanism.value_slices[k].start for k in given_joints(motion.mechanism)]
    values = motion.q[:, motors]
    worst_tie, least, apart = 0.0, np.inf, 0.0
    times: list[float] = []
    before = 0
    for k, q in enumerate(motion.q):
        if times:
            ahead = min(k + 1, len(motion) - 1)
            step = np.abs(values[ahead] - values[before]).max(initial=0.0)
            if step <= spacing and k < len(motion) - 1:
                continue
            apart = max(apart, float(np.abs(values[k] - values[before]).max(initial=0.0)))
        seen = measure(q)
        times.append(float(motion.time[k]))
        before = k
        worst_tie, least = max(worst_tie, seen.closure_error), min(least, seen.clearance.distance)
        if not seen.accepted:
            reason = f"at {times[-1]:.2f} s: {'; '.join(seen.reasons)}"
            return Looked(tuple(times), apart, worst_tie, least, reason)
    return Looked(tuple(times), apart, worst_tie, least, "")
