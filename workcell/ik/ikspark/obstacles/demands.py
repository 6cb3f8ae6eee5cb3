"""What is demanded of spheres in no region: the question that the perspective relaxation and branching answer."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Protocol

import numpy as np
from numpy.typing import NDArray

from workcell.ik.ikspark.obstacles.regions import Regions
from workcell.ik.ikspark.rank import ConvexSet
from workcell.pose import Array


@dataclass(frozen=True, slots=True, eq=False)
class Point:
    """Where an ascent has ended, as far as obstacles are concerned.

    Attributes:
        centres: (m, 3) of the moving spheres.
        demanded: spheres that are to get rows: those in no region, or those that collide.
        regions: the free space.
        depths: (m, n) metres by which each sphere sticks out of each region; inf where it can't be in it.
        recounted: whether the regions are others than at the last point.
        own: (k, N + 1) rows that keep the robot's own spheres apart, whatever the regions.
    """

    centres: Array
    demanded: NDArray[np.int64]
    regions: Regions
    depths: Array
    recounted: bool
    own: Array

    @property
    def nearest(self) -> NDArray[np.int64]:
        """(m,) the region that each sphere sticks out of least."""
        nearest: NDArray[np.int64] = self.depths.argmin(axis=1)
        return nearest

    @property
    def possible(self) -> bool:
        """Whether every one of them has a region that it may be in."""
        return bool(np.isfinite(self.depths[self.demanded]).any(axis=1).all())


class Demands(Protocol):
    """Decides, over one restart, in which regions spheres have to be."""

    def tightened(self, point: Point) -> ConvexSet | None:
        """A set that `point` is not in; None where there is none."""
        ...
