"""Computed torque: the robot's own dynamics cancel, what remains of the error decays like a damped spring.

    tau = inverse_dynamics(q, qd, qdd_ref + kd (qd_ref - qd) + kp (q_ref - q))

The inverse dynamics are MuJoCo's (`mj_inverse`), on a copy of the model without contacts and equalities, since those
forces would be counted into the torque otherwise. A carried object enters as part of the hand: the copy's hand gets the
combined mass, centre of mass and inertia.
"""

from __future__ import annotations

import copy
from collections.abc import Iterable
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from workcell.errors import InputError, ModelError
from workcell.model.scene import SceneRobot
from workcell.motion.path import Trajectory
from workcell.pose import Array, matrix_to_quat

if TYPE_CHECKING:
    import mujoco


@dataclass(frozen=True, slots=True)
class Gains:
    """Feedback of the computed torque: `kp` in 1/s^2 and `kd` in 1/s, the same for every joint."""

    kp: float = 400.0
    kd: float = 40.0

    def __post_init__(self) -> None:
        if not (self.kp > 0 and self.kd > 0):
            raise InputError(f"gains must be positive, not kp {self.kp}, kd {self.kd}", where="gains")


class ComputedTorque:
    """The controller of one robot in a compiled model.

    Args:
        model: the simulated model; it is copied.
        robot: the robot to control; its actuators must be torque motors.
        gains: feedback.

    Raises:
        ModelError: an actuator that is not a plain motor.
    """

    def __init__(self, model: mujoco.MjModel, robot: SceneRobot, gains: Gains | None = None) -> None:
        import mujoco

        self._mj_inverse, self._mj_set_const = mujoco.mj_inverse, mujoco.mj_setConst
        self._plain = model
        self._model = copy.copy(model)
        bits = mujoco.mjtDisableBit
        self._model.opt.disableflags |= bits.mjDSBL_CONTACT | bits.mjDSBL_EQUALITY | bits.mjDSBL_LIMIT
        self._data = mujoco.MjData(self._model)
        self.gains = gains or Gains()
        self._dofs, self._qpos = robot.dof_addresses, robot.qpos_addresses
        self.gear = _motor_gears(model, robot)
        self.effort = np.array(robot.robot.effort)

    def torque(
        self, qpos: Array, qvel: Array, q_ref: Array, qd_ref: Array, qdd_ref: Array
    ) -> tuple[Array, bool]:
        """Joint torques (n,), clamped at the effort limits, and whether any was clamped.

        Args:
            qpos, qvel: raw state of the whole scene.
            q_ref, qd_ref, qdd_ref: (n,) where the joints should be, and how they should move.
        """
        data = self._data
        data.qpos[:], data.qvel[:] = qpos, qvel
        data.qacc[:] = 0.0
        error, error_rate = q_ref - qpos[self._qpos], qd_ref - qvel[self._dofs]
        data.qacc[self._dofs] = qdd_ref + self.gains.kd * error_rate + self.gains.kp * error
        self._mj_inverse(self._model, data)
        wanted = data.qfrc_inverse[self._dofs]
        clamped: Array = np.clip(wanted, -self.effort, self.effort)
        return clamped, bool(np.any(clamped != wanted))

    def carry(self, hand: int, bodies: Iterable[int], data: mujoco.MjData) -> None:
        """Count bodies as rigid parts of the body `hand`, as they are placed in `data` now."""
        R, origin = data.xmat[hand].reshape(3, 3), data.xpos[hand]
        masses, centres, inertias = [], [], []
        for body in (hand, *bodies):
            frame = R.T @ data.ximat[body].reshape(3, 3)
            masses.append(float(self._plain.body_mass[body]))
            centres.append(R.T @ (data.xipos[body] - origin))
            inertias.append(frame @ np.diag(self._plain.body_inertia[body]) @ frame.T)
        mass, centre, inertia = combined_inertia(np.array(masses), np.array(centres), np.array(inertias))
        moments, axes = np.linalg.eigh(inertia)
        axes[:, 2] *= np.linalg.det(axes)
        self._set_inertia(hand, mass, centre, moments, matrix_to_quat(axes))

    def drop(self, hand: int) -> None:
        """The hand is empty again."""
        model = self._plain
        self._set_inertia(
            hand,
            model.body_mass[hand],
            model.body_ipos[hand],
            model.body_inertia[hand],
            model.body_iquat[hand],
        )

    def _set_inertia(self, body: int, mass: float, centre: Array, moments: Array, quat: Array) -> None:
        model = self._model
        model.body_mass[body], model.body_ipos[body] = mass, centre
        model.body_inertia[body], model.body_iquat[body] = moments, quat
        self._mj_set_const(model, self._data)


def discrete_reference(trajectory: Trajectory) -> tuple[Array, Array, Array]:
    """q, qd, qdd (T, n) that MuJoCo's semi-implicit integration reproduces at every sample.

    It steps `qd' = qd + h qdd`, then `q' = q + h qd'`: velocities are backward differences of the positions, and
    accelerations forward differences of those. With the true derivatives instead, the feedback would fight an offset
    of `h qdd / 2` in the velocity.
    """
    q, h = trajectory.q, trajectory.dt
    qd = np.vstack([np.zeros_like(q[:1]), np.diff(q, axis=0) / h])
    qdd = np.vstack([np.diff(qd, axis=0) / h, np.zeros_like(q[:1])])
    return q, qd, qdd


def combined_inertia(masses: Array, centres: Array, inertias: Array) -> tuple[float, Array, Array]:
    """Mass, centre of mass (3,) and inertia about it (3, 3) of rigidly joined bodies.

    Args:
        masses: (k,); centres: (k, 3); inertias: (k, 3, 3) about each body's own centre; all in one frame.
    """
    mass = float(masses.sum())
    centre: Array = masses @ centres / mass
    total = np.zeros((3, 3))
    for m, c, inertia in zip(masses, centres - centre, inertias, strict=True):
        total += inertia + m * (c @ c * np.eye(3) - np.outer(c, c))
    return mass, centre, total


def _motor_gears(model: mujoco.MjModel, robot: SceneRobot) -> Array:
    import mujoco

    for actuator in robot.actuator_ids:
        fixed = model.actuator_gaintype[actuator] == mujoco.mjtGain.mjGAIN_FIXED
        unbiased = model.actuator_biastype[actuator] == mujoco.mjtBias.mjBIAS_NONE
        static = model.actuator_dyntype[actuator] == mujoco.mjtDyn.mjDYN_NONE
        if not (fixed and unbiased and static):
            raise ModelError(
                f"the actuator {model.actuator(actuator).name!r} is not a torque motor",
                remedy="computed torque needs <motor> actuators on the arm's joints",
            )
    ids = robot.actuator_ids
    gears: Array = model.actuator_gear[ids, 0] * model.actuator_gainprm[ids, 0]
    return gears
