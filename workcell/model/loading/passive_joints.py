"""The passive joints of a robot in a compiled model, and what determines them.

Loops that leave no choice to the driven joints themselves are refused by name: workcell plans for each of them freely.
"""

from __future__ import annotations

from collections.abc import Collection, Sequence
from typing import TYPE_CHECKING

import numpy as np

from workcell.model.loading.actuators import actuated_joints
from workcell.model.loading.couplings import leaders, locked_values
from workcell.model.loading.subtrees import joints_of, subtree
from workcell.model.loops.closing import TOLERANCE, LoopSystem
from workcell.model.loops.elements import Element, loop_elements, tendon_limits
from workcell.model.loops.loops import Loop, Loops
from workcell.pose import Array

if TYPE_CHECKING:
    import mujoco

_RANK = 1e-6
"""Singular values below this, against the largest, tell that an equation says nothing."""
_NUDGES, _NUDGE = 3, 0.05
"""How often, and how far (radians, metres), driven joints are moved to see whether loops let them."""


def find_loops(model: mujoco.MjModel, bodies: Collection[int], driven: Sequence[int]) -> Loops:
    """The passive joints of a robot, by what determines them.

    Args:
        model: compiled model.
        bodies: ids of the robot's bodies.
        driven: ids of the joints that its configuration says, those that follow others included.
    """
    import mujoco

    single = (int(mujoco.mjtJoint.mjJNT_HINGE), int(mujoco.mjtJoint.mjJNT_SLIDE))
    held, follows = locked_values(model), leaders(model)
    coupled = {*held, *follows, *(leader for found in follows.values() for leader, _ in found)}
    powered = actuated_joints(model) | set(driven) | coupled
    idle = [joint for body in sorted(bodies) for joint in joints_of(model, body) if joint not in powered]
    free = {joint for joint in range(model.njnt) if int(model.jnt_type[joint]) not in single}
    mine, refusals, kept = {*idle, *driven}, [], []
    for element in loop_elements(model):
        moving = [joint for joint in element.joints if joint not in held]
        if element.unsupported and (not element.joints or mine.intersection(moving)):
            refusals.append(f"{element.name}: {element.unsupported} are not supported")
        elif not mine.intersection(moving):
            continue
        elif loose := [joint for joint in moving if joint in free]:
            refusals.append(
                f"{element.name} ties {_names(model, loose)}, neither hinge nor slide, to the robot"
            )
        elif not set(idle).intersection(moving):
            refusals.append(f"{element.name} ties joints that are driven: {_names(model, moving)}")
        else:
            kept.append(element)
    limits = []
    for limit in tendon_limits(model):
        if not mine.intersection(limit.joints):
            continue
        if limit.multiples is None or coupled.union(idle).intersection(limit.joints):
            refusals.append(f"the limits of {limit.name}: only those over driven joints alone are supported")
        else:
            limits.append((limit, np.asarray(model.jnt_qposadr)[list(limit.joints)].astype(np.int64)))
    loops = [_loop(model, group, idle, held) for group in _groups(kept, set(idle))]
    for loop in loops:
        refusals += _constraints(model, loop, driven)
    determined = {joint for loop in loops for joint in loop.joints}
    carried = [bool(set(driven).intersection(loop.system.given.tolist())) for loop in loops]
    outer = tuple(loop for loop, moves in zip(loops, carried, strict=True) if moves)
    roots = {int(model.jnt_bodyid[joint]) for loop in outer for joint in loop.joints}
    return Loops(
        outer,
        tuple(loop for loop, moves in zip(loops, carried, strict=True) if not moves),
        tuple(limits),
        subtree(model, roots) if roots else frozenset(),
        tuple(_name(model, joint) for joint in idle if joint not in determined),
        tuple(refusals),
    )


def _name(model: mujoco.MjModel, joint: int) -> str:
    return str(model.joint(joint).name) or f"joint {joint}"


def _names(model: mujoco.MjModel, joints: Sequence[int]) -> str:
    return ", ".join(_name(model, joint) for joint in joints)


def _groups(elements: Sequence[Element], idle: set[int]) -> list[list[Element]]:
    """Elements that share passive joints, together."""
    groups: list[tuple[set[int], list[Element]]] = []
    for element in elements:
        joints, members = idle.intersection(element.joints), [element]
        apart = []
        for known, others in groups:
            if known & joints:
                joints, members = known | joints, [*others, *members]
            else:
                apart.append((known, others))
        groups = [*apart, (joints, members)]
    return [members for _, members in groups]


def _loop(
    model: mujoco.MjModel, elements: Sequence[Element], idle: Collection[int], held: Collection[int]
) -> Loop:
    joints = sorted({joint for element in elements for joint in element.joints})
    passive = [joint for joint in joints if joint in idle]
    given = [joint for joint in joints if joint not in idle and joint not in held]
    limited = np.asarray(model.jnt_limited)[passive].astype(bool)
    ranges = np.asarray(model.jnt_range)[passive]
    return Loop(
        tuple(element.name for element in elements),
        tuple(passive),
        tuple(_name(model, joint) for joint in passive),
        LoopSystem(model, elements, passive, given),
        np.where(limited, ranges[:, 0], -np.inf),
        np.where(limited, ranges[:, 1], np.inf),
    )


def _constraints(model: mujoco.MjModel, loop: Loop, driven: Sequence[int]) -> list[str]:
    """What a loop leaves open, or demands of joints that are driven, in words; empty: it can be honoured.

    Seen where the model is assembled, and near it: at the assembly itself a mechanism may be singular.
    """
    rng, system = np.random.default_rng(0), loop.system
    determined = free = False
    for _ in range(_NUDGES):
        qpos = np.array(model.qpos0)
        qpos[system.given_qpos] += _NUDGE * rng.uniform(-1, 1, len(system.given))
        found = system.close(qpos)
        if found.missed > TOLERANCE:
            continue
        free = True
        qpos[system.passive_qpos] = found.values
        _, by_passive, by_given = system.at(qpos)
        determined |= _rank(by_passive) == len(loop.joints)
        free &= _rank(np.hstack([by_passive, by_given])) == _rank(by_passive)
    tied = [joint for joint in system.given.tolist() if joint in driven]
    if tied and not free:
        return [f"{loop.name} ties joints that are driven: {_names(model, tied)}"]
    if not determined:
        return [f"{loop.name} leaves the passive joints {', '.join(loop.joint_names)} undetermined"]
    return []


def _rank(matrix: Array) -> int:
    values = np.linalg.svd(matrix, compute_uv=False)
    return int((values > _RANK * max(values[0], 1e-12)).sum()) if len(values) else 0
