"""A mechanism's way over time: one path parameter, at rest at both ends, within the limits of its motors.

All joints go along a C2 spline through the waypoints (`workcell.motion.timing.spline`), as fast as the velocities and
accelerations of those that motors move allow (`workcell.motion.timing.phase_plane`). At places close to each other the
ties are closed: by the joints that nothing drives alone, where they leave the driven ones free; between them the joints
are a C2 spline again. What the motion takes, and how fast it moves frames, is measured on its samples, and it is slowed
down by the factor that is missing.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import ArrayLike, NDArray

from workcell.errors import InputError
from workcell.model.mechanism.following import CLOSED, close, given_joints, given_rates
from workcell.model.mechanism.mechanism import Mechanism
from workcell.model.mechanism.placing import place
from workcell.motion.mechanisms.path import MechanismMotion, MechanismPath
from workcell.motion.timing.phase_plane import PhaseRows, Timing, fastest_squared_speed, phase_grid
from workcell.motion.timing.spline import SMALLEST, JointSpline, spline_inside
from workcell.pose import Array

if TYPE_CHECKING:
    from scipy.interpolate import CubicSpline

Share = Callable[[MechanismMotion], float]
"""The largest share of what its motors can give that a motion takes."""

_KNOT = 0.015
"""By how much numbers of a configuration change from one place at which the ties are closed to the next."""
_GRID = 300
_SUPPORT = 0.02
"""Radians or metres from a sharp corner to the first of the points that hold the motion on straight lines."""
_TWIN = 1e-6
"""Waypoints whose motors differ by less are one."""
_ROUNDS, _ROOM = 8, 1.002
"""Rounds of slowing down, and by how much more than is missing."""


@dataclass(frozen=True, slots=True)
class MotionLimits:
    """What a motion must keep.

    Attributes:
        velocity, acceleration: (motors,) or one number, of the joints that motors move.
        frame_speed: by frame the largest speed of its origin, metres a second.
    """

    velocity: ArrayLike
    acceleration: ArrayLike
    frame_speed: Mapping[str, float]


def time_mechanism(
    path: MechanismPath,
    limits: MotionLimits,
    dt: float,
    *,
    share: Share | None = None,
    smoothing_s: float = 0.08,
) -> MechanismMotion:
    """Time a way.

    Args:
        path: waypoints; the motion passes through each of them.
        limits: on motors and frames.
        dt: seconds between samples.
        share: what the motion takes of its motors' forces; None: no bound on these.
        smoothing_s: width of the moving average over the path parameter.

    Raises:
        InputError: limits that are not positive and finite, a way on which no motor moves, or on which the ties can't
            be closed between two waypoints, or a motion that motors can't make however slow it is.
    """
    way = _Way.of(path)
    velocity, acceleration = _checked(path.mechanism, limits)
    timing, curve = _fastest(way, velocity, acceleration, limits.frame_speed, smoothing_s), way.curve()
    slower = _ROOM
    for _ in range(_ROUNDS):
        motion = _sampled(way.mechanism, curve, timing, slower, dt)
        excess = _excess(motion, way.motors, velocity, acceleration, limits.frame_speed)
        if share is not None:
            excess = max(excess, float(np.sqrt(min(share(motion), 16.0))))
        if excess <= 1.0:
            return motion
        slower *= _ROOM * excess
    raise InputError(
        f"the motors of {path.mechanism.name} can't make this motion, however slow it is",
        where="path",
        remedy="stronger motors, or a lighter load",
    )


@dataclass(frozen=True, slots=True)
class _Way:
    """A spline through waypoints (k, size), quaternions and all, and which numbers of a tangent stay on it."""

    mechanism: Mechanism
    motors: tuple[int, ...]
    spline: JointSpline
    given: NDArray[np.bool_]

    @staticmethod
    def of(path: MechanismPath) -> _Way:
        mechanism, motors = path.mechanism, given_joints(path.mechanism)
        rows = np.array(path.configurations)
        _align(mechanism, rows)
        kept = [rows[0]]
        for q in rows[1:]:
            if np.abs(q - kept[-1]).max() > _TWIN:
                kept.append(q)
        if len(kept) < 2:
            raise InputError("nothing moves on this way", where="path")
        spline = spline_inside(np.array(kept), *_ranges(mechanism), _SUPPORT)
        way = _Way(mechanism, motors, spline, given_rates(mechanism))
        halves = way.spline.derivatives(way.spline.knots[:-1] + 0.5 * np.diff(way.spline.knots))[0]
        if all(not close(mechanism, _united(mechanism, half[None])[0]).yielded for half in halves):
            return way
        return replace(way, given=np.zeros(mechanism.dof, dtype=bool))

    def columns(self, rows: Array) -> Array:
        """(..., motors) the motors' numbers of configurations (..., size) on the spline, or their derivatives."""
        values: Array = rows[..., [self.mechanism.value_slices[k].start for k in self.motors]]
        return values

    def closed(self, s: float, guess: Array) -> Array:
        """The configuration (size,) near one at a place of the spline, its ties closed."""
        found = close(self.mechanism, guess, self.given)
        if found.missed > CLOSED:
            share = s / self.spline.length
            raise InputError(
                f"at {share:.0%} of the way the ties can't be closed: {1e3 * found.missed:.3g} mm are missing",
                where="path",
                remedy="waypoints nearer to each other",
            )
        return found.q

    def curve(self) -> CubicSpline:
        """A C2 spline (size,) over the same parameter in whose knots, close to each other, the ties hold."""
        from scipy.interpolate import CubicSpline

        changes = np.abs(np.diff(self.spline.points, axis=0)).max(axis=1)
        counts = np.maximum(np.ceil(changes / _KNOT).astype(int), 2)
        parts = [
            np.linspace(a, b, count, endpoint=False)
            for a, b, count in zip(self.spline.knots[:-1], self.spline.knots[1:], counts, strict=True)
        ]
        s = np.concatenate([*parts, self.spline.knots[-1:]])
        guesses = _united(self.mechanism, self.spline.derivatives(s)[0])
        knots = np.array([self.closed(float(a), b) for a, b in zip(s, guesses, strict=True)])
        _align(self.mechanism, knots)
        return CubicSpline(s, knots)


def _ranges(mechanism: Mechanism) -> tuple[Array, Array, list[str]]:
    """(size,) limits of hinges and slides, none of others, and whose every number is."""
    lower, upper, names = np.full(mechanism.size, -np.inf), np.full(mechanism.size, np.inf), []
    for joint, at in zip(mechanism.joints, mechanism.value_slices, strict=True):
        names += [joint.name] * (at.stop - at.start)
        if joint.kind in ("hinge", "slide"):
            lower[at], upper[at] = joint.lower, joint.upper
    return lower, upper, names


def _sampled(
    mechanism: Mechanism, curve: CubicSpline, timing: Timing, slower: float, dt: float
) -> MechanismMotion:
    """The motion slowed down by a factor, its duration a multiple of `dt`."""
    steps = max(int(np.ceil(timing.duration * slower / dt - 1e-9)), 2)
    time: Array = dt * np.arange(steps + 1, dtype=float)
    s = np.clip(timing.at(time * (timing.duration / (steps * dt)))[0], curve.x[0], curve.x[-1])
    return MechanismMotion(mechanism, time, _united(mechanism, curve(s)))


def _checked(mechanism: Mechanism, limits: MotionLimits) -> tuple[Array, Array]:
    """(motors,) each."""
    motors, found = given_joints(mechanism), []
    for name in ("velocity", "acceleration"):
        values = np.asarray(getattr(limits, name), dtype=float)
        if values.shape not in ((), (len(motors),)):
            raise InputError(
                f"{name} limits of shape {values.shape}", where=name, remedy=f"one, or {len(motors)}"
            )
        values = np.broadcast_to(values, (len(motors),))
        bad = ~(np.isfinite(values) & (values > 0))
        if bad.any():
            joint = mechanism.joints[motors[int(np.argmax(bad))]].name
            raise InputError(
                f"the {name} limit of {joint} is {values[int(np.argmax(bad))]}",
                where=name,
                remedy=f'a positive number, or <custom><numeric name="{joint}:{name}" data="..."/></custom>',
            )
        found.append(np.array(values))
    for frame, speed in limits.frame_speed.items():
        mechanism.frame(frame)
        if not speed > 0:
            raise InputError(f"the speed limit of {frame!r} is {speed}", where="frame_speed")
    return found[0], found[1]


def _fastest(
    way: _Way, velocity: Array, acceleration: Array, frame_speed: Mapping[str, float], window: float
) -> Timing:
    s = phase_grid(way.spline, _GRID)
    first, second = (way.columns(rows) for rows in way.spline.derivatives(s)[1:])
    cap = np.min((velocity / np.maximum(np.abs(first), SMALLEST)) ** 2, axis=1)
    for frame, speed in frame_speed.items():
        points = _places(way.mechanism, _united(way.mechanism, way.spline.points.copy()), frame)
        rate = np.linalg.norm(np.diff(points, axis=0), axis=1) / np.diff(way.spline.knots)
        k = np.clip(np.searchsorted(way.spline.knots, s, side="right") - 1, 0, len(rate) - 1)
        cap = np.minimum(cap, (speed / np.maximum(rate[k], SMALLEST)) ** 2)
    high = np.broadcast_to(acceleration, first.shape)
    return Timing.along(s, fastest_squared_speed(s, PhaseRows(first, second, -high, high), cap), window)


def _excess(
    motion: MechanismMotion,
    motors: tuple[int, ...],
    velocity: Array,
    acceleration: Array,
    frame_speed: Mapping[str, float],
) -> float:
    """The factor by which a motion must be slower to keep the limits."""
    mechanism = motion.mechanism
    columns = np.flatnonzero(given_rates(mechanism))
    assert len(columns) == len(motors)
    rates, bends = motion.rates()
    excess = float((np.abs(rates[:, columns]) / velocity).max())
    excess = max(excess, float(np.sqrt((np.abs(bends[:, columns]) / acceleration).max())))
    stride = max(len(motion) // 300, 1)
    for frame, speed in frame_speed.items():
        points = _places(mechanism, motion.q[::stride], frame)
        fastest = np.linalg.norm(np.diff(points, axis=0), axis=1).max() / (stride * motion.dt)
        excess = max(excess, float(fastest) / speed)
    return excess


def _places(mechanism: Mechanism, configurations: Array, frame: str) -> Array:
    """(k, 3) where a frame's origin is."""
    which = mechanism.frame(frame)
    return np.array(
        [place(mechanism, q).point(which.link, which.T_link_frame.position) for q in configurations]
    )


def _align(mechanism: Mechanism, q: Array) -> None:
    """Give neighbouring quaternions of balls and floating bodies the same sign, so that they can be interpolated."""
    for joint, at in zip(mechanism.joints, mechanism.value_slices, strict=True):
        if joint.kind in ("ball", "free"):
            quats = q[:, at.stop - 4 : at.stop]
            flips = np.cumprod(np.where((quats[1:] * quats[:-1]).sum(axis=1) < 0, -1.0, 1.0))
            quats[1:] *= flips[:, None]


def _united(mechanism: Mechanism, q: Array) -> Array:
    """Configurations (T, size) with their quaternions made units."""
    for joint, at in zip(mechanism.joints, mechanism.value_slices, strict=True):
        if joint.kind in ("ball", "free"):
            q[:, at.stop - 4 : at.stop] /= np.linalg.norm(q[:, at.stop - 4 : at.stop], axis=1, keepdims=True)
    return q
