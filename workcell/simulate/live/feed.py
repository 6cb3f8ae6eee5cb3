"""`Feed`: the frames of live inverse kinematics as what a controller tracks at every step of a simulation."""

from __future__ import annotations

import numpy as np

from workcell.pose import Array

_STILL, _SLOW = 1e-4, 1e-6
"""Radians or metres a frame, and a second at its end, below which a joint rests."""


class Feed:
    """Joints that a frame has at its end, as positions, velocities and accelerations at every step in between.

    A frame leads from one position, velocity and acceleration to the next. The curve between them is the polynomial of
    fifth degree; where a frame's jerk is constant, as that of steps which were shown to be clear, it is that very step.

    Args:
        q: (n,) where the joints rest at the beginning.
        steps: of the simulation, in a frame.
        timestep: of the simulation, seconds.
    """

    def __init__(self, q: Array, steps: int, timestep: float) -> None:
        self._state = np.stack([np.array(q, dtype=float), np.zeros(len(q)), np.zeros(len(q))])
        self._fed, self._rests = self._state[0], True
        self._share = (np.arange(steps + 1) / steps)[:, None]
        self._dt, self._period = timestep, steps * timestep

    @property
    def rests(self) -> bool:
        """Whether the joints rest at the end of the last frame."""
        return self._rests

    def to(self, q: Array, qd: Array, qdd: Array) -> tuple[Array, Array, Array]:
        """q, qd, qdd (steps, n) of a frame at whose end the joints are at q, with qd and qdd (n,).

        They are differences, as MuJoCo's integration makes them: velocities backwards, accelerations forwards (see
        `workcell.simulate.controller.discrete_reference`).
        """
        state = np.array([q, qd, qdd], dtype=float)
        points = _between(self._state, state, self._period, self._share)
        whole = np.vstack([self._fed[None], points])
        velocity = np.diff(whole, axis=0) / self._dt
        moved = np.abs(state[0] - self._state[0]).max(initial=0.0)
        self._rests = bool(moved < _STILL and np.abs(state[1]).max(initial=0.0) < _SLOW)
        self._state, self._fed = state, points[-2]
        return points[:-1], velocity[:-1], np.diff(velocity, axis=0) / self._dt


def _between(begin: Array, end: Array, period: float, share: Array) -> Array:
    """Positions at shares (k, 1) of a period, between states (3, n) of position, velocity and acceleration."""
    (q, v, a), scale = begin, period**2
    away = end[0] - q - period * v - 0.5 * scale * a
    faster = period * (end[1] - v) - scale * a
    harder = scale * (end[2] - a)
    cubic = 10.0 * away - 4.0 * faster + 0.5 * harder
    quartic = -15.0 * away + 7.0 * faster - harder
    quintic = 6.0 * away - 3.0 * faster + 0.5 * harder
    higher = cubic + share * (quartic + share * quintic)
    points: Array = q + share * (period * v + share * (0.5 * scale * a + share * higher))
    return points
