"""What drives a compiled model's joints, and how strong it is."""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING

import numpy as np

from workcell.pose import Array

if TYPE_CHECKING:
    import mujoco


def actuator_of_joint(model: mujoco.MjModel, joint: int) -> int | None:
    """The actuator that drives a joint directly, or None."""
    import mujoco

    for actuator in range(model.nu):
        direct = model.actuator_trntype[actuator] == mujoco.mjtTrn.mjTRN_JOINT
        if direct and int(model.actuator_trnid[actuator, 0]) == joint:
            return actuator
    return None


def actuated_joints(model: mujoco.MjModel) -> set[int]:
    """Joints (ids) that some actuator moves: by itself, or through a tendon that is fixed to it."""
    import mujoco

    found: set[int] = set()
    for actuator in range(model.nu):
        kind, target = int(model.actuator_trntype[actuator]), int(model.actuator_trnid[actuator, 0])
        if kind in (mujoco.mjtTrn.mjTRN_JOINT, mujoco.mjtTrn.mjTRN_JOINTINPARENT):
            found.add(target)
        elif kind == mujoco.mjtTrn.mjTRN_TENDON:
            first = int(model.tendon_adr[target])
            for wrap in range(first, first + int(model.tendon_num[target])):
                if model.wrap_type[wrap] == mujoco.mjtWrap.mjWRAP_JOINT:
                    found.add(int(model.wrap_objid[wrap]))
    return found


def is_motor(model: mujoco.MjModel, actuator: int) -> bool:
    """Whether an actuator's force is its control value times a constant."""
    import mujoco

    fixed = model.actuator_gaintype[actuator] == mujoco.mjtGain.mjGAIN_FIXED
    unbiased = model.actuator_biastype[actuator] == mujoco.mjtBias.mjBIAS_NONE
    static = model.actuator_dyntype[actuator] == mujoco.mjtDyn.mjDYN_NONE
    return bool(fixed and unbiased and static)


def undriven_because(model: mujoco.MjModel, actuator: int) -> str | None:
    """Why a controller of torques can't drive a joint by an actuator, in words; None: it can.

    It can by a motor, and by what adds a multiple of the joint's position and velocity (`<position>`, `<velocity>`):
    the control value that makes a torque follows from the state.
    """
    import mujoco

    kinds = (model.actuator_dyntype, model.actuator_gaintype, model.actuator_biastype)
    dynamics, gain, bias = (int(kind[actuator]) for kind in kinds)
    if dynamics != int(mujoco.mjtDyn.mjDYN_NONE):
        return (
            "it has a state of its own (dyntype, timeconst), so that its force lags behind its control value"
        )
    if gain != int(mujoco.mjtGain.mjGAIN_FIXED):
        return "its gain is not fixed, as a muscle's"
    if bias not in (int(mujoco.mjtBias.mjBIAS_NONE), int(mujoco.mjtBias.mjBIAS_AFFINE)):
        return "its bias is no multiple of the joint's position and velocity"
    if model.actuator_gainprm[actuator, 0] == 0.0 or model.actuator_gear[actuator, 0] == 0.0:
        return "its gain is zero"
    return None


def servo_range(model: mujoco.MjModel, actuator: int) -> tuple[float, float] | None:
    """Where a position servo can hold its joint: where it gives no force at some control value of its `ctrlrange`.

    None for what is no servo of positions, or has no limit of its control values.
    """
    import mujoco

    affine = model.actuator_biastype[actuator] == mujoco.mjtBias.mjBIAS_AFFINE
    spring = float(model.actuator_biasprm[actuator, 1]) * float(model.actuator_gear[actuator, 0])
    if not affine or spring == 0.0 or not model.actuator_ctrllimited[actuator]:
        return None
    if undriven_because(model, actuator) is not None:
        return None
    gain, bias = float(model.actuator_gainprm[actuator, 0]), float(model.actuator_biasprm[actuator, 0])
    first, last = (-(gain * float(control) + bias) / spring for control in model.actuator_ctrlrange[actuator])
    return min(first, last), max(first, last)


def actuator_targets(model: mujoco.MjModel, actuator: int) -> tuple[int, ...]:
    """Bodies that an actuator acts on: by a joint, a site, a body, or a tendon through its joints, sites and geoms."""
    import mujoco

    kind, target = int(model.actuator_trntype[actuator]), int(model.actuator_trnid[actuator, 0])
    transmission = mujoco.mjtTrn
    if kind in (transmission.mjTRN_JOINT, transmission.mjTRN_JOINTINPARENT):
        return (int(model.jnt_bodyid[target]),)
    if kind in (transmission.mjTRN_SITE, transmission.mjTRN_SLIDERCRANK):
        return (int(model.site_bodyid[target]),)
    if kind == transmission.mjTRN_BODY:
        return (target,)
    if kind != transmission.mjTRN_TENDON:
        return ()
    owner = {
        int(mujoco.mjtWrap.mjWRAP_JOINT): model.jnt_bodyid,
        int(mujoco.mjtWrap.mjWRAP_SITE): model.site_bodyid,
        int(mujoco.mjtWrap.mjWRAP_SPHERE): model.geom_bodyid,
        int(mujoco.mjtWrap.mjWRAP_CYLINDER): model.geom_bodyid,
    }
    wraps = range(int(model.tendon_adr[target]), int(model.tendon_adr[target] + model.tendon_num[target]))
    return tuple(
        int(owner[int(model.wrap_type[w])][model.wrap_objid[w]])
        for w in wraps
        if int(model.wrap_type[w]) in owner
    )


def effort_limits(model: mujoco.MjModel, joints: Sequence[int]) -> Array:
    """(k,) largest torques (forces) on joints; inf where neither the joint nor its actuator has a limit.

    An actuator's force and a motor's control value act through its gear.
    """
    values = []
    for joint in joints:
        actuator = actuator_of_joint(model, joint)
        bounds = [np.inf]
        if model.jnt_actfrclimited[joint]:
            bounds.append(float(np.abs(model.jnt_actfrcrange[joint]).min()))
        if actuator is not None:
            gear = abs(float(model.actuator_gear[actuator, 0]))
            if model.actuator_forcelimited[actuator]:
                bounds.append(gear * float(np.abs(model.actuator_forcerange[actuator]).min()))
            if model.actuator_ctrllimited[actuator] and is_motor(model, actuator):
                gain = abs(float(model.actuator_gainprm[actuator, 0]))
                bounds.append(gear * gain * float(np.abs(model.actuator_ctrlrange[actuator]).min()))
        values.append(min(bounds))
    return np.array(values)
