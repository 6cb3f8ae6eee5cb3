"""From shares of several regions to one region a sphere: which spheres get rows, and which region is theirs.

Rank 1 does not make the deltas of (69) whole: a sphere may be between two regions, in the hull of both. Such a sphere
is put into the region that has the largest share of it, for the rest of the restart.
"""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray

from workcell.ik.ikspark.obstacles.cuboids import CuboidSet, Home
from workcell.ik.shared.convex import KEEP_OFF
from workcell.pose import Array


@dataclass(slots=True)
class Rounding:
    """What one restart has decided.

    Attributes:
        maps: (m, 3, N + 1) centres of the moving spheres over (x, 1).
        needed: (m,) what they keep from the faces of regions.
        relaxed: spheres that share themselves out among all their regions.
        fixed: for others, the one region that is theirs.
    """

    maps: Array
    needed: Array
    relaxed: list[int] = field(default_factory=list)
    fixed: dict[int, int] = field(default_factory=dict)

    def forget_regions(self) -> None:
        """Regions are counted anew: no sphere has one of its own any more."""
        self.relaxed += [j for j in self.fixed if j not in self.relaxed]
        self.fixed.clear()

    def demand(self, outside: NDArray[np.int64], depths: Array, last: CuboidSet | None) -> None:
        """Rows for spheres that are in no region: relaxed at first, then with one region.

        Args:
            outside: the spheres.
            depths: (m, n) metres that each sticks out of each region; inf: it can't be in it.
            last: the set that the point is of, None where that had no rows.
        """
        shares = {} if last is None else last.best()
        for j in outside.tolist():
            if j in self.fixed or (j in self.relaxed and j not in shares):
                self.fixed[j] = int(depths[j].argmin())
            elif j in self.relaxed:
                self.relaxed.remove(j)
                self.fixed[j] = shares[j]
            else:
                self.relaxed.append(j)

    def homes(self, allowed: NDArray[np.bool_]) -> list[Home]:
        """The spheres with rows, with what of `allowed` (m, n) each may be in; empty: one of them has nothing."""
        chosen = {j: tuple(np.flatnonzero(allowed[j]).tolist()) for j in self.relaxed}
        chosen |= {j: (region,) for j, region in self.fixed.items() if allowed[j, region]}
        if not all(chosen.get(j) for j in (*self.relaxed, *self.fixed)):
            return []
        return [
            Home(j, self.maps[j], float(self.needed[j]) + KEEP_OFF, regions) for j, regions in chosen.items()
        ]
