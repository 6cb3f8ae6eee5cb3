"""One region for every sphere that is in none, and of its faces those that are violated: branching, lazily.

The branch of (71) in which delta is one for the region that a sphere sticks out of least. A face enters when a point
violates it, as a half-space of the plain relaxation, whose solvers are kept from query to query.
"""

from __future__ import annotations

from contextlib import ExitStack

import numpy as np

from workcell.ik.ikspark.instance import Instance, instance_of
from workcell.ik.ikspark.obstacles.demands import Point
from workcell.ik.ikspark.obstacles.regions import Regions
from workcell.ik.problem import IKProblem
from workcell.ik.shared.convex import KEEP_OFF
from workcell.pose import Array

SLOTS = 24
"""Faces that one ascent may carry."""


class Instances:
    """A problem's relaxation with room for half-spaces, one for each number of slots that was needed."""

    def __init__(self, problem: IKProblem, stack: ExitStack) -> None:
        self._problem, self._stack = problem, stack
        self._instances: dict[int, Instance] = {}

    def with_rows(self, rows: Array) -> Instance:
        """The relaxation with `rows (x, 1) >= 0`, rows (k, N + 1); slots come in fours, for empty ones cost time."""
        slots = 4 * -(-len(rows) // 4)
        if slots not in self._instances:
            self._instances[slots] = self._stack.enter_context(instance_of(self._problem, halfspaces=slots))
        self._instances[slots].set_halfspaces(rows)
        return self._instances[slots]


class Branch:
    """What one restart has decided: which region is a sphere's own, and which faces it is kept behind."""

    def __init__(self, instances: Instances, maps: Array, needed: Array) -> None:
        """`maps` (m, 3, N + 1): centres of the moving spheres over (x, 1); `needed` (m,) metres off faces."""
        self._instances, self._maps, self._needed = instances, maps, needed
        self._region: dict[int, int] = {}
        self._rows = np.zeros((0, maps.shape[-1]))
        self._owner = np.zeros(0, dtype=np.int64)

    def tightened(self, point: Point) -> Instance | None:
        """The relaxation with the faces that those spheres violate; None: one of them has no region."""
        if not point.possible:
            return None
        if point.recounted:
            self._region.clear()
            self._rows, self._owner = self._rows[:0], self._owner[:0]
        nearest = point.nearest
        for j in point.demanded.tolist():
            region = int(nearest[j])
            if self._region.get(j, region) != region:
                kept = self._owner != j
                self._rows, self._owner = self._rows[kept], self._owner[kept]
            self._region[j] = region
            self._add(j, point.centres[j], point.regions, region)
        self._rows, self._owner = self._rows[-SLOTS:], self._owner[-SLOTS:]
        return self._instances.with_rows(np.vstack([self._rows, point.own]))

    def _add(self, j: int, centre: Array, regions: Regions, region: int) -> None:
        """Rows for the faces that sphere j violates."""
        span = regions.rows(region)
        normals, offsets = regions.normals[span], regions.offsets[span] - self._needed[j] - KEEP_OFF
        broken = normals @ centre > offsets
        rows = -normals[broken] @ self._maps[j]
        rows[:, -1] += offsets[broken]
        self._rows = np.vstack([self._rows, rows])
        self._owner = np.append(self._owner, np.full(len(rows), j))
