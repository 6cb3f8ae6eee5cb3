"""Forces of a mechanism's motors: together with those of its ties they make a motion.

The equations of motion are MuJoCo's, on a copy of the model without contacts, limits and dry friction:

    M a + bias - passive = A^T f + J^T l

f are the forces of the actuators and A their moment arms, J the rows of the model's active equality constraints and l
what these transmit. Of all solutions the smallest is taken, which is the only one where motors say no more than the
ties leave free.
"""

from __future__ import annotations

import copy
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from workcell.errors import ModelError
from workcell.model.mechanism.mechanism import RATES, Mechanism
from workcell.pose import Array

if TYPE_CHECKING:
    import mujoco

_RANK = 1e-9
"""Singular values below this share of the largest are zero."""


@dataclass(frozen=True, slots=True)
class Needed:
    """Forces of actuators (nu,), and what of the motion they can't make: (rates,) forces that nothing provides."""

    forces: Array
    missing: Array


class MotorForces:
    """Inverse dynamics of a mechanism's motors.

    Args:
        mechanism: in a compiled model, which is copied.

    Attributes:
        actuators: ids of the actuators that act on it.
        dofs: (dof,) where each number of a tangent is in raw velocities.
        low, high: (actuators,) forces that each can give; infinite without a limit.

    Raises:
        ModelError: it comes from no compiled model, nothing drives it, or an actuator that no force can be asked of.
    """

    def __init__(self, mechanism: Mechanism) -> None:
        import mujoco

        if mechanism.compiled is None:
            raise ModelError("a mechanism without a compiled model can't be driven", where=mechanism.name)
        self._mujoco, self._compiled = mujoco, mechanism.compiled
        model = self._model = copy.copy(mechanism.compiled.model)
        bits = mujoco.mjtDisableBit
        model.opt.disableflags |= bits.mjDSBL_CONTACT | bits.mjDSBL_LIMIT | bits.mjDSBL_FRICTIONLOSS
        model.opt.jacobian = mujoco.mjtJacobian.mjJAC_DENSE
        self.data = mujoco.MjData(model)
        self.dofs = np.concatenate(
            [int(model.jnt_dofadr[j.id]) + np.arange(RATES[j.kind]) for j in mechanism.joints]
        ).astype(np.int64)
        self.actuators = self._acting(mechanism.name)
        self.low, self.high = _force_range(model, self.actuators)

    def _acting(self, name: str) -> NDArray[np.int64]:
        """The actuators with a moment arm on the mechanism's joints."""
        model, data = self._model, self.data
        data.qpos[:] = self._compiled.start
        self._mujoco.mj_forward(model, data)
        arms = self._arms()[:, self.dofs]
        acting = np.flatnonzero(np.abs(arms).max(axis=1, initial=0.0) > 0.0)
        if not len(acting):
            raise ModelError("no actuator drives it", where=name, remedy="add an <actuator> for its joints")
        for actuator in acting.tolist():
            if reason := _undriven_because(model, actuator):
                raise ModelError(
                    f"the actuator {model.actuator(actuator).name!r} can't be driven: {reason}",
                    where=name,
                    remedy="<motor>, <position> or <velocity> actuators",
                )
        return acting.astype(np.int64)

    def _arms(self) -> Array:
        """(nu, nv) moment arms of all actuators where `data` is."""
        model, data = self._model, self.data
        arms = np.zeros((model.nu, model.nv))
        self._mujoco.mju_sparse2dense(
            arms, data.actuator_moment, data.moment_rownnz, data.moment_rowadr, data.moment_colind
        )
        return arms

    def ties(self) -> Array:
        """(r, dof) rows of the active equality constraints where forces were asked for last."""
        data, model = self.data, self._model
        rows = np.reshape(data.efc_J[: data.nefc * model.nv], (data.nefc, model.nv))
        equal = data.efc_type[: data.nefc] == int(self._mujoco.mjtConstraint.mjCNSTR_EQUALITY)
        found: Array = rows[equal][:, self.dofs]
        return found

    def at(
        self, qpos: Array, qvel: Array, acceleration: Array, pressing: dict[int, tuple[Array, Array]]
    ) -> Needed:
        """Forces of the actuators that make an acceleration (dof,) of the mechanism, all else unaccelerated.

        Args:
            qpos, qvel: raw positions (nq,) and velocities (nv,).
            acceleration: (dof,).
            pressing: by body (id): a point in the world (3,) and a force (3,), newtons, with which the mechanism
                presses on something there.
        """
        model, data = self._model, self.data
        data.qpos[:], data.qvel[:], data.qacc[:] = qpos, qvel, 0.0
        data.qacc[self.dofs] = acceleration
        self._mujoco.mj_inverse(model, data)
        wanted = np.array(data.qfrc_inverse + data.qfrc_constraint)
        jacobian = np.zeros((3, model.nv))
        for body, (point, force) in pressing.items():
            self._mujoco.mj_jac(model, data, jacobian, None, point, body)
            wanted += jacobian.T @ force
        arms, ties = self._arms()[self.actuators][:, self.dofs], self.ties()
        both = np.vstack([arms, ties]).T
        needed = wanted[self.dofs]
        found = np.linalg.lstsq(both, needed, rcond=_RANK)[0]
        return Needed(found[: len(self.actuators)], needed - both @ found)

    def share(self, forces: Array) -> Array:
        """(..., actuators) shares of what each actuator can give."""
        limit = np.where(forces >= 0, self.high, -self.low)
        shares: Array = np.divide(
            np.abs(forces), limit, out=np.full(np.shape(forces), np.inf), where=limit > 0
        )
        return np.where(np.isinf(limit), 0.0, shares)

    def names(self) -> list[str]:
        """Names of the actuators."""
        return [str(self._model.actuator(k).name) for k in self.actuators.tolist()]


def _undriven_because(model: mujoco.MjModel, actuator: int) -> str:
    """Why no control value makes a given force; empty: one does. Whatever the actuator acts on."""
    import mujoco

    affine = (int(mujoco.mjtBias.mjBIAS_NONE), int(mujoco.mjtBias.mjBIAS_AFFINE))
    if int(model.actuator_dyntype[actuator]) != int(mujoco.mjtDyn.mjDYN_NONE):
        return (
            "it has a state of its own (dyntype, timeconst), so that its force lags behind its control value"
        )
    if int(model.actuator_gaintype[actuator]) != int(mujoco.mjtGain.mjGAIN_FIXED):
        return "its gain is not fixed, as a muscle's"
    if int(model.actuator_biastype[actuator]) not in affine:
        return "its bias is no multiple of position and velocity"
    return "its gain is zero" if model.actuator_gainprm[actuator, 0] == 0.0 else ""


def _force_range(model: mujoco.MjModel, actuators: NDArray[np.int64]) -> tuple[Array, Array]:
    """Forces that actuators can give: by their force ranges, and by the control ranges of motors."""
    low, high = np.full(len(actuators), -np.inf), np.full(len(actuators), np.inf)
    for k, actuator in enumerate(actuators.tolist()):
        if model.actuator_forcelimited[actuator]:
            low[k], high[k] = model.actuator_forcerange[actuator]
        if model.actuator_ctrllimited[actuator] and not model.actuator_biasprm[actuator, :3].any():
            ends = model.actuator_gainprm[actuator, 0] * model.actuator_ctrlrange[actuator]
            low[k], high[k] = max(low[k], ends.min()), min(high[k], ends.max())
    return low, high
