"""What the robot may touch, what it holds, and how close it is to everything else, while a simulation runs."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING

import numpy as np

from workcell.errors import UnknownNameError
from workcell.model.contact import CollisionModel, Distance
from workcell.model.scene import Scene, SceneObject, SceneRobot
from workcell.pose import Array, Pose
from workcell.simulate.contacts import ContactRules
from workcell.simulate.grasp import Weld

if TYPE_CHECKING:
    import mujoco

_LIFTED = 1e-3
"""Metres above what it stood on, at which an object counts as lifted."""


@dataclass(frozen=True, slots=True)
class Held:
    """What the hand holds, how it held it at the grasp, and the geoms that the object then stood on."""

    thing: SceneObject
    weld: Weld
    T_hand_object: Pose
    T_tool_object: Pose
    supports: frozenset[int]


class Watch:
    """Keeps the contact guard and the clearance measure in step with what the robot holds and may touch.

    Args:
        scene: the scene.
        robot: whose surroundings are watched.
        model, data: the simulated ones.

    Attributes:
        held: what the hand holds, or None.
    """

    def __init__(self, scene: Scene, robot: SceneRobot, model: mujoco.MjModel, data: mujoco.MjData) -> None:
        import mujoco

        self._distance = mujoco.mj_geomDistance
        self._scene, self._robot, self._model, self._data = scene, robot, model, data
        self._rules = ContactRules(model, robot)
        self._expected: set[tuple[int, int]] = set()
        self._collision = CollisionModel(scene, robot.name)
        self.held: Held | None = None

    # ---- what is asked of it ------------------------------------------------------------------------------------

    def geoms_of(self, name: str) -> tuple[int, ...]:
        """Geom ids of an object; raises UnknownNameError."""
        return self.geoms(self._scene.object(name).body_ids)

    def geoms(self, bodies: Iterable[int]) -> tuple[int, ...]:
        """Geom ids of some bodies."""
        return tuple(int(g) for g in self._rules.geoms(bodies))

    def body(self, name: str) -> int:
        """Id of a body; raises UnknownNameError."""
        names = [self._model.body(b).name for b in range(self._model.nbody)]
        if name not in names:
            raise UnknownNameError("body", name, names, where=self._scene.path)
        return names.index(name)

    def clearance(self, qpos: Array) -> Distance:
        """Smallest signed distance to all that should not be touched, at raw positions (nq,)."""
        return self._collision.distance_at(qpos, limit=1.0)

    def unintended(self) -> list[tuple[tuple[str, str], float]]:
        """Names and depths (metres) of the unintended contacts now."""
        return self._rules.unintended(self._data)

    def touching(self, first: Iterable[int], second: Iterable[int]) -> bool:
        """Whether a geom of the first set touches one of the second now."""
        return self._rules.touching(self._data, first, second)

    def touched_by(self, geoms: Iterable[int]) -> frozenset[int]:
        """Geoms, not of the robot, that touch any of these now."""
        return self._rules.touched_by(self._data, geoms)

    def slip(self) -> float:
        """How far the held object has moved in the hand since the grasp, metres; 0 without one."""
        return 0.0 if self.held is None else self.held.weld.slip(self._data, self.held.T_hand_object)

    def bounds(self, bodies: Iterable[int]) -> Array:
        """(2, 3) corners of the axis-aligned box around all geoms of some bodies, now."""
        lower, upper = np.full(3, np.inf), np.full(3, -np.inf)
        for geom in self.geoms(bodies):
            centre, half = self._model.geom_aabb[geom, :3], self._model.geom_aabb[geom, 3:]
            R = self._data.geom_xmat[geom].reshape(3, 3)
            middle, reach = self._data.geom_xpos[geom] + R @ centre, np.abs(R) @ half
            lower, upper = np.minimum(lower, middle - reach), np.maximum(upper, middle + reach)
        return np.stack([lower, upper])

    # ---- what changes it ----------------------------------------------------------------------------------------

    def expect(self, first: Iterable[int], second: Iterable[int], expected: bool = True) -> None:
        """Say whether contact between two sets of geoms is intended, to the guard and to the clearance alike."""
        a, b = list(first), list(second)
        self._rules.intend(a, b, expected)
        pairs = {(x, y) for x in a for y in b}
        self._expected = self._expected | pairs if expected else self._expected - pairs
        self._rebuild()

    def take(self, held: Held) -> None:
        """An object is part of the robot now; until it is lifted it may touch what it stands on."""
        self.held = held
        self._rules.watch(held.thing, carried=True)
        self.expect(self.geoms(held.thing.body_ids), held.supports)

    def let_go(self) -> None:
        """The hand is empty again."""
        if self.held is not None:
            self._rules.watch(self.held.thing, carried=False)
            self.held = None
            self._rebuild()

    def notice_lift(self) -> bool:
        """Whether the held object has just left what it stood on; touching that again is unintended."""
        held = self.held
        if held is None or not held.supports:
            return False
        mine = self.geoms(held.thing.body_ids)
        if any(
            self._distance(self._model, self._data, geom, support, 2 * _LIFTED, None) <= _LIFTED
            for geom in mine
            for support in held.supports
        ):
            return False
        self.held = replace(held, supports=frozenset())
        self.expect(mine, held.supports, expected=False)
        return True

    def _rebuild(self) -> None:
        held = self.held
        self._collision = CollisionModel(
            self._scene,
            self._robot.name,
            qpos=self._data.qpos,
            attached=None if held is None else (held.thing.name, held.T_tool_object),
            allowed_geoms=self._expected,
        )
