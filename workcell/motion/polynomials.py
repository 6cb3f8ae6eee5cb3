"""Joint motions that are polynomials of time, piece by piece: a trajectory between samples, and bounds on it."""

from __future__ import annotations

from dataclasses import dataclass
from math import comb

import numpy as np

from workcell.errors import InputError
from workcell.motion.path import Trajectory
from workcell.pose import Array, read_only


@dataclass(frozen=True, slots=True)
class PolynomialMotion:
    """Pieces q_k(t) = sum_m coefficients[i, k, m] t^m, with t from 0 to durations[i] on piece i.

    Attributes:
        coefficients: (p, n, m) power coefficients; radians (metres) and seconds.
        durations: (p,) positive, seconds.

    Raises:
        InputError: wrong shapes, no piece, not finite, or a duration that is not positive.
    """

    coefficients: Array
    durations: Array

    def __post_init__(self) -> None:
        c, d = np.asarray(self.coefficients, dtype=float), np.asarray(self.durations, dtype=float)
        if c.ndim != 3 or d.shape != c.shape[:1] or len(d) == 0 or c.shape[2] == 0:
            raise InputError(
                f"pieces of shape {c.shape} with durations of shape {d.shape} are no motion",
                where="coefficients",
                remedy="(p, n, m) and (p,), with at least one of each",
            )
        if not (np.all(np.isfinite(c)) and np.all(np.isfinite(d)) and np.all(d > 0)):
            raise InputError(
                "a motion takes finite coefficients and positive durations", where="coefficients"
            )
        object.__setattr__(self, "coefficients", read_only(c))
        object.__setattr__(self, "durations", read_only(d))

    def __len__(self) -> int:
        return len(self.durations)

    @property
    def duration(self) -> float:
        """Seconds in total."""
        return float(self.durations.sum())

    @staticmethod
    def of_trajectory(trajectory: Trajectory) -> PolynomialMotion:
        """What a trajectory is between its samples: quintics that share position, velocity and acceleration there."""
        h = trajectory.dt
        q0, q1 = trajectory.q[:-1], trajectory.q[1:]
        v0, v1 = h * trajectory.qd[:-1], h * trajectory.qd[1:]
        a0, a1 = h * h * trajectory.qdd[:-1], h * h * trajectory.qdd[1:]
        d = q1 - q0
        scaled = np.stack(
            [
                q0,
                v0,
                a0 / 2,
                10 * d - 6 * v0 - 4 * v1 - 1.5 * a0 + 0.5 * a1,
                -15 * d + 8 * v0 + 7 * v1 + 1.5 * a0 - a1,
                6 * d - 3 * (v0 + v1) - 0.5 * (a0 - a1),
            ],
            axis=2,
        )
        return PolynomialMotion(scaled / h ** np.arange(6), np.full(len(q0), h))

    def at(self, t: Array, order: int = 0) -> Array:
        """Derivative `order` (T, n) at times t (T,) from the beginning; the ends beyond them."""
        begins = np.concatenate([[0.0], np.cumsum(self.durations)])
        inside = np.clip(np.asarray(t, dtype=float), 0.0, begins[-1])
        i = np.clip(np.searchsorted(begins, inside, side="right") - 1, 0, len(self) - 1)
        tau = (inside - begins[i])[:, None]
        c = self.coefficients[i]
        value = np.zeros(c.shape[:2])
        for m in range(c.shape[2] - 1, order - 1, -1):
            factor = np.prod(np.arange(m - order + 1, m + 1, dtype=float))
            value = value * tau + factor * c[:, :, m]
        return value

    def divided(self, parts: int) -> PolynomialMotion:
        """The same motion with every piece cut into `parts` equal ones: the bounds of `largest` get tighter."""
        size = self.coefficients.shape[2]
        cut = []
        for part in range(parts):
            t = (part / parts) * self.durations[:, None, None]
            # around t: coefficient m is the sum over j >= m of binomial(j, m) c_j t^(j - m)
            shifted = [
                sum(comb(j, m) * self.coefficients[:, :, j : j + 1] * t ** (j - m) for j in range(m, size))
                for m in range(size)
            ]
            cut.append(np.concatenate(shifted, axis=2))
        pieces = np.stack(cut, axis=1).reshape(-1, *self.coefficients.shape[1:])
        return PolynomialMotion(pieces, np.repeat(self.durations / parts, parts))

    def largest(self, order: int) -> Array:
        """(p, n) upper bounds on the absolute value of derivative `order` over each piece.

        The largest Bernstein coefficient: a polynomial lies in the hull of them (Farouki, "The Bernstein polynomial
        basis: a centennial retrospective", 2012).
        """
        size = self.coefficients.shape[2]
        degree = size - 1 - order
        if degree < 0:
            return np.zeros(self.coefficients.shape[:2])
        factors = [np.prod(np.arange(m - order + 1, m + 1, dtype=float)) for m in range(order, size)]
        scaled = self.coefficients[:, :, order:] * np.array(factors)
        scaled = scaled * self.durations[:, None, None] ** np.arange(degree + 1)
        to_bernstein = np.array(
            [
                [comb(i, m) / comb(degree, m) if m <= i else 0.0 for m in range(degree + 1)]
                for i in range(degree + 1)
            ]
        )
        bound: Array = np.abs(scaled @ to_bernstein.T).max(axis=2)
        return bound
