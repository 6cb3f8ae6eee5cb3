"""`SceneMechanism`: the mechanism of a task, where it begins in the compiled scene, and what of it is watched."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from workcell.errors import InputError, ModelError, UnknownNameError
from workcell.model.loading.taskfile import MechanismEntry
from workcell.model.mechanism.compiled import CompiledMechanism
from workcell.model.mechanism.following import approach, close, given_joints
from workcell.model.mechanism.from_model import mechanism_of
from workcell.model.mechanism.mechanism import WORLD, Mechanism
from workcell.pose import Array, read_only

if TYPE_CHECKING:
    import mujoco

VELOCITY, ACCELERATION = ":velocity", ":acceleration"
"""Suffixes of the `<numeric>` elements that carry a joint's limits, which MJCF itself has no attribute for."""
_FAR = 1e3
"""Metres up to where nothing is met."""


@dataclass(frozen=True, slots=True)
class SceneMechanism:
    """The mechanism of a scene.

    Attributes:
        name: its name in the scene.
        mechanism: all its joints and ties, inside the scene's model.
        start: (size,) its configuration as the scene begins; its ties hold there.
        frames: names of the frames that a run watches: their ways and how far they are from where they should be.
        motors: indices of the joints that motors move, in order; what follows them is not among them.
        velocity, acceleration: (motors,) limits, infinite where the model names none.
    """

    name: str
    mechanism: Mechanism
    start: Array
    frames: tuple[str, ...]
    motors: tuple[int, ...]
    velocity: Array
    acceleration: Array

    @property
    def compiled(self) -> CompiledMechanism:
        """Where it lives in the compiled model."""
        assert self.mechanism.compiled is not None
        return self.mechanism.compiled

    @property
    def body_ids(self) -> frozenset[int]:
        """Ids of the bodies that its joints move."""
        return frozenset(np.flatnonzero(self.compiled.link_of_body != WORLD).tolist())

    @property
    def own_ids(self) -> frozenset[int]:
        """Ids of the bodies that are its own: those that its joints move, and what these stand on but for the world."""
        roots = np.asarray(self.compiled.model.body_rootid)
        return frozenset(np.flatnonzero(np.isin(roots, roots[list(self.body_ids)])).tolist())

    @property
    def motor_addresses(self) -> NDArray[np.int64]:
        """(motors,) where the joints that motors move are in raw positions."""
        values = [self.mechanism.value_slices[k].start for k in self.motors]
        addresses: NDArray[np.int64] = self.compiled.addresses[values]
        return addresses

    @property
    def motor_names(self) -> tuple[str, ...]:
        """Names of the joints that motors move."""
        return tuple(self.mechanism.joints[k].name for k in self.motors)

    def place(self, qpos: Array, q: Array) -> None:
        """Write a configuration (size,) into raw positions (nq,)."""
        qpos[self.compiled.addresses] = q

    def inside(self, model: mujoco.MjModel, qpos: Array) -> SceneMechanism:
        """The same in another copy of the model, all else at raw positions (nq,)."""
        compiled = replace(self.compiled, model=model, start=read_only(qpos))
        return replace(self, mechanism=replace(self.mechanism, compiled=compiled))

    def without(self, bodies: Sequence[str]) -> Mechanism:
        """The mechanism in a scene in which some floating bodies are far away, such as what it carries.

        Raises:
            UnknownNameError: no such body; InputError: one that does not float.
        """
        compiled, start = self.compiled, np.array(self.compiled.start)
        model = compiled.model
        known = {str(model.body(body).name): body for body in range(1, model.nbody)}
        for name in bodies:
            if name not in known:
                raise UnknownNameError("body", name, known, where=self.name)
            joint = int(model.body_jntadr[known[name]])
            if joint < 0 or int(model.jnt_type[joint]) != 0:
                raise InputError(f"the body {name!r} does not float", where=self.name)
            start[model.jnt_qposadr[joint] + 2] += _FAR
        return replace(self.mechanism, compiled=replace(compiled, start=read_only(start)))

    def motor_values(self, q: Array) -> Array:
        """(..., motors) of configurations (..., size)."""
        values: Array = q[..., [self.mechanism.value_slices[k].start for k in self.motors]]
        return values


def scene_mechanism(model: mujoco.MjModel, qpos: Array, entry: MechanismEntry, where: Path) -> SceneMechanism:
    """The mechanism that a task file names, in the compiled scene.

    Args:
        model: the scene's.
        qpos: (nq,) raw positions of everything as the scene begins.
        entry: of the task file.
        where: the task file, for messages.

    Raises:
        ModelError: nothing moves, or its loops can't be closed where it is to begin.
        UnknownNameError: no such joint or frame. InputError: a start that is no configuration.
    """
    named = f"{where}: mechanism {entry.name!r}"
    mechanism = mechanism_of(model, qpos=qpos, moving=entry.joints, name=entry.name, where=named)
    for kind, names, known in (
        ("frame", entry.frames, mechanism.frames),
        ("joint", entry.start, mechanism.joint_index),
    ):
        for name in names:
            if name not in known:
                raise UnknownNameError(kind, name, known, where=named)
    begin = mechanism.configuration(dict(entry.start), where=f"{named} start")
    found = close(mechanism, begin)
    if not found.is_closed or found.yielded:
        found = approach(mechanism, mechanism.home, begin)
    if not found.is_closed:
        raise ModelError(
            f"it can't be closed where it starts: {1e3 * found.missed:.3g} mm (mrad) are missing",
            where=named,
            remedy="give a start near a configuration in which its ties hold",
        )
    motors = given_joints(mechanism)
    driven = [mechanism.joints[k].name for k in motors]
    return SceneMechanism(
        entry.name,
        mechanism,
        read_only(found.q),
        entry.frames,
        motors,
        read_only(_limits(model, driven, VELOCITY, named)),
        read_only(_limits(model, driven, ACCELERATION, named)),
    )


def _limits(model: mujoco.MjModel, joints: list[str], suffix: str, where: str) -> Array:
    known: Mapping[str, Any] = {model.numeric(k).name: k for k in range(model.nnumeric)}
    values = []
    for name in joints:
        numeric = known.get(name + suffix)
        value = np.inf if numeric is None else float(model.numeric_data[model.numeric_adr[numeric]])
        if not value > 0:
            raise ModelError(
                f"the limit {name + suffix!r} is {value:g}", where=where, remedy="a positive number"
            )
        values.append(value)
    return np.array(values)
