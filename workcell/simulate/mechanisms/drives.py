"""How a mechanism's motors are driven: inverse dynamics along the reference, and feedback.

Motors get the forces that make the reference's accelerations, and those of a damped spring for what is missing of it:

    M (a_ref + T (kd de + kp e)) + bias - passive = A^T f + J^T l

with e what the joints that motors move are away from the reference, and T how all joints move with these. A position or
velocity servo brings its own spring and damper: its control value is such that it gives f where the reference is.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from workcell.model.mechanism.following import given_rates
from workcell.model.mechanism.placing import difference
from workcell.model.scene_mechanism import SceneMechanism
from workcell.motion.mechanisms.forces import MotorForces
from workcell.pose import Array
from workcell.simulate.controller import Gains

if TYPE_CHECKING:
    import mujoco

_RANK = 1e-9
"""Singular values below this share of the largest are zero."""


@dataclass(frozen=True, slots=True)
class Wanted:
    """Where a mechanism should be at a control step: configuration (size,), velocity and acceleration (dof,)."""

    q: Array
    velocity: Array
    acceleration: Array


class Drives:
    """The motors of one mechanism.

    Args:
        moving: the mechanism in its scene.
        model: the simulated model.
        gains: of the feedback of motors that are no servos; None: `Gains()`.

    Attributes:
        reference: MuJoCo's data where the mechanism should be now: bodies, sites and lengths of actuators.

    Raises:
        ModelError: as `MotorForces`.
    """

    def __init__(self, moving: SceneMechanism, model: mujoco.MjModel, gains: Gains | None) -> None:
        self._mechanism, self._compiled = moving.mechanism, moving.compiled
        self._gains = gains or Gains()
        self._forces = MotorForces(moving.mechanism)
        self.reference = self._forces.data
        ids = self._forces.actuators
        self._gain = np.array(model.actuator_gainprm[ids, 0])
        self._bias, self._spring, self._damper = np.array(model.actuator_biasprm[ids, :3]).T
        low, high = np.array(model.actuator_ctrlrange[ids]).T
        limited = np.array(model.actuator_ctrllimited[ids], dtype=bool)
        self._low, self._high = np.where(limited, low, -np.inf), np.where(limited, high, np.inf)
        self._given = given_rates(moving.mechanism)
        self._feeds_back = bool(np.any((self._spring == 0.0) & (self._damper == 0.0)))

    @property
    def dofs(self) -> NDArray[np.int64]:
        """(dof,) where each number of a tangent is in raw velocities."""
        return self._forces.dofs

    def command(
        self, data: mujoco.MjData, wanted: Wanted, pressing: dict[int, tuple[Array, Array]]
    ) -> tuple[NDArray[np.int64], Array, bool]:
        """Ids of the actuators, their control values, and whether any was cut off at its limits.

        Args:
            data: the simulated state.
            wanted: where the mechanism should be.
            pressing: forces on something, see `MotorForces.at`.
        """
        forces = self._forces
        qpos, qvel = np.array(data.qpos), np.array(data.qvel)
        qpos[self._compiled.addresses] = wanted.q
        qvel[forces.dofs] = wanted.velocity
        acceleration = wanted.acceleration
        if self._feeds_back:
            acceleration = acceleration + self._along(self._pull(data, wanted))
        needed = forces.at(qpos, qvel, acceleration, pressing).forces
        ids, ahead = forces.actuators, self.reference
        held = self._bias + self._spring * ahead.actuator_length[ids]
        held += self._damper * ahead.actuator_velocity[ids]
        control = (needed - held) / self._gain
        cut = np.clip(control, self._low, self._high)
        beyond = np.any(cut != control) or np.any((needed < forces.low) | (needed > forces.high))
        return ids, cut, bool(beyond)

    def _pull(self, data: mujoco.MjData, wanted: Wanted) -> Array:
        """(dof,) accelerations of a damped spring on the joints that motors move, zero on the others."""
        error = difference(self._mechanism, self._compiled.configuration(data.qpos), wanted.q)
        rate = wanted.velocity - data.qvel[self._forces.dofs]
        return np.where(self._given, self._gains.kp * error + self._gains.kd * rate, 0.0)

    def _along(self, pull: Array) -> Array:
        """An acceleration (dof,) of what motors move, and of all joints that move with it by the ties."""
        ties, free = self._forces.ties(), ~self._given
        if not ties.size or not free.any():
            return pull
        full = np.array(pull)
        full[free] = -np.linalg.lstsq(ties[:, free], ties[:, self._given] @ pull[self._given], rcond=_RANK)[0]
        return full
