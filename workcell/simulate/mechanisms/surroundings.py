"""What a mechanism may touch, and how close it is to everything else, while it moves."""

from __future__ import annotations

from collections.abc import Iterable
from typing import TYPE_CHECKING

import numpy as np

from workcell.model.judge.distances import judge_model
from workcell.model.judge.nearest import Distance, NearestPair
from workcell.model.labels import geom_name, geoms_called
from workcell.model.mechanism.measuring import MechanismMeasure
from workcell.model.scene_mechanism import SceneMechanism
from workcell.pose import Array
from workcell.simulate.contact_rules import ContactRules

if TYPE_CHECKING:
    import mujoco

Names = tuple[str, str]
"""Of two geoms."""


class Surroundings:
    """The contact guard and the clearance measure of a mechanism.

    Args:
        moving: the mechanism in its scene.
        model, data: the simulated ones.
    """

    def __init__(self, moving: SceneMechanism, model: mujoco.MjModel, data: mujoco.MjData) -> None:
        import mujoco

        self._mujoco, self._model, self._data = mujoco, model, data
        self._moving = moving
        self._rules = ContactRules(model, moving.body_ids)
        self._judge = judge_model(moving.compiled.model)
        self._nearest = NearestPair(self._judge)
        self._placed = mujoco.MjData(self._judge.model)
        self._own = np.isin(model.geom_bodyid, list(moving.body_ids))
        self._pairs = MechanismMeasure(moving.mechanism).pairs
        self.touching: frozenset[Names] = frozenset()

    def expect(self, pairs: Iterable[Names]) -> None:
        """These pairs of geoms (names) may touch from now on; raises UnknownNameError."""
        names = list(pairs)
        for pair in names:
            first, second = geoms_called(self._model, pair, "touching")
            self._rules.intend([(int(first), int(second))])
        self.touching = self.touching.union(names)
        self._pairs = MechanismMeasure(self._moving.mechanism, tuple(self.touching)).pairs

    @property
    def looks_at_nothing(self) -> bool:
        """Whether no two geoms could meet that should not."""
        return len(self._pairs) == 0

    def clearance(self, qpos: Array) -> Distance:
        """Smallest signed distance to all that should not be touched, at raw positions (nq,); nan: there is nothing."""
        if self.looks_at_nothing:
            return Distance(np.nan, ("", ""), np.full((2, 3), np.nan))
        self._placed.qpos[:] = qpos
        self._mujoco.mj_kinematics(self._judge.model, self._placed)
        return self._nearest(self._placed, self._pairs, 1.0)

    def unintended(self) -> list[tuple[Names, float]]:
        """Names and depths (metres) of the unintended contacts now."""
        return self._rules.unintended(self._data)

    def touched(self) -> dict[Names, float]:
        """What the mechanism touches now: names of its geom and the other, and the normal force between them (N)."""
        found: dict[Names, float] = {}
        force, data = np.zeros(6), self._data
        for k in range(data.ncon):
            a, b = (int(geom) for geom in data.contact.geom[k])
            if min(a, b) < 0 or not (self._own[a] or self._own[b]) or data.contact.dist[k] > 0:
                continue
            self._mujoco.mj_contactForce(self._model, data, k, force)
            first, second = (a, b) if self._own[a] else (b, a)
            names = geom_name(self._model, first), geom_name(self._model, second)
            found[names] = found.get(names, 0.0) + float(force[0])
        return found
