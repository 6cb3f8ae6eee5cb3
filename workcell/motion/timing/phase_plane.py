"""The fastest motion along a curve: one backward and one forward pass over the phase plane, then averaged.

The phase plane is that of sd^2 over s. The passes are the controllable sets of TOPP-RA (Pham and Pham, "A new
approach to time-optimal path parameterization based on reachability analysis", 2018), in closed form for
limits on velocities, accelerations and torques.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from workcell.errors import InputError
from workcell.motion.timing.spline import SMALLEST, JointSpline
from workcell.pose import Array

_PER_INTERVAL, _APART = 6, 1e-6


def phase_grid(spline: JointSpline, intervals: int) -> Array:
    """Path positions: evenly spaced, and some in each interval of the spline, so that none of its bends is missed."""
    fractions = np.linspace(0.0, 1.0, _PER_INTERVAL, endpoint=False)
    inside = (spline.knots[:-1, None] + fractions * np.diff(spline.knots)[:, None]).ravel()
    even = np.linspace(0.0, spline.length, intervals + 1)
    s = np.unique(np.concatenate([even, inside]))
    inner = s[1:-1]
    apart = (np.diff(s)[:-1] > _APART * spline.length) & (spline.length - inner > _APART * spline.length)
    grid: Array = np.concatenate([[0.0], inner[apart], [spline.length]])
    return grid


@dataclass(frozen=True, slots=True)
class Timing:
    """s(t): constant acceleration between grid points, then averaged over a window, exactly, by its integral."""

    time: Array
    position: Array
    speed: Array
    acceleration: Array
    integral: Array
    window: float

    @staticmethod
    def along(s: Array, x: Array, window: float) -> Timing:
        """From the squared speeds x at the grid points s."""
        speed = np.sqrt(x)
        ds = np.diff(s)
        duration = 2 * ds / (speed[:-1] + speed[1:])
        time = np.concatenate([[0.0], np.cumsum(duration)])
        acceleration = np.diff(x) / (2 * ds)
        area = s[:-1] * duration + speed[:-1] * duration**2 / 2 + acceleration * duration**3 / 6
        integral = np.concatenate([[0.0], np.cumsum(area)])
        return Timing(time, s, speed, acceleration, integral, min(window, float(time[-1])))

    @property
    def duration(self) -> float:
        """Seconds, the averaging window included."""
        return float(self.time[-1]) + self.window

    def sample(self, dt: float) -> tuple[Array, Array, Array]:
        """s, sd and sdd every `dt` seconds, both ends included."""
        return self.at(np.linspace(0.0, self.duration, int(np.ceil(self.duration / dt)) + 1))

    def at(self, t: Array) -> tuple[Array, Array, Array]:
        """s, sd and sdd at times t (T,), averaged over the window."""
        early, late = self._raw(t - self.window), self._raw(t)
        s, sd, sdd = ((b - a) / self.window for a, b in zip(early, late, strict=True))
        return s, np.maximum(sd, 0.0), sdd

    def _raw(self, t: Array) -> tuple[Array, Array, Array]:
        """The integral of s, s and sd before averaging; standing still before 0 and after the end."""
        inside = np.clip(t, 0.0, self.time[-1])
        i = np.clip(np.searchsorted(self.time, inside, side="right") - 1, 0, len(self.time) - 2)
        tau = inside - self.time[i]
        a, v, p = self.acceleration[i], self.speed[i], self.position[i]
        speed = np.where((t <= 0) | (t >= self.time[-1]), 0.0, v + a * tau)
        position = p + v * tau + a * tau**2 / 2
        integral = self.integral[i] + p * tau + v * tau**2 / 2 + a * tau**3 / 6
        beyond = np.maximum(t - self.time[-1], 0.0)
        return integral + beyond * self.position[-1], position, speed


@dataclass(frozen=True, slots=True)
class PhaseRows:
    """Bounds `low <= first u + second x <= high` on u = sdd and x = sd^2 at each grid point.

    Attributes:
        first, second, low, high: (g, m), with low < 0 < high: standing still is always allowed.
    """

    first: Array
    second: Array
    low: Array
    high: Array

    def scaled(self, share: Array) -> PhaseRows:
        """The same with bounds times `share` (g,)."""
        return PhaseRows(self.first, self.second, share[:, None] * self.low, share[:, None] * self.high)

    def with_rows(self, other: PhaseRows) -> PhaseRows:
        """These bounds and others."""
        pairs = ((getattr(self, name), getattr(other, name)) for name in ("first", "second", "low", "high"))
        return PhaseRows(*(np.hstack(pair) for pair in pairs))


def fastest_squared_speed(s: Array, rows: PhaseRows, cap: Array) -> Array:
    """x = sd^2 at each grid point of the fastest motion that begins and ends at rest.

    At the grid points s (g,) the rows and `x <= cap` hold; from one point to the next `x' = x + 2 ds u`. Backward, the
    largest x from which the end can still be reached at rest; forward, the largest u that stays below it.
    """
    two_ds = 2 * np.diff(s)
    slope, low, high = _accelerations(rows)
    fixed, offset, gain = _starts(rows, slope[:-1], low[:-1], high[:-1], cap[:-1], two_ds)
    limit = np.zeros(len(s))
    for i in range(len(s) - 2, -1, -1):
        limit[i] = max(min(fixed[i], (offset[i] + gain[i] * limit[i + 1]).min()), 0.0)
    x = np.zeros(len(s))
    for i in range(len(s) - 1):
        fastest = x[i] + two_ds[i] * (high[i] + slope[i] * x[i]).min()
        x[i + 1] = min(max(fastest, 0.0), limit[i + 1])
    return x


def _accelerations(rows: PhaseRows) -> tuple[Array, Array, Array]:
    """(g, m) bounds `low + slope x <= u <= high + slope x` of the rows that contain u; none for the others."""
    acting = np.abs(rows.first) > SMALLEST
    first = np.where(acting, rows.first, 1.0)
    ends = rows.low / first, rows.high / first
    slope = np.where(acting, -rows.second / first, 0.0)
    return slope, np.where(acting, np.minimum(*ends), -np.inf), np.where(acting, np.maximum(*ends), np.inf)


def _starts(
    rows: PhaseRows, slope: Array, low: Array, high: Array, cap: Array, two_ds: Array
) -> tuple[Array, Array, Array]:
    """The largest x from which some admissible u leads to `x + 2 ds u` in [0, x'], for each of g - 1 intervals.

    It is the least of `fixed` (g - 1,) and of the lines `offset + gain x'` (g - 1, m) in the x' at the interval's
    end. Every lower bound `l(x)` on u must stay below every upper bound `h(x)`; both are lines in x, so each pair
    gives one upper end for x. The way into [0, x'] gives one more line of each kind, and a row without u bounds x
    alone.
    """
    acting, second = np.isfinite(high), rows.second[:-1]
    alone = ~acting & (np.abs(second) > SMALLEST)
    bound = np.where(second > 0, rows.high[:-1], rows.low[:-1]) / np.where(alone, second, 1.0)
    fixed = np.minimum(cap, np.where(alone, bound, np.inf).min(axis=1))
    closing = (
        slope[:, :, None] - slope[:, None, :]
    )  # row by row, how fast the upper bound falls towards the lower
    gaps = high[:, None, :] - low[:, :, None]
    fixed = np.minimum(fixed, _ends(gaps, closing).min(axis=(1, 2), initial=np.inf))
    inverse = 1 / two_ds[:, None]
    fixed = np.minimum(fixed, _ends(high, -(slope + inverse)).min(axis=1, initial=np.inf))
    meets = acting & (slope + inverse > SMALLEST)
    rate = np.where(meets, slope + inverse, 1.0)
    return fixed, np.where(meets, -low / rate, np.inf), np.where(meets, inverse / rate, 0.0)


def _ends(gap: Array, closing: Array) -> Array:
    """Where gaps that close by `closing` a unit of x are closed; inf for those that don't."""
    found: Array = np.where(closing > SMALLEST, gap / np.where(closing > SMALLEST, closing, 1.0), np.inf)
    return found


def rest_to_rest(corners: Array, velocity: Array, acceleration: Array) -> float:
    """Seconds of the fastest motion along straight lines (k, n) that stands still at every corner.

    On a line all joints share one s(t): it accelerates, cruises and brakes at the largest rates that the limits (n,) of
    every joint allow.

    Raises:
        InputError: a limit that is zero, negative or NaN.
    """
    for name, limits in (("velocity", velocity), ("acceleration", acceleration)):
        if not np.all(limits > 0):
            raise InputError(
                f"{name} limits of {limits.tolist()} allow no motion", where=name, remedy="positive limits"
            )
    total = 0.0
    for step in np.abs(np.diff(corners, axis=0)):
        moving = step > SMALLEST
        if moving.any():
            speed = float(np.min(velocity[moving] / step[moving]))
            rate = float(np.min(acceleration[moving] / step[moving]))
            total += 1 / speed + speed / rate if speed * speed < rate else 2 / np.sqrt(rate)
    return total
