"""What the robots may touch, what they hold, and how close they are to everything else, while a simulation runs."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import dataclass, replace
from itertools import product
from typing import TYPE_CHECKING, Literal

import numpy as np

from workcell.errors import UnknownNameError
from workcell.model.collision_model import CollisionModel
from workcell.model.judge.distances import judge_model
from workcell.model.judge.nearest import Distance
from workcell.model.scene import Scene
from workcell.model.scene_parts import SceneObject, SceneRobot
from workcell.pose import Array, Pose
from workcell.simulate.contact_rules import ContactRules
from workcell.simulate.grasp import Weld

if TYPE_CHECKING:
    import mujoco

Hold = Literal["weld", "friction"]
Pair = tuple[int, int]
"""Ids of two geoms, the smaller first."""

_LIFTED = 1e-3
"""Metres above what it stood on, at which an object counts as lifted."""
_SLIPPING = 1e-3
"""Metres of slip that are worth a line in the log."""
_LOST: dict[Hold, float] = {"weld": 2e-3, "friction": 6e-3}
"""Metres of slip at which an object counts as lost: a weld does not give, rubber does a little."""


@dataclass(frozen=True, slots=True)
class Held:
    """What a hand holds, how it held it at the grasp, the geoms that the object then stood on, and whether it slips."""

    thing: SceneObject
    weld: Weld
    T_hand_object: Pose
    T_tool_object: Pose
    supports: frozenset[int]
    hold: Hold = "weld"
    slipping: bool = False

    @property
    def may_slip(self) -> float:
        """Metres that the object may move in the hand before it counts as lost."""
        return _LOST[self.hold]


class Watch:
    """Keeps the contact guard and the clearance measure in step with what the robots hold and may touch.

    Args:
        scene: the scene.
        robots: whose surroundings are watched, each other included.
        model, data: the simulated ones.

    Attributes:
        held: what each hand holds, by the robot's name.
    """

    def __init__(
        self, scene: Scene, robots: Sequence[SceneRobot], model: mujoco.MjModel, data: mujoco.MjData
    ) -> None:
        self._judge = judge_model(scene.model)
        self._scene, self._robots, self._model, self._data = scene, tuple(robots), model, data
        self._rules = ContactRules(model, frozenset[int]().union(*(robot.body_ids for robot in robots)))
        self._expected: set[Pair] = set()
        self._until_lifted: set[Pair] = set()
        self._until_parted: dict[tuple[str, str], set[Pair]] = {}
        self._collision = [CollisionModel(scene, robot.name) for robot in robots]
        self.held: dict[str, Held] = {}

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

    @property
    def looks_at_nothing(self) -> bool:
        """Whether no two geoms could meet that should not: then there is no clearance, and no contact to guard."""
        return not any(len(model.pair_geoms) for model in self._collision)

    def clearance(self, qpos: Array) -> Distance:
        """Smallest signed distance to all that should not be touched, at raw positions (nq,); nan: there is nothing."""
        if self.looks_at_nothing:
            return Distance(np.nan, ("", ""), np.full((2, 3), np.nan))
        found = (model.distance_at(qpos, limit=1.0) for model in self._collision)
        return min(found, key=lambda distance: distance.distance)

    def unintended(self) -> list[tuple[tuple[str, str], float]]:
        """Names and depths (metres) of the unintended contacts now."""
        return self._rules.unintended(self._data)

    def touching(self, first: Iterable[int], second: Iterable[int]) -> bool:
        """Whether a geom of the first set touches one of the second now."""
        return self._rules.touching(self._data, first, second)

    def touched_by(self, geoms: Iterable[int]) -> frozenset[int]:
        """Geoms, not of the robots, that touch any of these now."""
        return self._rules.touched_by(self._data, geoms)

    def slip(self, held: Held) -> float:
        """How far any point of a held object has moved in the hand since the grasp, metres."""
        return held.weld.slip(self._data, held.T_hand_object)

    def shared(self) -> list[Held]:
        """The grasps of an object that several hands hold; empty without one."""
        names = [held.thing.name for held in self.held.values()]
        return [held for held in self.held.values() if names.count(held.thing.name) > 1]

    def bounds(self, bodies: Iterable[int]) -> Array:
        """(2, 3) corners of the axis-aligned box around all geoms of some bodies, now."""
        lower, upper = np.full(3, np.inf), np.full(3, -np.inf)
        for geom in self.geoms(bodies):
            centre, half = self._model.geom_aabb[geom, :3], self._model.geom_aabb[geom, 3:]
            R = self._data.geom_xmat[geom].reshape(3, 3)
            middle, reach = self._data.geom_xpos[geom] + R @ centre, np.abs(R) @ half
            lower, upper = np.minimum(lower, middle - reach), np.maximum(upper, middle + reach)
        return np.stack([lower, upper])

    @property
    def expected(self) -> frozenset[Pair]:
        """Pairs of geoms that may touch now."""
        return frozenset(self._expected)

    # ---- what changes it ----------------------------------------------------------------------------------------

    def expect(self, first: Iterable[int], second: Iterable[int]) -> None:
        """Contact between two sets of geoms is intended from now on, to the guard and to the clearance alike."""
        pairs = _pairs(first, second)
        self._until_lifted -= pairs
        self._until_parted = {key: left for key, left in self._until_parted.items() if not left & pairs}
        self._change(pairs, True)

    def _change(self, pairs: set[Pair], expected: bool) -> None:
        self._rules.intend(pairs, expected)
        self._expected = self._expected | pairs if expected else self._expected - pairs
        self._rebuild()

    def take(self, robot: str, held: Held) -> None:
        """An object is part of the robot now; until it is lifted it may touch what it stands on."""
        self.held[robot] = held
        self._rules.watch(held.thing, carried=True)
        standing = _pairs(self.geoms(held.thing.body_ids), held.supports) - self._expected
        self._until_lifted |= standing
        self._change(standing, True)

    def let_go(self, robot: str) -> None:
        """The robot's hand is empty again; it may touch what it held until it has left that."""
        left = self.held.pop(robot, None)
        if left is not None:
            still = any(held.thing is left.thing for held in self.held.values())
            self._rules.watch(left.thing, carried=still)
            geoms = self.geoms(self._scene.robot(robot).hand_ids)
            self._until_parted[robot, left.thing.name] = _pairs(geoms, self.geoms(left.thing.body_ids))
            self._rebuild()

    def notice_parting(self) -> None:
        """Hands that have left what they let go of must not touch it again."""
        for key, pairs in list(self._until_parted.items()):
            if not self._near(pairs):
                del self._until_parted[key]
                self._change(pairs, False)

    def notice_lift(self) -> list[str]:
        """Names of the held objects that have just left what they stood on; touching that again is unintended."""
        lifted = []
        for robot, held in list(self.held.items()):
            mine = self.geoms(held.thing.body_ids)
            standing = _pairs(mine, held.supports)
            if not standing or self._near(standing):
                continue
            self.held[robot] = replace(held, supports=frozenset())
            self._change(standing & self._until_lifted, False)
            self._until_lifted -= standing
            lifted.append(held.thing.name)
        return list(dict.fromkeys(lifted))

    def notice_slip(self) -> list[tuple[str, float]]:
        """Names and metres of the objects that have just begun to slip in a hand that holds them by friction."""
        found = []
        for robot, held in list(self.held.items()):
            slip = self.slip(held)
            if held.hold == "friction" and not held.slipping and slip > _SLIPPING:
                self.held[robot] = replace(held, slipping=True)
                found.append((held.thing.name, slip))
        return found

    def _near(self, pairs: Iterable[Pair]) -> bool:
        return any(self._judge.distance(self._data, a, b, 2 * _LIFTED) <= _LIFTED for a, b in pairs)

    def _rebuild(self) -> None:
        attached = {name: (held.thing.name, held.T_tool_object) for name, held in self.held.items()}
        self._collision = [
            CollisionModel(
                self._scene,
                robot.name,
                qpos=self._data.qpos,
                attached=attached.get(robot.name),
                allowed_geoms=self._expected,
            )
            for robot in self._robots
        ]


def _pairs(first: Iterable[int], second: Iterable[int]) -> set[Pair]:
    return {(min(a, b), max(a, b)) for a, b in product(first, second)}
