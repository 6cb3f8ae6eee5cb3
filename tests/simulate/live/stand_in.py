"""A stand-in for live inverse kinematics: one arm, damped least squares, velocities that change slowly."""

from __future__ import annotations

import numpy as np

from workcell.motion.live.goals import LiveGoal
from workcell.motion.live.limits import LiveLimits
from workcell.motion.live.step import LiveStatus, Step
from workcell.pose import rotation_vector


class StandIn:
    """Steps of one robot, by name; `script` (frame -> changes of the `Step`) says what else the frames tell."""

    def __init__(self, name, robot, period=0.02, moving=(), speed=1.0, script=None):
        self.names, self.period, self.moving, self.robot = (name,), period, tuple(moving), robot
        n = robot.dof
        self.limits = LiveLimits.of(np.full(n, speed), np.full(n, 10.0))
        self.placed, self.stamps, self.resets, self.script = {}, [], [], script or {}
        self.goals = []
        self.reset(np.zeros(n))
        self.resets.clear()

    def columns(self, name):
        return slice(0, self.robot.dof)

    def reset(self, q):
        self.q, self.qd, self.qdd = np.array(q), np.zeros(self.robot.dof), np.zeros(self.robot.dof)
        self.resets.append(np.array(q))

    def place(self, name, pose, velocity=None, angular_velocity=None):
        self.placed.setdefault(name, []).append((pose, velocity, angular_velocity))

    def step(self, goals, *, stamp=None):
        self.stamps.append(stamp)
        self.goals.append(goals)
        goal = goals.get(self.names[0]) if isinstance(goals, dict) else goals
        pose = goal.pose if isinstance(goal, LiveGoal) else goal
        wanted, status = np.zeros(self.robot.dof), "NO_GOAL"
        if pose is not None:
            wanted, status = 4.0 * self._towards(pose), "MOVING"
        wanted = np.clip(wanted, -self.limits.velocity, self.limits.velocity)
        most, jerk, T = self.limits.acceleration, self.limits.jerk, self.period
        towards = np.clip((wanted - self.qd) / (4 * T), -most, most)
        j = np.clip((towards - self.qdd) / T, -jerk, jerk)
        self.q = self.q + T * (self.qd + T * (self.qdd / 2 + T * j / 6))
        self.qd, self.qdd = self.qd + T * (self.qdd + T * j / 2), self.qdd + T * j
        errors = self.robot.fk(self.q).error_to(pose) if pose is not None else (0.0, 0.0)
        values = {
            "q": self.q,
            "qd": self.qd,
            "status": status,
            "reason": "",
            "position_error": np.array(errors[:1]),
            "rotation_error": np.array(errors[1:]),
            "terms": np.arange(7.0),
            "guards": (),
            "clearance": 0.1,
            "conditioning": np.array([0.2]),
            "braked": False,
            "timed_out": False,
            "seconds": 1e-4,
        }
        values |= self.script.get(len(self.stamps) - 1, {})
        values["status"] = LiveStatus[values["status"]]
        self.q = values["q"]
        return Step(**values)

    def _towards(self, pose):
        J = self.robot.jacobian(self.q)
        T = self.robot.fk(self.q)
        error = np.concatenate([pose.position - T.position, rotation_vector(pose.rotation @ T.rotation.T)])
        return J.T @ np.linalg.solve(J @ J.T + 1e-3 * np.eye(6), error)
