"""Which contacts are intended: everything else that touches a robot, or what it carries, is reported."""

from __future__ import annotations

from collections.abc import Iterable
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from workcell.model.judge.pairs import colliding_pairs
from workcell.model.labels import geom_name
from workcell.model.loops.elements import joined
from workcell.model.scene_parts import SceneObject

if TYPE_CHECKING:
    import mujoco


class ContactRules:
    """Intended and unintended contacts of the robots, by geom; what counts changes with a grasp.

    Args:
        model: the compiled model.
        bodies: ids of the robots' bodies.
    """

    def __init__(self, model: mujoco.MjModel, bodies: Iterable[int]) -> None:
        bodies = list(bodies)
        self._model = model
        self._moving = np.isin(model.geom_bodyid, bodies)
        self._intended = np.zeros((model.ngeom, model.ngeom), dtype=bool)
        pairs = colliding_pairs(model, bodies)
        self.intend((int(a), int(b)) for a, b in pairs[joined(model, pairs)])

    def geoms(self, bodies: Iterable[int]) -> NDArray[np.int64]:
        """Ids of the geoms of these bodies."""
        return np.flatnonzero(np.isin(self._model.geom_bodyid, list(bodies)))

    def intend(self, pairs: Iterable[tuple[int, int]], intended: bool = True) -> None:
        """Say whether contact between pairs of geoms is intended."""
        for a, b in pairs:
            self._intended[a, b] = self._intended[b, a] = intended

    def watch(self, thing: SceneObject, carried: bool) -> None:
        """Count an object as part of a robot, or no longer."""
        self._moving[self.geoms(thing.body_ids)] = carried

    def unintended(self, data: mujoco.MjData) -> list[tuple[tuple[str, str], float]]:
        """Names and depths (metres) of the unintended contacts in `data`."""
        if data.ncon == 0:
            return []
        pairs, depth = data.contact.geom, -data.contact.dist
        a, b = pairs[:, 0], pairs[:, 1]
        known = (a >= 0) & (b >= 0)
        bad = known & (depth > 0) & (self._moving[a] | self._moving[b]) & ~self._intended[a, b]
        return [
            ((geom_name(self._model, int(a[k])), geom_name(self._model, int(b[k]))), float(depth[k]))
            for k in np.flatnonzero(bad)
        ]

    def touching(self, data: mujoco.MjData, first: Iterable[int], second: Iterable[int]) -> bool:
        """Whether any geom of the first set touches one of the second."""
        return bool(self._touches(data, first, second).any())

    def touched_by(self, data: mujoco.MjData, geoms: Iterable[int]) -> frozenset[int]:
        """The geoms, not of the robots, that touch any of these."""
        mine = np.array(list(geoms), dtype=int)
        found: set[int] = set()
        for a, b in data.contact.geom:
            for x, y in ((int(a), int(b)), (int(b), int(a))):
                if x in mine and y >= 0 and y not in mine and not self._moving[y]:
                    found.add(y)
        return frozenset(found)

    def _touches(self, data: mujoco.MjData, first: Iterable[int], second: Iterable[int]) -> NDArray[np.bool_]:
        pairs = data.contact.geom
        a, b = list(first), list(second)
        one = np.isin(pairs[:, 0], a) & np.isin(pairs[:, 1], b)
        other = np.isin(pairs[:, 0], b) & np.isin(pairs[:, 1], a)
        touches: NDArray[np.bool_] = (one | other) & (data.contact.dist <= 0)
        return touches
