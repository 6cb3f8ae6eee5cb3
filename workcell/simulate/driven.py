"""Objects that a simulation moves along given paths, as a hand or a conveyor would: they yield to nothing."""

from __future__ import annotations

from collections.abc import Callable
from typing import TYPE_CHECKING

import numpy as np

from workcell.errors import InputError
from workcell.model.scene_parts import SceneObject
from workcell.pose import Array, Pose, rotation_vector

if TYPE_CHECKING:
    import mujoco

ObjectPath = Callable[[float], Pose]
"""World pose of an object's root body, seconds after it began to be driven."""


class Driven:
    """The free objects that are driven now.

    Their joints are set before every step, so that what is seen, logged and measured of them is what the path says;
    forces on them do nothing.

    Args:
        timestep: of the simulation, seconds.
    """

    def __init__(self, timestep: float) -> None:
        self._timestep = timestep
        self._paths: dict[str, tuple[SceneObject, ObjectPath, float]] = {}

    def __contains__(self, name: object) -> bool:
        return name in self._paths

    def begin(self, thing: SceneObject, path: ObjectPath, data: mujoco.MjData) -> None:
        """Drive an object from now on; raises InputError for a fixed one, or a path that tells no poses."""
        if thing.qpos_address is None:
            raise InputError(
                f"the object {thing.name!r} is fixed", where="drive", remedy="only free objects can be moved"
            )
        self._paths[thing.name] = (thing, path, float(data.time))
        self.place(data)

    def end(self, name: str) -> None:
        """The object is left to itself, with the velocity that it has."""
        self._paths.pop(name, None)

    def place(self, data: mujoco.MjData) -> None:
        """Set the objects where their paths have them now, and how fast they move there."""
        for name, (thing, path, since) in self._paths.items():
            here = _pose(path, float(data.time) - since, name)
            there = _pose(path, float(data.time) - since + self._timestep, name)
            thing.place(data.qpos, here)
            dof = int(data.model.jnt_dofadr[data.model.body_jntadr[thing.body_id]])
            data.qvel[dof : dof + 6] = _velocity(here, there, self._timestep)


def _pose(path: ObjectPath, t: float, name: str) -> Pose:
    pose = path(t)
    if not isinstance(pose, Pose):
        raise InputError(f"the path of {name!r} tells {type(pose).__name__}", where="drive", remedy="a Pose")
    return pose


def _velocity(here: Pose, there: Pose, dt: float) -> Array:
    """(6,) of a free joint: linear in the world, angular in the body's frame."""
    turned = rotation_vector(here.rotation.T @ there.rotation)
    return np.concatenate([there.position - here.position, turned]) / dt
