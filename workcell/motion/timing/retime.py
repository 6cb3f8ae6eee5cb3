"""Timing of a path: smooth motion, at rest at both ends, within limits on velocity, acceleration and torque.

Three steps. A C2 cubic spline through the waypoints over their joint-space chord length s
(`workcell.motion.timing.spline`). The fastest s(t) under the limits (`workcell.motion.timing.phase_plane`). A moving
average of s(t), which keeps the geometry and makes the acceleration continuous. Limits are then verified on a dense
evaluation, and on the quintics that join the samples, and the whole motion is slowed down by the small factor that is
missing.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import ArrayLike

from workcell.errors import InputError
from workcell.model.robot import Robot
from workcell.motion.path import Path, Trajectory
from workcell.motion.polynomials import PolynomialMotion
from workcell.motion.timing.phase_plane import PhaseRows, Timing, fastest_squared_speed, phase_grid
from workcell.motion.timing.spline import SMALLEST, JointSpline, spline_within_limits
from workcell.motion.timing.torque_limits import Dynamics, TorqueLimits
from workcell.pose import Array

_DENSE = 5
"""Evaluations a time step when limits are verified."""
_SLOWING = 40
"""Rounds of slowing down, of which one or two are needed; dry friction that turns as a motion ends may take more."""
_HEADROOM = 1.0005
"""Left for what lies between two dense evaluations."""
_ROUNDS, _CLOSE = 6, 1.02
"""Rounds in which places that exceed a limit after averaging get less of it, and the excess that ends them."""
_PARTS = 4
"""Parts of each time step on which the quintics between samples are bounded."""
_DAMPING_PASSES, _FASTER = 3, 1.2
"""Passes that look for the speeds at which damping acts, and the factor on squared speeds from one to the next."""


def retime(
    path: Path,
    velocity: ArrayLike | None = None,
    acceleration: ArrayLike | None = None,
    *,
    tool_speed: float | None = None,
    dynamics: Dynamics | None = None,
    effort: ArrayLike | None = None,
    dt: float = 0.002,
    smoothing_s: float = 0.06,
    support: float = 0.02,
    grid: int = 400,
) -> Trajectory:
    """Time a path: C2, at rest at both ends, within the limits, sampled every `dt` seconds.

    Args:
        path: waypoints; the motion passes through each of them (by a hair inside, at a joint limit), but for those
            within 1e-3 rad of the one before (1e-4 where the path is one of the tool): they count as that one.
        velocity, acceleration: (n,) or scalar largest absolute values; None: the robot's own.
        tool_speed: largest speed of the tool, metres a second; None: no bound.
        dynamics: of the robot (or the robots of a team) and what it carries: joint torques keep their limits as well;
            None: no bound on torques.
        effort: (n,) or scalar largest absolute torques; None: the robot's own.
        dt: seconds between samples.
        smoothing_s: width of the moving average over s(t); the acceleration changes over this time.
        support: joint-space distance (radians) from a sharp corner to the first of the extra spline points that hold
            the motion on the straight lines; inf leaves them out.
        grid: intervals of the phase plane.

    Raises:
        InputError: a limit that is zero, negative, NaN or (for the acceleration) infinite; a time step, width,
            distance or number of intervals that is not positive; a path that does not move, or that runs so close to
            a joint limit that no smooth motion through it keeps the limit.
        TooWeakError: torques don't suffice to hold the arm (and what it carries) still somewhere on the path.
    """
    robot = path.robot
    v_max, a_max = motion_limits(robot, velocity, acceleration)
    if tool_speed is not None and not tool_speed > 0:
        raise InputError(
            f"the tool's speed limit is {tool_speed}", where="tool_speed", remedy="a positive number"
        )
    for name, value in (("dt", dt), ("smoothing_s", smoothing_s), ("support", support), ("grid", grid)):
        if not value > 0 or (name != "support" and not np.isfinite(value)):
            raise InputError(f"{name} is {value}", where=name, remedy="a positive number")
    spline = spline_within_limits(path, support)
    torques = None if dynamics is None else TorqueLimits.of(dynamics, effort)
    bounds = _Bounds(robot, spline, v_max, a_max, tool_speed, torques)
    timing = _timing(bounds, smoothing_s, dt, grid)
    slower = _HEADROOM * _slowdown(bounds, timing, dt)
    trajectory = _sampled(spline, timing, slower, dt, robot.name)
    while (excess := _excess_between_samples(trajectory, v_max, a_max)) > 1.0:
        # by the factor that is missing, and by one more sample at least
        slower = max(excess * trajectory.duration, trajectory.duration + dt) / timing.duration
        trajectory = _sampled(spline, timing, slower, dt, robot.name)
    return replace(trajectory, base=robot.T_world_base)


def _sampled(spline: JointSpline, timing: Timing, slower: float, dt: float, name: str) -> Trajectory:
    """The motion slowed down by a factor, or by as much more as makes its duration a multiple of `dt`."""
    steps = int(np.ceil(timing.duration * slower / dt - 1e-9))
    slower = steps * dt / timing.duration
    time: Array = dt * np.arange(steps + 1, dtype=float)
    s, sd, sdd = timing.at(time / slower)
    q, qd, qdd = spline.motion(s, sd / slower, sdd / slower**2)
    return Trajectory(name, time, q, qd, qdd)


def _excess_between_samples(trajectory: Trajectory, v_max: Array, a_max: Array) -> float:
    """The slowdown that a trajectory still needs, by bounds on the quintics between its samples."""
    motion = PolynomialMotion.of_trajectory(trajectory).divided(_PARTS)
    velocity = float((motion.largest(1).max(axis=0) / v_max).max())
    acceleration = float((motion.largest(2).max(axis=0) / a_max).max())
    return max(velocity, float(np.sqrt(acceleration)))


@dataclass(frozen=True, slots=True)
class _Bounds:
    """What a motion along a spline must keep."""

    robot: Robot
    spline: JointSpline
    v_max: Array
    a_max: Array
    tool_speed: float | None
    torques: TorqueLimits | None

    def rows(self, s: Array, cap: Array) -> PhaseRows:
        """Accelerations and torques at path positions s (g,), where sd^2 stays below `cap`."""
        q, first, second = self.spline.derivatives(s)
        high = np.broadcast_to(self.a_max, first.shape)
        rows = PhaseRows(first, second, -high, high)
        if self.torques is None:
            return rows
        return rows.with_rows(PhaseRows(*self.torques.along(q, first, second, cap)))

    def use(self, q: Array, qd: Array, qdd: Array) -> Array:
        """(T,) the largest share of an acceleration limit, or of the torque that holding still leaves."""
        use: Array = (np.abs(qdd) / self.a_max).max(axis=1)
        return use if self.torques is None else np.maximum(use, self.torques.share(q, qd, qdd))


def _timing(bounds: _Bounds, smoothing_s: float, dt: float, grid: int) -> Timing:
    """The fastest s(t), smoothed; where smoothing makes it exceed a limit, the search is repeated with less of it."""
    s = phase_grid(bounds.spline, grid)
    q, first, _ = bounds.spline.derivatives(s)
    cap = _speed_cap(bounds.robot, q, first, bounds.v_max, bounds.tool_speed)
    expected = cap
    if bounds.torques is not None:
        # damping is taken off the torques at the speed that the motion really has, found in a few passes
        for _ in range(_DAMPING_PASSES):
            x = fastest_squared_speed(s, bounds.rows(s, expected), cap)
            expected = np.minimum(cap, _FASTER * x)
    rows, share = bounds.rows(s, expected), np.ones(len(s))
    for _ in range(_ROUNDS):
        x = fastest_squared_speed(s, rows.scaled(share), cap)
        timing = Timing.along(s, x, smoothing_s)
        excess = _excess(bounds, timing, dt)
        if excess.max() <= _CLOSE:
            break
        share /= excess
    return timing


def _speed_cap(robot: Robot, q: Array, first: Array, v_max: Array, tool_speed: float | None) -> Array:
    """The largest sd^2 at each grid point under the joints' and the tool's speed limits."""
    cap: Array = np.min((v_max / np.maximum(np.abs(first), SMALLEST)) ** 2, axis=1)
    if tool_speed is not None:
        cap = np.minimum(cap, (tool_speed / np.maximum(_tool_speed(robot, q, first), SMALLEST)) ** 2)
    return cap


def _tool_speed(robot: Robot, q: Array, qd: Array) -> Array:
    speed: Array = np.linalg.norm(np.einsum("tij,tj->ti", robot.jacobian(q)[:, :3], qd), axis=1)
    return speed


def _excess(bounds: _Bounds, timing: Timing, dt: float) -> Array:
    """By what factor, at least 1, the averaged motion exceeds an acceleration or torque limit near each grid point."""
    use = bounds.use(*bounds.spline.motion(*timing.sample(dt)))
    time = np.linspace(0.0, timing.duration, len(use))
    first = np.searchsorted(time, timing.time - dt)
    last = np.searchsorted(time, timing.time + timing.window + dt)
    worst = [use[i : max(j, i + 1)].max() for i, j in zip(first, last, strict=True)]
    excess: Array = np.maximum(np.array(worst), 1.0)
    return excess


def _slowdown(bounds: _Bounds, timing: Timing, dt: float) -> float:
    """The factor by which a motion must be slowed down, so that no limit is exceeded at any of its samples."""
    s, sd, sdd = timing.sample(dt / _DENSE)
    q, qd, _ = bounds.spline.motion(s, sd, sdd)
    factor = max(1.0, float((np.abs(qd) / bounds.v_max).max()))
    if bounds.tool_speed is not None:
        factor = max(
            factor, float(_tool_speed(bounds.robot, q[::_DENSE], qd[::_DENSE]).max()) / bounds.tool_speed
        )
    # accelerations fall with the square; torques against viscous damping fall more slowly, hence the rounds
    for _ in range(_SLOWING):
        worst = float(bounds.use(*bounds.spline.motion(s, sd / factor, sdd / factor**2)).max())
        if worst <= 1.0:
            break
        factor *= float(np.sqrt(worst)) * (1.0 + 1e-9)
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
        values = np.asarray(own if given is None else given, dtype=float)
        if values.shape not in ((), (robot.dof,)):
            raise InputError(
                f"{name} limits of shape {values.shape}", where=name, remedy=f"one, or {robot.dof} of them"
            )
        values = np.broadcast_to(values, (robot.dof,))
        bad = np.isnan(values) | (values <= 0)
        if name == "acceleration":
            bad |= np.isinf(values)
        if np.any(bad):
            joint = int(np.argmax(bad))
            raise InputError(
                f"the {name} limit of {robot.joint_names[joint]} is {values[joint]}",
                where=name,
                remedy=f"pass {name}=, one positive number or one for each joint, or give the robot's MJCF file "
                f'<custom><numeric name="{robot.joint_names[joint]}:{name}" data="..."/></custom>',
            )
        limits.append(np.array(values))
    return limits[0], limits[1]
