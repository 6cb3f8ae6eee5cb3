"""`Feed`: the frames of live inverse kinematics as what a controller tracks at every step of a simulation."""

from __future__ import annotations

import numpy as np

from workcell.pose import Array

_STILL = 1e-8
"""Radians or metres a frame below which a joint rests."""


class Feed:
    """Joints that a frame has at its end, as positions, velocities and accelerations at every step in between.

    The frames are control points of a quadratic B-spline: velocities change evenly over a frame, from that of the
    frame before to its own, so that no limit that the frames keep is exceeded between them. The arm is half a frame
    late, and cuts corners by an eighth of what a joint's acceleration makes in a frame.

    Args:
        q: (n,) where the joints rest at the beginning.
        steps: of the simulation, in a frame.
        timestep: of the simulation, seconds.
    """

    def __init__(self, q: Array, steps: int, timestep: float) -> None:
        self._before, self._now = np.array(q, dtype=float), np.array(q, dtype=float)
        self._fed = self._now
        self._share = (np.arange(steps + 1) / steps)[:, None]
        self._dt = timestep

    @property
    def rests(self) -> bool:
        """Whether the last two frames were one place."""
        return bool(np.abs(self._now - self._before).max(initial=0.0) < _STILL)

    def to(self, q: Array) -> tuple[Array, Array, Array]:
        """q, qd, qdd (steps, n) of a frame at whose end the joints (n,) should be.

        They are differences, as MuJoCo's integration makes them: velocities backwards, accelerations forwards (see
        `workcell.simulate.controller.discrete_reference`).
        """
        last, now = self._now - self._before, np.array(q, dtype=float)
        changed = (now - self._now) - last
        begin = 0.5 * (self._before + self._now)
        points = begin + self._share * last + 0.5 * self._share**2 * changed
        whole = np.vstack([self._fed[None], points])
        qd = np.diff(whole, axis=0) / self._dt
        self._before, self._now, self._fed = self._now, now, points[-2]
        return points[:-1], qd[:-1], np.diff(qd, axis=0) / self._dt
