"""The fastest motion from rest to rest between two configurations, with bounded jerk: PTP, as controllers say.

Ruckig (Berscheid and Kroeger, "Jerk-limited Real-time Trajectory Generation with Arbitrary Target States", RSS 2021)
times each joint; it is an extra, `pip install workcell[timing]`. Joints that share one s(t) move on a straight line
in joint space, so that a proof of the line holds for the motion.
"""

from __future__ import annotations

import importlib
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from workcell.errors import InputError, WorkcellError
from workcell.model.robot import Robot
from workcell.motion.path import Trajectory
from workcell.motion.timing.retime import motion_limits
from workcell.pose import Array


def point_to_point(
    robot: Robot,
    q_start: ArrayLike,
    q_goal: ArrayLike,
    *,
    velocity: ArrayLike | None = None,
    acceleration: ArrayLike | None = None,
    jerk: ArrayLike = 100.0,
    straight: bool = True,
    dt: float = 0.002,
) -> Trajectory:
    """The fastest jerk-limited motion from rest at `q_start` (n,) to rest at `q_goal` (n,), a sample every `dt` s.

    Args:
        velocity, acceleration: (n,) or scalar largest absolute values; None: the robot's own.
        jerk: (n,) or scalar, radians a second cubed.
        straight: all joints in phase, on a straight line in joint space; False: each joint as it likes, with the same
            duration at the end.
        dt: seconds between samples; the duration is the next multiple of it.

    Raises:
        InputError: configurations outside the limits or equal, a limit that is zero, negative or not finite.
        WorkcellError: Ruckig is not installed.
    """
    start = robot.configuration(q_start, where="q_start")  # type: ignore[arg-type]
    goal = robot.configuration(q_goal, where="q_goal")  # type: ignore[arg-type]
    robot.check_limits(start, where="q_start")
    robot.check_limits(goal, where="q_goal")
    if np.array_equal(start, goal):
        raise InputError("start and goal are the same", where="q_goal")
    v_max, a_max = motion_limits(robot, velocity, acceleration)
    j_max = np.asarray(jerk, dtype=float)
    if j_max.shape not in ((), (robot.dof,)):
        raise InputError(
            f"jerk limits of shape {j_max.shape}", where="jerk", remedy=f"one, or {robot.dof} of them"
        )
    j_max = np.broadcast_to(j_max, (robot.dof,))
    if not (np.all(np.isfinite(j_max)) and np.all(j_max > 0)):
        raise InputError(f"the jerk limits are {j_max.tolist()}", where="jerk", remedy="positive, finite")
    if not (np.isfinite(dt) and dt > 0):
        raise InputError(f"a time step of {dt} s makes no sense", where="dt")
    if straight:
        # one s from 0 to 1, with the limits that the joint which is shortest of each leaves
        step = np.abs(goal - start)
        moving = step > 0
        v_s, a_s, j_s = (
            np.min(limit[moving] / step[moving], keepdims=True) for limit in (v_max, a_max, j_max)
        )
        s, sd, sdd = _profile(np.zeros(1), np.ones(1), v_s, a_s, j_s, dt)
        delta = goal - start
        q, qd, qdd = start + s * delta, sd * delta, sdd * delta
    else:
        q, qd, qdd = _profile(start, goal, v_max, a_max, np.array(j_max), dt)
    return Trajectory(robot.name, dt * np.arange(len(q), dtype=float), q, qd, qdd)


def _profile(
    start: Array, goal: Array, v_max: Array, a_max: Array, j_max: Array, dt: float
) -> tuple[Array, Array, Array]:
    """Samples (T, n) of position, velocity and acceleration."""
    ruckig = _ruckig()
    n = len(start)
    question = ruckig.InputParameter(n)
    question.current_position, question.target_position = start.tolist(), goal.tolist()
    question.current_velocity = question.current_acceleration = [0.0] * n
    question.target_velocity = question.target_acceleration = [0.0] * n
    question.max_velocity, question.max_acceleration = v_max.tolist(), a_max.tolist()
    question.max_jerk = j_max.tolist()
    answer = ruckig.Trajectory(n)
    result = ruckig.Ruckig(n, dt).calculate(question, answer)
    if result != ruckig.Result.Working:
        raise WorkcellError(f"Ruckig found no motion: {result}", where="point_to_point")
    steps = max(int(np.ceil(answer.duration / dt - 1e-9)), 2)
    slower = steps * dt / answer.duration
    rows = [answer.at_time(min(k * dt / slower, answer.duration)) for k in range(steps + 1)]
    q, qd, qdd = (np.array([row[part] for row in rows]).reshape(steps + 1, n) for part in range(3))
    q[0], q[-1] = start, goal
    qd[[0, -1]] = qdd[[0, -1]] = 0.0
    return q, qd / slower, qdd / slower**2


def _ruckig() -> Any:
    try:
        return importlib.import_module("ruckig")
    except ImportError:
        raise WorkcellError(
            "jerk-limited motions need Ruckig, which is not installed",
            remedy="pip install 'workcell[timing]'",
        ) from None
