"""Timing of a path: smooth motion, at rest at both ends, within velocity and acceleration limits.

Three steps. A C2 cubic spline through the waypoints over their joint-space chord length s (corners get extra support
points, so that the spline stays near the straight lines). The fastest s(t) under the limits, on a grid, by one backward
and one forward pass over the phase plane (the controllable sets of TOPP-RA: Pham and Pham, "A new approach to
time-optimal path parameterization based on reachability analysis", 2018). A moving average of s(t), which keeps the
geometry and makes the acceleration continuous. Limits are then verified on a dense evaluation, and the whole motion is
slowed down by the small factor that is missing.
"""

from __future__ import annotations

from dataclasses import dataclass
from itertools import pairwise

import numpy as np
from numpy.typing import ArrayLike, NDArray

from workcell.errors import InputError
from workcell.model.robot import Robot
from workcell.motion.path import Path, Trajectory
from workcell.pose import Array

_DENSE = 5
"""Evaluations a time step when limits are verified."""
_HEADROOM = 1.0005
"""Left for what lies between two dense evaluations."""
_RINGING = 0.05
"""Corner angle times segment length (radians squared) from which a corner gets support points: 1 mrad off the line."""
_PER_INTERVAL, _APART = 6, 1e-6
_ROUNDS, _CLOSE = 6, 1.02
"""Rounds in which places that exceed a limit after averaging get less of it, and the excess that ends them."""
_SMALLEST = 1e-12


@dataclass(frozen=True, slots=True)
class LimitUse:
    """Largest share of each limit that a motion uses: 1 is all of it.

    Attributes:
        velocity, acceleration: (n,) largest |value| / limit of each joint.
    """

    velocity: Array
    acceleration: Array

    @property
    def kept(self) -> bool:
        """Whether both limits hold for every joint."""
        return bool(max(self.velocity.max(), self.acceleration.max()) <= 1.0)


def retime(
    path: Path,
    velocity: ArrayLike | None = None,
    acceleration: ArrayLike | None = None,
    *,
    tool_speed: float | None = None,
    dt: float = 0.002,
    smoothing_s: float = 0.06,
    support: float = 0.02,
    grid: int = 400,
) -> Trajectory:
    """Time a path: C2, at rest at both ends, within the limits, sampled every `dt` seconds.

    Args:
        path: waypoints; the motion passes through each of them (by a hair inside, at a joint limit).
        velocity, acceleration: (n,) or scalar largest absolute values; None: the robot's own.
        tool_speed: largest speed of the tool, metres a second; None: no bound.
        dt: seconds between samples.
        smoothing_s: width of the moving average over s(t); the acceleration changes over this time.
        support: joint-space distance (radians) from a sharp corner to the first of the extra spline points that hold
            the motion on the straight lines; inf leaves them out.
        grid: intervals of the phase plane.

    Raises:
        InputError: a limit that is zero, negative, NaN or (for the acceleration) infinite; a path that does not move,
            or that runs so close to a joint limit that no smooth motion through it keeps the limit.
    """
    robot = path.robot
    v_max, a_max = motion_limits(robot, velocity, acceleration)
    if tool_speed is not None and not tool_speed > 0:
        raise InputError(
            f"the tool's speed limit is {tool_speed}", where="tool_speed", remedy="a positive number"
        )
    spline = _spline_within_limits(path, support)
    timing = _timing(robot, spline, v_max, a_max, tool_speed, smoothing_s, dt, grid)
    slower = _HEADROOM * _slowdown(robot, spline, timing.sample(dt / _DENSE), v_max, a_max, tool_speed)
    steps = int(np.ceil(timing.duration * slower / dt - 1e-9))
    slower = steps * dt / timing.duration
    time: Array = dt * np.arange(steps + 1, dtype=float)
    s, sd, sdd = timing.at(time / slower)
    q, qd, qdd = spline.motion(s, sd / slower, sdd / slower**2)
    return Trajectory(robot.name, time, q, qd, qdd)


def _spline_within_limits(path: Path, support: float) -> _Spline:
    """A spline that keeps the joint limits: where it would swing beyond one, inner points move inside by as much.

    Where that is not enough, support points at every corner shorten the swings first.
    """
    robot = path.robot
    for ringing in (_RINGING, 0.0):
        points = _with_support(path.configurations, support, ringing)
        for _ in range(_ROUNDS):
            spline = _Spline.through(points)
            fractions = np.linspace(0.0, 1.0, 4 * _PER_INTERVAL, endpoint=False)
            s = spline.knots[:-1, None] + fractions * np.diff(spline.knots)[:, None]
            q = spline.derivatives(s.ravel())[0].reshape(*s.shape, robot.dof)
            if np.all(robot.within_limits(q)):
                return spline
            beyond = np.maximum(q - robot.upper, 0.0).max(axis=1) - np.maximum(robot.lower - q, 0.0).max(
                axis=1
            )
            worst = np.where(np.abs(beyond[1:]) > np.abs(beyond[:-1]), beyond[1:], beyond[:-1])
            points = points.copy()
            points[1:-1] -= 1.2 * worst
    k = int(np.argmax(np.abs(beyond).max(axis=0)))
    raise InputError(
        f"between waypoints the smooth motion would leave the limits of {robot.joint_names[k]}",
        where="path",
        remedy="keep the waypoints a little further inside the joint limits",
    )


def _timing(
    robot: Robot,
    spline: _Spline,
    v_max: Array,
    a_max: Array,
    tool_speed: float | None,
    smoothing_s: float,
    dt: float,
    grid: int,
) -> _Timing:
    """The fastest s(t), smoothed; where smoothing makes it exceed a limit, the search is repeated with less of it."""
    s = _grid(spline, grid)
    q, first, second = spline.derivatives(s)
    cap = _speed_cap(robot, q, first, v_max, tool_speed)
    share = np.ones(len(s))
    for _ in range(_ROUNDS):
        x = _fastest_squared_speed(s, first, second, cap, share[:, None] * a_max)
        timing = _Timing.along(s, x, smoothing_s)
        excess = _excess(spline, timing, a_max, dt)
        if excess.max() <= _CLOSE:
            break
        share /= excess
    return timing


def _speed_cap(robot: Robot, q: Array, first: Array, v_max: Array, tool_speed: float | None) -> Array:
    """The largest sd^2 at each grid point under the joints' and the tool's speed limits."""
    cap: Array = np.min((v_max / np.maximum(np.abs(first), _SMALLEST)) ** 2, axis=1)
    if tool_speed is not None:
        cap = np.minimum(cap, (tool_speed / np.maximum(_tool_speed(robot, q, first), _SMALLEST)) ** 2)
    return cap


def _tool_speed(robot: Robot, q: Array, qd: Array) -> Array:
    speed: Array = np.linalg.norm(np.einsum("tij,tj->ti", robot.jacobian(q)[:, :3], qd), axis=1)
    return speed


def _excess(spline: _Spline, timing: _Timing, a_max: Array, dt: float) -> Array:
    """By what factor, at least 1, the averaged motion exceeds an acceleration limit near each grid point."""
    dense = timing.sample(dt)
    use = (np.abs(spline.motion(*dense)[2]) / a_max).max(axis=1)
    time = np.linspace(0.0, timing.duration, len(use))
    first = np.searchsorted(time, timing.time - dt)
    last = np.searchsorted(time, timing.time + timing.window + dt)
    worst = [use[i : max(j, i + 1)].max() for i, j in zip(first, last, strict=True)]
    excess: Array = np.maximum(np.array(worst), 1.0)
    return excess


def _slowdown(
    robot: Robot,
    spline: _Spline,
    timing: tuple[Array, Array, Array],
    v_max: Array,
    a_max: Array,
    tool_speed: float | None,
) -> float:
    """The factor by which a motion must be slowed down, so that no limit is exceeded at any of its samples."""
    q, qd, qdd = spline.motion(*timing)
    use = _limit_use(qd, qdd, v_max, a_max)
    factor = max(1.0, float(use.velocity.max()), float(np.sqrt(use.acceleration.max())))
    if tool_speed is not None:
        factor = max(factor, float(_tool_speed(robot, q[::_DENSE], qd[::_DENSE]).max()) / tool_speed)
    return factor


def motion_limits(
    robot: Robot, velocity: ArrayLike | None, acceleration: ArrayLike | None
) -> tuple[Array, Array]:
    """(n,) velocity and acceleration limits: the given ones, or the robot's; checked."""
    limits = []
    for name, given, own in (
        ("velocity", velocity, robot.velocity),
        ("acceleration", acceleration, robot.acceleration),
    ):
        values = np.broadcast_to(np.asarray(own if given is None else given, dtype=float), (robot.dof,))
        bad = np.isnan(values) | (values <= 0)
        if name == "acceleration":
            bad |= np.isinf(values)
        if np.any(bad):
            joint = int(np.argmax(bad))
            raise InputError(
                f"the {name} limit of {robot.joint_names[joint]} is {values[joint]}",
                where=name,
                remedy="pass positive, finite limits: one number, or one for each joint",
            )
        limits.append(np.array(values))
    return limits[0], limits[1]


def limit_use(trajectory: Trajectory, velocity: ArrayLike, acceleration: ArrayLike) -> LimitUse:
    """The share of each limit that a trajectory uses at its samples."""
    return _limit_use(
        trajectory.qd, trajectory.qdd, np.asarray(velocity, float), np.asarray(acceleration, float)
    )


def _limit_use(qd: Array, qdd: Array, v_max: Array, a_max: Array) -> LimitUse:
    return LimitUse(np.abs(qd).max(axis=0) / v_max, np.abs(qdd).max(axis=0) / a_max)


def _with_support(waypoints: Array, support: float, ringing: float) -> Array:
    """Waypoints without repetitions, with points at 1, 2, 4 ... times `support` from corners along long segments.

    A cubic spline rings after a corner by about a fiftieth of the corner's angle times the length of the segment; where
    that is too much, extra points hold it on the line. The ringing decays by a factor of about four a knot, so that
    the spacing may double from knot to knot.
    """
    moved = np.append(True, np.abs(np.diff(waypoints, axis=0)).max(axis=1) > _SMALLEST)
    points = waypoints[moved]
    if len(points) < 2:
        raise InputError(
            "the path does not move", where="path", remedy="a path takes two different configurations"
        )
    corners = np.concatenate([[0.0], _turning_angles(points), [0.0]])
    out = [points[:1]]
    for (a, b), (before, after) in zip(pairwise(points), pairwise(corners), strict=True):
        length = float(np.linalg.norm(b - a))
        far = length / (2.5 * support)
        near = support * 2.0 ** np.arange(int(np.log2(far)) + 1) / length if far > 1 else np.zeros(0)
        first = near if before * length > ringing else np.zeros(0)
        last = 1 - near[::-1] if after * length > ringing else np.zeros(0)
        fractions = np.concatenate([first, last, [1.0]])
        out.append(a + fractions[:, None] * (b - a))
    return np.vstack(out)


def _turning_angles(points: Array) -> Array:
    """Angles (k - 2,) between the directions of neighbouring segments."""
    steps = np.diff(points, axis=0)
    steps = steps / np.linalg.norm(steps, axis=1, keepdims=True)
    angles: Array = 2 * np.arcsin(np.clip(np.linalg.norm(np.diff(steps, axis=0), axis=1) / 2, 0.0, 1.0))
    return angles


@dataclass(frozen=True, slots=True)
class _Spline:
    """A C2 cubic spline q(s), natural at both ends, over chord length."""

    knots: Array
    points: Array
    second: Array

    @staticmethod
    def through(points: Array) -> _Spline:
        """Solve the tridiagonal system for the second derivatives at the knots."""
        h = np.linalg.norm(np.diff(points, axis=0), axis=1)
        knots = np.concatenate([[0.0], np.cumsum(h)])
        second = np.zeros_like(points)
        if len(points) > 2:
            from scipy.linalg import solve_banded

            slope = np.diff(points, axis=0) / h[:, None]
            bands = np.zeros((3, len(points) - 2))
            bands[0, 1:], bands[1], bands[2, :-1] = h[1:-1], 2 * (h[:-1] + h[1:]), h[1:-1]
            second[1:-1] = solve_banded((1, 1), bands, 6 * np.diff(slope, axis=0))
        return _Spline(knots, points, second)

    @property
    def length(self) -> float:
        return float(self.knots[-1])

    def derivatives(self, s: Array) -> tuple[Array, Array, Array]:
        """q, dq/ds and d2q/ds2 at s (T,): (T, n) each."""
        s = np.clip(s, 0.0, self.length)
        i = np.clip(np.searchsorted(self.knots, s, side="right") - 1, 0, len(self.knots) - 2)
        h = (self.knots[i + 1] - self.knots[i])[:, None]
        b = (s - self.knots[i])[:, None] / h
        a = 1 - b
        p0, p1, m0, m1 = self.points[i], self.points[i + 1], self.second[i], self.second[i + 1]
        q = a * p0 + b * p1 + ((a**3 - a) * m0 + (b**3 - b) * m1) * h**2 / 6
        first = (p1 - p0) / h + ((3 * b**2 - 1) * m1 - (3 * a**2 - 1) * m0) * h / 6
        return q, first, a * m0 + b * m1

    def motion(self, s: Array, sd: Array, sdd: Array) -> tuple[Array, Array, Array]:
        """q, qd and qdd (T, n) of a motion s(t) along the spline."""
        q, first, second = self.derivatives(s)
        return q, first * sd[:, None], second * sd[:, None] ** 2 + first * sdd[:, None]


def _grid(spline: _Spline, intervals: int) -> Array:
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
class _Timing:
    """s(t): constant acceleration between grid points, then averaged over a window, exactly, by its integral."""

    time: Array
    position: Array
    speed: Array
    acceleration: Array
    integral: Array
    window: float

    @staticmethod
    def along(s: Array, x: Array, window: float) -> _Timing:
        """From the squared speeds x at the grid points s."""
        speed = np.sqrt(x)
        ds = np.diff(s)
        duration = 2 * ds / (speed[:-1] + speed[1:])
        time = np.concatenate([[0.0], np.cumsum(duration)])
        acceleration = np.diff(x) / (2 * ds)
        area = s[:-1] * duration + speed[:-1] * duration**2 / 2 + acceleration * duration**3 / 6
        integral = np.concatenate([[0.0], np.cumsum(area)])
        return _Timing(time, s, speed, acceleration, integral, min(window, float(time[-1])))

    @property
    def duration(self) -> float:
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


def _fastest_squared_speed(s: Array, first: Array, second: Array, cap: Array, a_max: Array) -> Array:
    """x = sd^2 at each grid point of the fastest motion that begins and ends at rest.

    All arguments have a row for each grid point. There, with u = sdd: `|first u + second x| <= a_max` and `x <= cap`; from one point to the
    next `x' = x + 2 ds u`. Backward, the largest x from which the end can still be reached at rest; forward, the
    largest u that stays below it.
    """
    ds = np.diff(s)
    limit = np.zeros(len(s))
    for i in range(len(s) - 2, -1, -1):
        limit[i] = _largest_start(first[i], second[i], a_max[i], cap[i], 2 * ds[i], limit[i + 1])
    x = np.zeros(len(s))
    for i in range(len(s) - 1):
        _, high = _acceleration_range(first[i], second[i], a_max[i], x[i])
        x[i + 1] = min(max(x[i] + 2 * ds[i] * high, 0.0), limit[i + 1])
    return x


def _acceleration_range(first: Array, second: Array, a_max: Array, x: float) -> tuple[float, float]:
    """Smallest and largest u with `|first u + second x| <= a_max` in every joint that moves."""
    moving = np.abs(first) > _SMALLEST
    if not moving.any():
        return -np.inf, np.inf
    f, c = np.abs(first[moving]), second[moving] * np.sign(first[moving]) * x
    return float(np.max((-a_max[moving] - c) / f)), float(np.min((a_max[moving] - c) / f))


def _largest_start(
    first: Array, second: Array, a_max: Array, cap: float, two_ds: float, x_next: float
) -> float:
    """The largest x <= cap from which some admissible u leads to `x + 2 ds u` in [0, x_next].

    Every lower bound `l(x)` on u must stay below every upper bound `h(x)`; both are lines in x, so each pair gives one
    upper end for x. The way into [0, x_next] gives one more line of each kind.
    """
    moving = np.abs(first) > _SMALLEST
    f, slope = np.abs(first[moving]), second[moving] * np.sign(first[moving])
    low_0, low_1 = -a_max[moving] / f, -slope / f
    high_0, high_1 = a_max[moving] / f, -slope / f
    low_0, low_1 = np.append(low_0, 0.0), np.append(low_1, -1 / two_ds)
    high_0, high_1 = np.append(high_0, x_next / two_ds), np.append(high_1, -1 / two_ds)
    still = ~moving & (np.abs(second) > _SMALLEST)
    if np.any(still):
        cap = min(cap, float(np.min(a_max[still] / np.abs(second[still]))))
    gap_0 = high_0[None, :] - low_0[:, None]
    gap_1 = high_1[None, :] - low_1[:, None]
    closing = gap_1 < -_SMALLEST
    ends: NDArray[np.float64] = gap_0[closing] / -gap_1[closing]
    return max(min(cap, float(ends.min(initial=np.inf))), 0.0)
