"""The `Mechanism` inside a compiled model: every joint by its id, and the active constraints that tie them.

Joints keep MuJoCo's values. A body with several joints becomes several links; what no joint moves is the world.
"""

from __future__ import annotations

from collections.abc import Collection, Mapping
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import ArrayLike

from workcell.errors import ModelError, UnknownNameError
from workcell.model.loading.actuators import actuated_joints
from workcell.model.loading.couplings import leaders, locked_values
from workcell.model.loops.elements import joints_on, loop_elements, tendon_limits
from workcell.model.mechanism.closures import closure_of
from workcell.model.mechanism.compiled import CompiledMechanism
from workcell.model.mechanism.mechanism import (
    WORLD,
    Closure,
    Follower,
    Frame,
    Joint,
    JointKind,
    JointSum,
    Mechanism,
)
from workcell.pose import Array, Pose, axis_angle_to_matrix, read_only

if TYPE_CHECKING:
    import mujoco

_KINDS: Mapping[int, JointKind] = {0: "free", 1: "ball", 2: "slide", 3: "hinge"}
"""MuJoCo's `mjtJoint`."""


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
        qpos: (nq,) raw positions of what does not move, and where the mechanism is at home; None: the model's `qpos0`.
        moving: names of the joints that move; None: all but floating bodies that nothing ties to anything.
        name: for messages.
        where: the file, for messages.

    Raises:
        ModelError: no joint, reversed limits, a constraint that can't be looked at; UnknownNameError: no such joint.
    """
    start = np.array(model.qpos0 if qpos is None else qpos, dtype=float)
    chosen = _moving(model, moving, where)
    walk = _Walk(model, chosen, start, where)
    if not walk.joints:
        raise ModelError("nothing moves here: the model has no joint", where=where)
    index = {joint.id: k for k, joint in enumerate(walk.joints)}
    closures, sums = _ties(model, walk, index, where)
    home = np.concatenate([start[_addresses(model, joint.id)] for joint in walk.joints])
    mechanism = Mechanism(
        name=name,
        joints=tuple(walk.joints),
        link_names=tuple(walk.names),
        closures=closures,
        followers=_followers(model, index),
        sums=sums,
        frames=_frames(model, walk),
        home=home,
    )
    addresses = np.concatenate([np.arange(model.nq)[_addresses(model, joint.id)] for joint in walk.joints])
    compiled = CompiledMechanism(
        model,
        read_only(start),
        read_only(addresses, np.int64),
        read_only(walk.link_of_body, np.int64),
        tuple(walk.T_link_body),
    )
    return replace(mechanism, compiled=compiled)


def _addresses(model: mujoco.MjModel, joint: int) -> slice:
    first = int(model.jnt_qposadr[joint])
    return slice(first, first + {0: 7, 1: 4}.get(int(model.jnt_type[joint]), 1))


def _moving(model: mujoco.MjModel, names: Collection[str] | None, where: str | Path | None) -> frozenset[int]:
    known = {str(model.joint(joint).name): joint for joint in range(model.njnt)}
    if names is not None:
        for name in names:
            if name not in known:
                raise UnknownNameError("joint", name, known, where=where)
        return frozenset(known[name] for name in names)
    tied = {joint for element in loop_elements(model) for joint in element.joints}
    loose = {
        joint
        for joint in range(model.njnt)
        if int(model.jnt_type[joint]) == 0
        and not tied.intersection(_below(model, joint))
        and not _actuated_below(model, joint)
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


def _actuated_below(model: mujoco.MjModel, joint: int) -> bool:
    return bool(actuated_joints(model).intersection(_below(model, joint)))


class _Walk:
    """The joints of all bodies, parents first, and where every body is on its link."""

    def __init__(
        self, model: mujoco.MjModel, moving: frozenset[int], start: Array, where: str | Path | None
    ) -> None:
        self.joints: list[Joint] = []
        self.names = ["world"]
        self.link_of_body, self.T_link_body = [WORLD], [Pose.identity()]
        self._model, self._start, self._where = model, start, where
        self._held = locked_values(model)
        follows = leaders(model)
        driven = actuated_joints(model)
        self._driven = driven | {
            j for j, found in follows.items() if any(lead in driven for lead, _ in found)
        }
        for body in range(1, model.nbody):
            self._body(body, moving)

    def _body(self, body: int, moving: frozenset[int]) -> None:
        model = self._model
        parent = int(model.body_parentid[body])
        link, T = self.link_of_body[parent], self.T_link_body[parent]
        T = T @ Pose(model.body_pos[body], model.body_quat[body])
        for joint in joints_on(model, body):
            if joint in moving:
                link, T = self._joint(joint, link, T)
            else:
                T = self._fixed(joint, T)
        self.link_of_body.append(link)
        self.T_link_body.append(T)

    def _fixed(self, joint: int, T: Pose) -> Pose:
        """Where a body is after a joint that stays where it begins."""
        model, value = self._model, self._start[_addresses(self._model, joint)]
        kind, anchor, axis = _KINDS[int(model.jnt_type[joint])], model.jnt_pos[joint], model.jnt_axis[joint]
        if kind == "free":
            return Pose(value[:3], value[3:])
        reference = float(model.qpos0[model.jnt_qposadr[joint]])
        if kind == "slide":
            return T @ Pose.from_xyz((value[0] - reference) * axis)
        turn = (
            Pose(np.zeros(3), value)
            if kind == "ball"
            else Pose.from_rotation(np.zeros(3), axis_angle_to_matrix(axis, value[0] - reference))
        )
        return T @ Pose.from_xyz(anchor) @ turn @ Pose.from_xyz(-np.asarray(anchor))

    def _joint(self, joint: int, link: int, T: Pose) -> tuple[int, Pose]:
        model = self._model
        kind = _KINDS[int(model.jnt_type[joint])]
        name = str(model.joint(joint).name) or f"joint {joint}"
        axis, anchor = np.array(model.jnt_axis[joint]), np.array(model.jnt_pos[joint])
        lower, upper = self._limits(joint, kind, name)
        if kind == "free":
            link, frame, below, axis = WORLD, Pose.identity(), Pose.identity(), np.zeros(3)
        else:
            frame, below = T @ Pose.from_xyz(anchor), Pose.from_xyz(-anchor)
            reference = float(model.qpos0[model.jnt_qposadr[joint]])
            if kind == "slide":
                frame = frame @ Pose.from_xyz(-reference * axis)
            elif kind == "hinge":
                frame = frame @ Pose.from_rotation(np.zeros(3), axis_angle_to_matrix(axis, -reference))
            else:
                axis = np.zeros(3)
        self.joints.append(Joint(name, kind, link, frame, axis, lower, upper, joint, joint in self._driven))
        body = int(model.jnt_bodyid[joint])
        self.names.append(str(model.body(body).name) or f"body {body}")
        return len(self.joints), below

    def _limits(self, joint: int, kind: JointKind, name: str) -> tuple[float, float]:
        low, high = map(float, self._model.jnt_range[joint])
        limited = bool(self._model.jnt_limited[joint])
        if kind == "free":
            return -np.inf, np.inf
        if kind == "ball":
            return (0.0, high) if limited else (0.0, np.inf)
        if not low <= high:
            raise ModelError(
                f"the range of joint {name!r} is [{low:g}, {high:g}]",
                where=self._where,
                remedy="the lower limit, then the upper one",
            )
        if joint in self._held:
            return self._held[joint], self._held[joint]
        return (low, high) if limited or low != 0.0 or high != 0.0 else (-np.inf, np.inf)


def _ties(
    model: mujoco.MjModel, walk: _Walk, index: Mapping[int, int], where: str | Path | None
) -> tuple[tuple[Closure, ...], tuple[JointSum, ...]]:
    closures, sums = [], []
    for element in loop_elements(model):
        if element.unsupported:
            raise ModelError(f"{element.name}: {element.unsupported} are not supported", where=where)
        if element.points is not None:
            closure = closure_of(element, walk.link_of_body, walk.T_link_body)
            if closure.links[0] != closure.links[1]:
                closures.append(closure)
            continue
        assert element.multiples is not None
        sums.append(
            _sum(element.name, element.joints, element.multiples, element.total, element.total, index, walk)
        )
    for limit in tendon_limits(model):
        if limit.multiples is None:
            raise ModelError(
                f"the limits of {limit.name}: only those of fixed tendons are supported", where=where
            )
        sums.append(_sum(limit.name, limit.joints, limit.multiples, limit.lower, limit.upper, index, walk))
    return tuple(closures), tuple(one for one in sums if one.joints)


def _sum(
    name: str,
    joints: Collection[int],
    multiples: Array,
    lower: float,
    upper: float,
    index: Mapping[int, int],
    walk: _Walk,
) -> JointSum:
    """Joints that stay where they begin go over into the numbers."""
    kept, factors, fixed = [], [], 0.0
    for joint, multiple in zip(joints, multiples, strict=True):
        if joint in index:
            kept.append(index[joint])
            factors.append(float(multiple))
        else:
            fixed += float(multiple) * float(walk._start[walk._model.jnt_qposadr[joint]])
    return JointSum(name, tuple(kept), np.array(factors), lower - fixed, upper - fixed)


def _followers(model: mujoco.MjModel, index: Mapping[int, int]) -> tuple[Follower, ...]:
    held, found = locked_values(model), []
    for joint, known in leaders(model).items():
        if joint not in index or joint in held:
            continue
        for leader, polynomial in known:
            names = [str(model.joint(one).name) for one in (joint, leader)]
            if leader in index:
                found.append(
                    Follower(
                        f"{names[0]} follows {names[1]}",
                        index[joint],
                        index[leader],
                        np.array(polynomial.coef, dtype=float),
                    )
                )
            else:
                value = float(polynomial(float(model.qpos0[model.jnt_qposadr[leader]])))
                found.append(Follower(f"{names[0]} follows {names[1]}", index[joint], -1, np.array([value])))
    return tuple(found)


def _frames(model: mujoco.MjModel, walk: _Walk) -> dict[str, Frame]:
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
