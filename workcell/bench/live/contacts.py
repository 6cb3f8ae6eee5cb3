"""The compiled model's distances at configurations of all arms of a scene, with other things where told."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np

from workcell.bench.live.arms import Arms
from workcell.model.collision_model import CollisionModel
from workcell.model.scene import Scene
from workcell.pose import Array, Pose

LIMIT = 0.05
"""Metres beyond which distances count as this."""


class Contacts:
    """The least distance of a scene's robots to themselves, each other and everything else.

    Args:
        scene: the compiled scene.
        names: of its robots, in the order of configurations.
        own: whether an arm's distances to itself count.
        limit: metres beyond which distances count as this.
    """

    def __init__(
        self, scene: Scene, names: tuple[str, ...], *, own: bool = True, limit: float = LIMIT
    ) -> None:
        self._scene, self._limit = scene, limit
        models = [CollisionModel(scene, name) for name in names]
        self._models = models if own else [model.without_own() for model in models]
        self._robots = [scene.robot(name) for name in names]
        self._to: dict[str, list[CollisionModel]] = {}
        self._qpos = np.array(scene.initial_qpos())

    def place(self, things: Mapping[str, Pose]) -> None:
        """Put objects, by name, where they are."""
        for name, pose in things.items():
            self._scene.object(name).place(self._qpos, pose)

    def distance(self, q: Array, arm: int | None = None) -> float:
        """Metres at a configuration (n,) of all arms, negative where something touches; of one arm, or of all."""
        return self._least(q, self._models if arm is None else [self._models[arm]])

    def distance_to(self, name: str, q: Array) -> float:
        """Metres from all arms at a configuration (n,) to one object."""
        if name not in self._to:
            bodies = self._scene.object(name).body_ids
            self._to[name] = [
                model.between(robot.body_ids, bodies)
                for model, robot in zip(self._models, self._robots, strict=True)
            ]
        return self._least(q, self._to[name])

    def _least(self, q: Array, models: list[CollisionModel]) -> float:
        first = 0
        for robot in self._robots:
            robot.place(self._qpos, q[first : first + robot.robot.dof])
            first += robot.robot.dof
        return min(model.distance_at(self._qpos, limit=self._limit).distance for model in models)


class OwnContacts(Contacts):
    """Distances of arms that stand alone, or two by two: what the paper calls self-collision."""

    def __init__(self, arms: Arms) -> None:
        super().__init__(arms.scene, arms.names)

    def least(self, way: Array, arm: int | None = None) -> float:
        """Of configurations (k, n)."""
        return min(self.distance(q, arm) for q in way)
