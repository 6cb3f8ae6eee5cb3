"""Every joint of a scene: who moves it, between which limits, and where those come from; what closes loops."""

from __future__ import annotations

from collections.abc import Iterator
from typing import TYPE_CHECKING

import numpy as np

from workcell.inspection.findings import Finding, fact
from workcell.model.labels import body_name
from workcell.model.loading.actuators import actuated_joints, actuator_of_joint
from workcell.model.loading.couplings import leaders, locked_values

if TYPE_CHECKING:
    import mujoco

    from workcell.model.scene import Scene
    from workcell.model.scene_mechanism import SceneMechanism
    from workcell.model.scene_parts import SceneRobot


def joint_findings(scene: Scene) -> Iterator[Finding]:
    """The joints of every robot, then those that no robot drives."""
    model, driven = scene.model, set[int]()
    for robot in scene.robots.values():
        yield from _variables(model, robot)
        driven.update(_ids(model, robot))
    if scene.mechanism is not None:
        yield from _moving(scene.mechanism)
        driven.update(joint.id for joint in scene.mechanism.mechanism.joints)
    held, follows, powered = locked_values(model), leaders(model), actuated_joints(model)
    for joint in range(model.njnt):
        if joint in driven or not _is_single(model, joint):
            continue
        name = _name(model, joint)
        if joint in held:
            yield fact(
                "joint", f"{name}: locked at {held[joint]:g} {_unit(model, joint)}", joint=name, kind="locked",
                value=held[joint],
            )  # fmt: skip
        elif joint in follows:
            yield _follower(model, joint, follows[joint][0])
        elif joint in powered:
            yield _driven(model, joint, bool(scene.robots))
        else:
            yield fact(
                "joint", f"{name}: passive; it stays where the model has it, unless a loop or forces move it",
                joint=name, kind="passive",
            )  # fmt: skip


def _moving(moving: SceneMechanism) -> Iterator[Finding]:
    """The joints of a mechanism: those that motors move with their limits, the others as what they are."""
    motors = dict(zip(moving.motors, zip(moving.velocity, moving.acceleration, strict=True), strict=True))
    for k, joint in enumerate(moving.mechanism.joints):
        driven = k in motors
        words = (
            "driven" if driven else "found from the driven ones" if moving.mechanism.closures else "passive"
        )
        range_ = f" [{joint.lower:.4f}, {joint.upper:.4f}]" if joint.limited else ""
        speed = f", velocity {motors[k][0]:g}, acceleration {motors[k][1]:g}" if driven else ""
        yield fact(
            "joint", f"{joint.name}: {joint.kind}{range_}{speed}; {words}", joint=joint.name,
            kind="driven" if driven else "passive", lower=_finite(joint.lower), upper=_finite(joint.upper),
        )  # fmt: skip


def _variables(model: mujoco.MjModel, robot: SceneRobot) -> Iterator[Finding]:
    arm = robot.robot
    ids = {model.joint(j).name.removeprefix(robot.prefix): j for j in range(model.njnt)}
    follows = leaders(model)
    for k, name in enumerate(arm.joint_names):
        joint, unit = ids.get(name, -1), "m" if arm.slides[k] else "rad"
        lower, upper = float(arm.lower[k]), float(arm.upper[k])
        source, given = "the file's", joint < 0 or _has_range(model, joint)
        words = f"[{lower:.4f}, {upper:.4f}] {unit}"
        kind = "driven"
        if lower == upper:
            words, kind, source = f"locked at {lower:g} {unit}", "locked", "equal limits or a constraint"
        elif not given:
            source = "none in the file: taken"
            words += " (the file has no limits)"
        yield fact(
            "joint",
            f"{name}: {words}, velocity {arm.velocity[k]:g}, effort {arm.effort[k]:g}; driven",
            joint=name, kind=kind, lower=lower, upper=upper, limits_from=source,
            velocity=_finite(arm.velocity[k]), acceleration=_finite(arm.acceleration[k]),
            effort=_finite(arm.effort[k]),
        )  # fmt: skip
    names = set(arm.joint_names)
    for name in arm.all_joint_names:
        joint = ids.get(name, -1)
        if name not in names and joint in follows:
            yield _follower(model, joint, follows[joint][0])


def _driven(model: mujoco.MjModel, joint: int, beside_robots: bool) -> Finding:
    """A driven joint that is on the way to no robot's tool: of a mechanism, another arm, a finger, a door."""
    lower, upper = (float(value) for value in model.jnt_range[joint])
    words = f"[{lower:.4f}, {upper:.4f}] {_unit(model, joint)}" if _has_range(model, joint) else "no limits"
    also = ", on the way to no tool of a robot here" if beside_robots else ""
    through = "" if actuator_of_joint(model, joint) is not None else " through a tendon"
    return fact(
        "joint", f"{_name(model, joint)}: {words}; driven{through}{also}", joint=_name(model, joint),
        kind="other" if beside_robots else "driven",
    )  # fmt: skip


def _follower(model: mujoco.MjModel, joint: int, found: tuple[int, np.polynomial.Polynomial]) -> Finding:
    leader, polynomial = found
    name, other = _name(model, joint), _name(model, leader)
    terms = [
        f"{c:g}" + ("" if i == 0 else " q" if i == 1 else f" q^{i}")
        for i, c in enumerate(polynomial.coef)
        if c
    ]
    return fact(
        "joint", f"{name}: coupled, follows {other} by {' + '.join(terms) or '0'}", joint=name, kind="coupled",
        follows=other, coefficients=[float(c) for c in polynomial.coef],
    )  # fmt: skip


def loop_findings(model: mujoco.MjModel) -> Iterator[Finding]:
    """Constraints that close loops, or tie bodies together, as the scene begins."""
    import mujoco

    words = {
        int(mujoco.mjtEq.mjEQ_CONNECT): "connect",
        int(mujoco.mjtEq.mjEQ_WELD): "weld",
        int(mujoco.mjtEq.mjEQ_TENDON): "tendon",
        int(mujoco.mjtEq.mjEQ_FLEX): "flex",
    }
    for k in range(model.neq):
        kind = words.get(int(model.eq_type[k]))
        if kind is None or not model.eq_active0[k]:
            continue
        ends = [int(model.eq_obj1id[k]), int(model.eq_obj2id[k])]
        if kind in ("connect", "weld"):
            bodies = int(model.eq_objtype[k]) == int(mujoco.mjtObj.mjOBJ_BODY)
            names = [body_name(model, e if bodies else int(model.site_bodyid[e])) for e in ends]
            yield fact("loop", f"loop: a {kind} between {names[0]} and {names[1]}", kind=kind, bodies=names)
        else:
            yield fact("loop", f"a constraint of kind {kind} (number {k})", kind=kind, bodies=[])


def _ids(model: mujoco.MjModel, robot: SceneRobot) -> set[int]:
    addresses = set(robot.joint_qpos_addresses.tolist())
    return {j for j in range(model.njnt) if int(model.jnt_qposadr[j]) in addresses}


def _has_range(model: mujoco.MjModel, joint: int) -> bool:
    return bool(model.jnt_limited[joint]) or bool(np.any(model.jnt_range[joint]))


def _name(model: mujoco.MjModel, joint: int) -> str:
    return str(model.joint(joint).name) or f"joint number {joint}"


def _is_single(model: mujoco.MjModel, joint: int) -> bool:
    import mujoco

    return int(model.jnt_type[joint]) in (int(mujoco.mjtJoint.mjJNT_HINGE), int(mujoco.mjtJoint.mjJNT_SLIDE))


def _unit(model: mujoco.MjModel, joint: int) -> str:
    import mujoco

    return "m" if int(model.jnt_type[joint]) == int(mujoco.mjtJoint.mjJNT_SLIDE) else "rad"


def _finite(value: float) -> float | None:
    return float(value) if np.isfinite(value) else None
