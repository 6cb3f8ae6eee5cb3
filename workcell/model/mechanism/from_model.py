"""The `Mechanism` inside a compiled model: every joint by its id, and the active constraints that tie them.

Joints keep MuJoCo's values. A body with several joints becomes several links; what no joint moves is the world.
"""

from __future__ import annotations

from collections.abc import Collection, Iterable
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import ArrayLike

from workcell.errors import InputError, ModelError, UnknownNameError
from workcell.model.loading.actuators import actuated_joints
from workcell.model.loading.couplings import locked_values, settled
from workcell.model.loops.elements import loop_elements
from workcell.model.mechanism.compiled import CompiledMechanism
from workcell.model.mechanism.mechanism import Frame, Mechanism
from workcell.model.mechanism.ties import Ties
from workcell.model.mechanism.walking import Walk, addresses_of, joint_label
from workcell.pose import Array, Pose, read_only

if TYPE_CHECKING:
    import mujoco


def mechanism_of(
    model: mujoco.MjModel,
    *,
    qpos: ArrayLike | None = None,
    moving: Collection[str] | None = None,
    name: str = "mechanism",
    where: str | Path | None = None,
) -> Mechanism:
    """Every joint of a compiled model that moves, with what ties it.

    Args:
        model: compiled model; equality constraints that are inactive at the start don't count.
        qpos: (nq,) raw positions of what does not move, and where the mechanism is at home; None: the model's `qpos0`,
            with joints that are held, or follow others, where they belong. What is held is put there in any case.
        moving: names of the joints that move; None: all but floating bodies that nothing ties to anything.
        name: for messages.
        where: the file, for messages.

    Raises:
        ModelError: no joint, reversed limits, a constraint that can't be looked at or never kept; InputError: raw
            positions that are none; UnknownNameError: no such joint.
    """
    chosen = _moving(model, moving, where)
    start = _start(model, qpos)
    walk = Walk(model, chosen, start, where)
    if not walk.joints:
        raise ModelError("nothing moves here: the model has no joint", where=where)
    index = {joint.id: k for k, joint in enumerate(walk.joints)}
    ties = Ties(model, walk, index, start, where)
    addresses = np.concatenate([np.arange(model.nq)[addresses_of(model, joint.id)] for joint in walk.joints])
    mechanism = Mechanism(
        name=name,
        joints=tuple(walk.joints),
        link_names=tuple(walk.names),
        closures=tuple(ties.closures),
        followers=tuple(ties.followers),
        sums=tuple(ties.sums),
        frames=_frames(model, walk),
        home=start[addresses],
        notes=tuple(ties.notes),
    )
    compiled = CompiledMechanism(
        model,
        read_only(start),
        read_only(addresses, np.int64),
        read_only(walk.link_of_body, np.int64),
        tuple(walk.T_link_body),
    )
    return replace(mechanism, compiled=compiled)


def _start(model: mujoco.MjModel, qpos: ArrayLike | None) -> Array:
    """Raw positions to begin at."""
    start = np.array(model.qpos0 if qpos is None else qpos, dtype=float)
    if start.shape != (model.nq,) or not np.all(np.isfinite(start)):
        raise InputError(
            f"raw positions of this model are {model.nq} finite numbers, not an array of shape {start.shape}",
            where="qpos",
        )
    placed = locked_values(model)
    if qpos is None:
        single = [joint for joint in range(model.njnt) if int(model.jnt_type[joint]) in (2, 3)]
        placed = settled(model, {joint: float(start[model.jnt_qposadr[joint]]) for joint in single})
    for joint, value in placed.items():
        start[model.jnt_qposadr[joint]] = value
    return start


def _moving(model: mujoco.MjModel, names: Iterable[str] | None, where: str | Path | None) -> frozenset[int]:
    known = {joint_label(model, joint): joint for joint in range(model.njnt)}
    if names is not None:
        for name in (listed := list(names)):
            if name not in known:
                raise UnknownNameError("joint", name, known, where=where)
        return frozenset(known[name] for name in listed)
    tied = {joint for element in loop_elements(model) for joint in element.joints}
    loose = {
        joint
        for joint in range(model.njnt)
        if int(model.jnt_type[joint]) == 0
        and not tied.intersection(_below(model, joint))
        and not actuated_joints(model).intersection(_below(model, joint))
    }
    return frozenset(range(model.njnt)) - frozenset(joint for free in loose for joint in _below(model, free))


def _below(model: mujoco.MjModel, joint: int) -> list[int]:
    """The joint and all that hang on its body."""
    root, found = int(model.jnt_bodyid[joint]), []
    for other in range(model.njnt):
        body = int(model.jnt_bodyid[other])
        while body > 0 and body != root:
            body = int(model.body_parentid[body])
        if body == root:
            found.append(other)
    return found


def _frames(model: mujoco.MjModel, walk: Walk) -> dict[str, Frame]:
    """Sites, and bodies where no site has their name."""
    frames = {}
    for body in range(1, model.nbody):
        if name := str(model.body(body).name):
            frames[name] = Frame(name, walk.link_of_body[body], walk.T_link_body[body])
    for site in range(model.nsite):
        if name := str(model.site(site).name):
            body = int(model.site_bodyid[site])
            T = walk.T_link_body[body] @ Pose(model.site_pos[site], model.site_quat[site])
            frames[name] = Frame(name, walk.link_of_body[body], T)
    return frames
