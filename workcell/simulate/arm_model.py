"""What a controller knows of an arm: a copy of the compiled model, with the load in its hand, and its errors.

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

from workcell.errors import ModelError
from workcell.model.loading.actuators import actuator_of_joint, is_motor, undriven_because
from workcell.model.scene_parts import SceneRobot
from workcell.pose import Array, matrix_to_quat
from workcell.simulate.imperfections import Imperfections

if TYPE_CHECKING:
    import mujoco


class ArmModel:
    """The dynamics of one robot as its controller believes them to be.

    Args:
        model: the simulated model; it is copied.
        robot: the robot to control; by motors, or by position or velocity servos, which are told what makes a torque.
        imperfections: errors of the believed masses; None: the truth.

    Attributes:
        effort: (n,) largest torques.

    Raises:
        ModelError: an actuator that no torque can be asked of.
    """

    def __init__(
        self, model: mujoco.MjModel, robot: SceneRobot, imperfections: Imperfections | None = None
    ) -> None:
        import mujoco

        self._mujoco = mujoco
        self._imperfections = imperfections or Imperfections()
        self._model = copy.copy(model)
        bits = mujoco.mjtDisableBit
        self._model.opt.disableflags |= bits.mjDSBL_CONTACT | bits.mjDSBL_EQUALITY | bits.mjDSBL_LIMIT
        self._data = mujoco.MjData(self._model)
        self._robot, self._dofs = robot, robot.joint_dof_addresses
        self._drives = _Drives.of(model, robot)
        self.effort = np.array(robot.robot.effort)
        for body, factor in self._imperfections.link_factors(robot.body_ids).items():
            self._model.body_mass[body] *= factor
            self._model.body_inertia[body] *= factor
        self._plain = copy.copy(self._model)
        self._start = self._q = np.array(robot.start)
        self._compensated = model.jnt_actgravcomp[model.dof_jntid[self._dofs]].astype(bool)
        self._lifted: dict[int, list[tuple[Array, Array]]] = {}
        self._rng = np.random.default_rng([self._imperfections.seed, int(self._dofs[0])])

    def inverse(self, qpos: Array, qvel: Array, q: Array, qd: Array, qdd: Array) -> Array:
        """(n,) torques that accelerate the arm by `qdd` at `q`, `qd` (n,), the rest of the scene unaccelerated.

        Args:
            qpos, qvel: raw state of the whole scene; the arm's own part of it is replaced.
            q, qd, qdd: (n,) of the arm.
        """
        data, chain = self._data, self._robot.robot
        data.qpos[:], data.qvel[:], data.qacc[:] = qpos, qvel, 0.0
        self._robot.place(data.qpos, q)
        _, data.qvel[self._dofs], data.qacc[self._dofs] = chain.joint_motion(q, qd, qdd)
        self._q = np.array(q)
        forces = self._forces()
        return chain.variable_forces(self._q, forces[self._dofs] - self._lift())

    def _forces(self) -> Array:
        """(nv,) inverse dynamics of what is in `data`; what passive loops carry is on the joints that move them."""
        data, loops = self._data, self._robot.loops
        if loops is not None:
            loops.move(data.qpos, data.qvel, data.qacc)
        self._mujoco.mj_inverse(self._model, data)
        forces: Array = data.qfrc_inverse
        return forces if loops is None else loops.transmitted(data.qpos, forces)

    def command(self, torque: Array, qpos: Array, qvel: Array) -> Array:
        """(n,) control values for torques where `inverse` was asked last; what they compensate, they do unasked.

        Args:
            torque: (n,) of the joints.
            qpos, qvel: raw state of the whole scene, as the actuators' own sensors have it.
        """
        unasked = np.where(self._compensated, self._data.qfrc_gravcomp[self._dofs], 0.0)
        wanted = torque - self._robot.robot.variable_forces(self._q, unasked)
        own = self._robot.dof_addresses
        return self._drives.controls(
            wanted, qpos[self._robot.qpos_addresses], qvel[own], self._data.qacc[own]
        )

    def _lift(self) -> Array:
        """(m,) torques of the weight that what is carried has compensated, where `inverse` was asked last."""
        lift, jacobian = np.zeros(self._model.nv), np.zeros((3, self._model.nv))
        for hand, forces in self._lifted.items():
            at, R = self._data.xpos[hand], self._data.xmat[hand].reshape(3, 3)
            for centre, force in forces:
                self._mujoco.mj_jac(self._model, self._data, jacobian, None, at + R @ centre, hand)
                lift += jacobian.T @ force
        return lift[self._dofs]

    def inertia_at_start(self, qpos: Array) -> Array:
        """(n, n) joint-space inertia matrix where the arm starts; armature included.

        Args:
            qpos: (nq,) raw positions of the rest of the scene.
        """
        data = self._data
        data.qpos[:] = qpos
        self._robot.place(data.qpos, self._start)
        self._mujoco.mj_forward(self._model, data)
        full = np.zeros((self._model.nv, self._model.nv))
        self._mujoco.mj_fullM(self._model, data, full)
        if self._robot.loops is not None:
            full = self._robot.loops.transmitted(data.qpos, self._robot.loops.transmitted(data.qpos, full).T)
        # what follows hangs on a constraint that gives: in the first moment it is not moved along
        return full[np.ix_(self._robot.dof_addresses, self._robot.dof_addresses)]

    def measured(self, qpos: Array, qvel: Array) -> tuple[Array, Array]:
        """(n,) positions and velocities of the joints as the controller's sensors report them."""
        own = self._robot
        return self._imperfections.sensed(qpos[own.qpos_addresses], qvel[own.dof_addresses], self._rng)

    def clamped(self, torque: Array) -> tuple[Array, bool]:
        """Torques (n,) within the effort limits, and whether any was beyond."""
        held: Array = np.clip(torque, -self.effort, self.effort)
        return held, bool(np.any(held != torque))

    def carry(self, hand: int, bodies: Iterable[int], data: mujoco.MjData, share: float = 1.0) -> None:
        """Count bodies as rigid parts of the body `hand`, as they are placed in `data` now.

        Args:
            hand: id of the hand's body.
            bodies: ids of the carried bodies.
            data: the simulation.
            share: of the carried mass and inertia; several hands that hold one thing share it.
        """
        R, origin = data.xmat[hand].reshape(3, 3), data.xpos[hand]
        masses, centres, inertias = [], [], []
        for body in (hand, *bodies):
            believed = 1.0 if body == hand else share * (1.0 + self._imperfections.payload_error)
            frame = R.T @ data.ximat[body].reshape(3, 3)
            masses.append(believed * float(self._plain.body_mass[body]))
            centres.append(R.T @ (data.xipos[body] - origin))
            inertias.append(believed * frame @ np.diag(self._plain.body_inertia[body]) @ frame.T)
        mass, centre, inertia = combined_inertia(np.array(masses), np.array(centres), np.array(inertias))
        moments, axes = np.linalg.eigh(inertia)
        axes[:, 2] *= np.linalg.det(axes)
        self._set_inertia(hand, mass, centre, moments, matrix_to_quat(axes))
        self._lifted[hand] = self._compensation(hand, masses, centres, (hand, *bodies))

    def _compensation(
        self, hand: int, masses: list[float], centres: list[Array], bodies: tuple[int, ...]
    ) -> list[tuple[Array, Array]]:
        """Points of a hand (its frame) and forces (world): how compensation differs from that of the hand's own share.

        MuJoCo lifts the hand by its own share of the mass that it has now, the carried mass included, at the common
        centre; what each body has is the truth.
        """
        shares = np.array([self._plain.body_gravcomp[body] for body in bodies])
        if self._plain.opt.disableflags & self._mujoco.mjtDisableBit.mjDSBL_GRAVITY:
            return []
        extra = (shares - self._plain.body_gravcomp[hand]) * np.array(masses)
        return [
            (np.array(centre), -missing * np.array(self._plain.opt.gravity))
            for centre, missing in zip(centres, extra, strict=True)
            if missing != 0
        ]

    def drop(self, hand: int) -> None:
        """The hand is empty again."""
        plain = self._plain
        self._lifted.pop(hand, None)
        self._set_inertia(
            hand,
            plain.body_mass[hand],
            plain.body_ipos[hand],
            plain.body_inertia[hand],
            plain.body_iquat[hand],
        )

    def _set_inertia(self, body: int, mass: float, centre: Array, moments: Array, quat: Array) -> None:
        model = self._model
        model.body_mass[body], model.body_ipos[body] = mass, centre
        model.body_inertia[body], model.body_iquat[body] = moments, quat
        self._mujoco.mj_setConst(model, self._data)


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


@dataclass(frozen=True, slots=True)
class _Drives:
    """How the actuators of an arm turn control values into torques.

    A torque is `gear (gain ctrl + bias + spring q + damper qd)`.

    Attributes:
        gear, gain, bias, spring, damper: (n,).
        implicit: seconds ahead that the integrator takes the dampers into account; 0: it doesn't.
    """

    gear: Array
    gain: Array
    bias: Array
    spring: Array
    damper: Array
    implicit: float

    @staticmethod
    def of(model: mujoco.MjModel, robot: SceneRobot) -> _Drives:
        import mujoco

        ids = robot.actuator_ids
        for actuator in _drives(model, robot):
            reason = undriven_because(model, actuator)
            if reason is None and actuator not in ids and not is_motor(model, actuator):
                reason = "it is a servo of a joint that follows another, and would work against that"
            if reason is not None:
                raise ModelError(
                    f"the actuator {model.actuator(actuator).name!r} can't be driven: {reason}",
                    remedy="the controllers need <motor>, <position> or <velocity> actuators on the arm's joints",
                )
        gear = np.array(model.actuator_gear[ids, 0])
        affine = (model.actuator_biastype[ids] == int(mujoco.mjtBias.mjBIAS_AFFINE))[:, None]
        bias, spring, damper = np.where(affine, model.actuator_biasprm[ids, :3], 0.0).T
        implicit = (mujoco.mjtIntegrator.mjINT_IMPLICIT, mujoco.mjtIntegrator.mjINT_IMPLICITFAST)
        ahead = int(model.opt.integrator) in map(int, implicit)
        gain = np.array(model.actuator_gainprm[ids, 0])
        step = float(model.opt.timestep) if ahead else 0.0
        return _Drives(gear, gain, bias, spring * gear, damper * gear, step)

    def controls(self, torque: Array, q: Array, qd: Array, qdd: Array) -> Array:
        """(n,) control values that make these torques at q, qd, where the joints are to accelerate by qdd."""
        soon = qd + self.implicit * qdd
        values: Array = (torque / self.gear - self.bias - self.spring * q - self.damper * soon) / self.gain
        return values


def _drives(model: mujoco.MjModel, robot: SceneRobot) -> list[int]:
    """Actuators on the joints of a robot, those that follow others included."""
    joints = model.dof_jntid[robot.joint_dof_addresses]
    drives = (actuator_of_joint(model, int(joint)) for joint in joints)
    return [int(actuator) for actuator in drives if actuator is not None]
