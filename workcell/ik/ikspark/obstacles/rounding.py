"""The perspective relaxation for spheres in no region, and its rounding to one region a sphere.

Rank 1 does not make the deltas of (69) whole: a sphere may be between two regions, in the hull of both. Such a sphere
is put into the region that has the largest share of it, for the rest of the restart.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from workcell.ik.ikspark.obstacles.branching import Instances
from workcell.ik.ikspark.obstacles.cuboids import CuboidSet, Home
from workcell.ik.ikspark.obstacles.demands import Point
from workcell.ik.ikspark.rank import ConvexSet
from workcell.ik.shared.convex import KEEP_OFF
from workcell.pose import Array


class Rounding:
    """What one restart has decided: who is shared out among all regions, and who has one."""

    def __init__(self, instances: Instances, maps: Array, needed: Array) -> None:
        """`maps` (m, 3, N + 1): centres of the moving spheres over (x, 1); `needed` (m,) metres off faces."""
        self._instances, self._maps, self._needed = instances, maps, needed
        self._relaxed: list[int] = []
        self._fixed: dict[int, int] = {}
        self._set: CuboidSet | None = None

    def tightened(self, point: Point) -> ConvexSet | None:
        """The relaxation with rows for those spheres, and those before them; None: one of them has no region."""
        if not point.possible:
            return None
        if point.recounted:
            self._relaxed += self._fixed
            self._fixed.clear()
            self._set = None
        self._decide(point)
        homes = self._homes(np.isfinite(point.depths))
        self._set = None
        if homes is None:
            return None
        relaxation = self._instances.with_rows(point.own)
        if not homes:
            return relaxation
        self._set = CuboidSet(relaxation, point.regions, homes)
        return self._set

    def _decide(self, point: Point) -> None:
        """Who is outside for the first time is shared out; who is so again is put into one region."""
        shares = {} if self._set is None else self._set.best()
        for j in point.demanded.tolist():
            if j in self._fixed:
                self._fixed[j] = int(point.nearest[j])
            elif j in self._relaxed:
                self._relaxed.remove(j)
                self._fixed[j] = shares.get(j, int(point.nearest[j]))
            else:
                self._relaxed.append(j)

    def _homes(self, allowed: NDArray[np.bool_]) -> list[Home] | None:
        """The spheres with rows and their regions; None: one of them has none."""
        chosen = {j: tuple(np.flatnonzero(allowed[j]).tolist()) for j in self._relaxed}
        chosen |= {j: (region,) for j, region in self._fixed.items()}
        if not all(chosen.values()):
            return None
        return [
            Home(j, self._maps[j], float(self._needed[j]) + KEEP_OFF, regions)
            for j, regions in chosen.items()
        ]
