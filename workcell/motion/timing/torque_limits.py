"""Limits of joint torques, as bounds on the speed and acceleration along a path."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Protocol

import numpy as np
from numpy.typing import ArrayLike

from workcell.errors import InputError
from workcell.model.robot import Robot
from workcell.pose import Array


class Dynamics(Protocol):
    """What a limit on torques asks of a robot's dynamics, or of several robots' side by side."""

    @property
    def kinematics(self) -> Robot:
        """Whose joints they are."""

    def at(self, q: Array, qd: Array, qdd: Array) -> Array:
        """(T, n) torques for rows of positions, velocities and accelerations (T, n) each."""

    def rigid(self, q: Array, qd: Array, qdd: Array) -> Array:
        """(T, n) the same without what resists motion: linear in the acceleration, quadratic in the velocity."""

    def viscous(self, q: Array, qd: Array) -> Array:
        """(T, n) torques against what resists more the faster the motion is: damping, drag."""

    def dry(self, q: Array, qd: Array) -> Array:
        """(T, n) torques against dry friction, in the directions of the velocities, however small; 0 at rest."""


class TooWeakError(InputError):
    """A joint's torque does not suffice to hold the arm, and what it carries, or to move it, somewhere on a path."""


@dataclass(frozen=True, slots=True)
class TorqueLimits:
    """Largest absolute joint torques, as bounds on the speed and acceleration along a path.

    Attributes:
        dynamics: of the robot and what it carries, or of several that share a load.
        effort: (n,) newton metres (newtons), positive; inf where unknown.
    """

    dynamics: Dynamics
    effort: Array

    @staticmethod
    def of(dynamics: Dynamics, effort: ArrayLike | None = None) -> TorqueLimits:
        """The given limits (a number, or one for each joint), or the robot's own.

        Raises:
            InputError: a limit that is zero, negative or NaN.
        """
        robot = dynamics.kinematics
        values = np.broadcast_to(np.asarray(robot.effort if effort is None else effort, float), (robot.dof,))
        bad = np.isnan(values) | (values <= 0)
        if np.any(bad):
            joint = int(np.argmax(bad))
            raise InputError(
                f"the effort limit of {robot.joint_names[joint]} is {values[joint]}",
                where="effort",
                remedy="pass positive limits: one number, or one for each joint",
            )
        return TorqueLimits(dynamics, np.array(values))

    def along(self, q: Array, first: Array, second: Array, cap: Array) -> tuple[Array, Array, Array, Array]:
        """Rows `low <= a sdd + b sd^2 <= high` (g, m), for joints with a limit, at q, dq/ds and d2q/ds2.

        What it takes to hold still, and to overcome dry friction and damping at the largest speed (its square is
        `cap`), is taken off the limits on both sides: friction brakes a motion only while it is fast.

        Raises:
            TooWeakError: a joint can't hold the arm still somewhere, or can't move it.
        """
        zero = np.zeros_like(q)
        still, dry = self._least(q, first)
        damped = np.abs(self.dynamics.viscous(q, first * np.sqrt(np.minimum(cap, 1e12))[:, None]))
        a = self.dynamics.rigid(q, zero, first) - still
        b = self.dynamics.rigid(q, first, second) - still
        hold = np.abs(still)
        room = np.maximum(self.effort - hold - damped - np.abs(dry), 1e-3 * (self.effort - hold))
        high = np.where(still >= 0, room, room + 2 * hold)
        low = np.where(still >= 0, -room - 2 * hold, -room)
        limited = np.isfinite(self.effort)
        return a[:, limited], b[:, limited], low[:, limited], high[:, limited]

    def share(self, q: Array, qd: Array, qdd: Array) -> Array:
        """(T,) the largest share, over the joints, of the torque that moving very slowly leaves for moving faster."""
        still, dry = self._least(q, qd)
        least = still + dry
        moving = self.dynamics.at(q, qd, qdd) - least
        left = np.where(moving >= 0, self.effort - least, self.effort + least)
        shares: Array = np.where(np.isfinite(self.effort), np.abs(moving) / left, 0.0).max(axis=1)
        return shares

    def _least(self, q: Array, direction: Array) -> tuple[Array, Array]:
        """(T, n) each: torques that hold still, and those against dry friction; raises TooWeakError."""
        zero = np.zeros_like(q)
        still, dry = self.dynamics.rigid(q, zero, zero), self.dynamics.dry(q, direction)
        for torques, what in ((still, "hold still on"), (still + dry, "move against dry friction along")):
            over = np.abs(torques) >= self.effort
            if np.any(over):
                row, joint = (int(i) for i in np.argwhere(over)[0])
                robot = self.dynamics.kinematics
                raise TooWeakError(
                    f"joint {robot.joint_names[joint]} needs {abs(torques[row, joint]):.1f} N m to {what} the path, "
                    f"and has {self.effort[joint]:.1f}",
                    where="path",
                    remedy="carry less, or keep the load closer to the base",
                )
        return still, dry
