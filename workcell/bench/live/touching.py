"""Contacts as plain MuJoCo finds them: the judge of the live benches, which nothing of live IK has a part in."""

from __future__ import annotations

import copy
from collections.abc import Mapping

import numpy as np

from workcell.model.labels import geom_name
from workcell.model.scene import Scene
from workcell.pose import Array, Pose


class Touching:
    """What some robots of a scene touch, by the collision detection of MuJoCo itself.

    Args:
        scene: the compiled scene.
        names: of its robots, in the order of configurations.
    """

    def __init__(self, scene: Scene, names: tuple[str, ...]) -> None:
        import mujoco

        self._mujoco, self._scene = mujoco, scene
        self._model = copy.copy(scene.model)
        self._model.opt.disableflags &= ~int(mujoco.mjtDisableBit.mjDSBL_CONTACT)
        self._model.geom_margin[:] = 0.0
        self._data = mujoco.MjData(self._model)
        self._data.qpos[:] = scene.initial_qpos()
        self._robots = [scene.robot(name) for name in names]
        own = frozenset[int]().union(*(robot.body_ids for robot in self._robots))
        self._own = np.isin(self._model.geom_bodyid, list(own))

    def place(self, things: Mapping[str, Pose]) -> None:
        """Put objects, by name, where they are."""
        for name, pose in things.items():
            self._scene.object(name).place(self._data.qpos, pose)

    def pairs(self, q: Array) -> set[tuple[str, str]]:
        """Names of geoms that touch, one of them a robot's, at a configuration (n,) of all robots."""
        first = 0
        for robot in self._robots:
            robot.place(self._data.qpos, q[first : first + robot.robot.dof])
            first += robot.robot.dof
        self._mujoco.mj_kinematics(self._model, self._data)
        self._mujoco.mj_comPos(self._model, self._data)
        self._mujoco.mj_collision(self._model, self._data)
        contact = self._data.contact
        met = (contact.dist < 0.0) & self._own[contact.geom].any(axis=1)
        return {
            (geom_name(self._model, int(a)), geom_name(self._model, int(b))) for a, b in contact.geom[met]
        }
