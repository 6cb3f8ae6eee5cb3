"""The nearest of many pairs of geoms: bounds first, distances where they leave it open.

Deep penetration is measured poorly by MuJoCo for some pairs of shapes: trust the sign, not the depth.
"""

from __future__ import annotations

import functools
import importlib
from collections.abc import Iterable
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from workcell.errors import ModelError
from workcell.model.judge.contacts import deepest_contact
from workcell.model.judge.distances import JudgeModel
from workcell.model.judge.solids import SIGNED_FIELD
from workcell.model.labels import geom_name
from workcell.pose import Array

if TYPE_CHECKING:
    import mujoco


@dataclass(frozen=True, slots=True)
class Distance:
    """A signed distance in metres, the two geoms' names, the nearest points (2, 3) in the world, and the geoms' ids.

    Where no pair is within the limit of a search, the names are empty, the ids -1, and the distance is the limit. Where
    there is no such configuration of the mechanism, `reason` says why, and the distance is negative.
    """

    distance: float
    pair: tuple[str, str]
    points: Array
    geoms: tuple[int, int] = (-1, -1)
    reason: str = ""


class NearestPair:
    """Looks for the nearest pair of geoms; whoever calls it has placed them in `data`.

    Args:
        judge: the judge's copy of the model.
    """

    def __init__(self, judge: JudgeModel) -> None:
        self._judge = judge
        self._pad = judge.model.geom_rbound.copy()
        self._pad[self._pad == 0.0] = np.inf
        self._boxes = judge.model.geom_aabb.copy()
        self._boxes[np.isinf(self._pad), 3:] = np.inf
        self._fromto = np.zeros(6)

    def __call__(self, data: mujoco.MjData, pairs: NDArray[np.int64], limit: float) -> Distance:
        """The smallest signed distance of some pairs (p, 2), looked for up to `limit` metres."""
        best, nearest, points = limit, (-1, -1), np.zeros((2, 3))
        if len(pairs) == 0:
            return Distance(limit, ("", ""), points)
        near, bounds = self._lower_bounds(data, pairs, limit, 0.0)
        for k in np.argsort(bounds):
            if bounds[k] >= best:
                break
            a, b = (int(g) for g in pairs[near[k]])
            distance = self._judge.distance(data, a, b, max(best, 0.0), self._fromto)
            if distance < best:
                best, nearest = distance, (a, b)
                points = self._fromto.reshape(2, 3).copy()
        return Distance(float(best), self._names(nearest), points, nearest)

    def excess(
        self, data: mujoco.MjData, pairs: NDArray[np.int64], motion: Array, limit: float
    ) -> tuple[float, Distance]:
        """The least of distance minus `motion` (p,) metres, and the distance of the pair that has it."""
        least, nearest, distance, points = limit, (-1, -1), limit, np.zeros((2, 3))
        if len(pairs) == 0:
            return least, Distance(distance, ("", ""), points)
        near, bounds = self._lower_bounds(data, pairs, limit, motion)
        for k in np.argsort(bounds):
            if bounds[k] >= least:
                break
            (a, b), lost = (int(g) for g in pairs[near[k]]), float(motion[near[k]])
            found = self._judge.distance(data, a, b, max(least + lost, 0.0), self._fromto)
            if found - lost < least:
                least, nearest, distance = found - lost, (a, b), found
                points = self._fromto.reshape(2, 3).copy()
        return float(least), Distance(float(distance), self._names(nearest), points, nearest)

    def contact(self, data: mujoco.MjData, pairs: NDArray[np.int64]) -> Distance | None:
        """What MuJoCo's own collision pipeline has in contact, deeper than distances may be off; None: nothing."""
        found = deepest_contact(self._judge, data, pairs)
        return None if found is None else Distance(found[0], self._names(found[1]), found[2], found[1])

    def _names(self, pair: tuple[int, int]) -> tuple[str, str]:
        first, second = pair
        model = self._judge.model
        return (geom_name(model, first), geom_name(model, second)) if first >= 0 else ("", "")

    def _lower_bounds(
        self, data: mujoco.MjData, pairs: NDArray[np.int64], limit: float, motion: Array | float
    ) -> tuple[NDArray[np.int64], Array]:
        """The pairs that may have the smallest distance less motion, and lower bounds of it.

        They come from bounding spheres and boxes. Two bounding spheres give a bound that holds for overlapping geoms
        too; planes have none. The distance between one geom's bounding sphere and the other's bounding box is often
        larger (a board's sphere is huge); it counts where it is positive. The distance of two centres, which lie
        inside their convex geoms, is an upper bound.

        Args:
            data: with its geoms placed.
            pairs: (p, 2).
            limit: metres; larger values are of no interest.
            motion: (p,) metres to subtract from the distance of each pair, or 0.

        Returns:
            (k,) rows of the pairs and (k,) bounds.
        """
        count = len(pairs)
        rows, bounds = np.empty(count, dtype=np.int64), np.empty(count)
        moved = np.full(count, motion) if np.ndim(motion) == 0 else np.ascontiguousarray(motion)
        near = _kernels().lower_bounds(
            data.geom_xpos,
            data.geom_xmat,
            self._pad,
            self._boxes,
            pairs,
            moved,
            float(limit),
            rows,
            bounds,
        )
        return rows[:near], bounds[:near]


@functools.cache
def _kernels() -> Any:
    """Compiled kernels, imported on first use: numba takes half a second."""
    return importlib.import_module("workcell.model.pair_bounds")


def refuse_unmeasured(model: mujoco.MjModel, geoms: Iterable[int]) -> None:
    """Raise ModelError for what has no distance that can be trusted, of these geoms."""
    for geom in geoms:
        if model.geom_type[geom] == SIGNED_FIELD:
            raise ModelError(
                "distances to a geom of type sdf can't be trusted",
                where=geom_name(model, geom),
                remedy="use box, sphere, capsule, cylinder, ellipsoid, plane, mesh or hfield",
            )
    if model.nflex:
        raise ModelError("deformable bodies (flex) are not supported as obstacles", where=model.flex(0).name)
