"""The search with every sphere in a region of free space: IKSPARK among obstacles, as its section VII has it.

Rows of a sphere are added when a point leaves it outside of every region: a point that keeps all rows that were left
out is optimal with them too. The regions are the problem's, and those that Algorithm 3 inflates around the spheres of
points that were found (the paper's biased seeds).
"""

from __future__ import annotations

from contextlib import ExitStack
from math import inf

import numpy as np
from numpy.typing import NDArray

from workcell.ik.ikspark.instance import Instance
from workcell.ik.ikspark.obstacles.centres import moving_maps
from workcell.ik.ikspark.obstacles.cuboids import CuboidSet, Home
from workcell.ik.ikspark.obstacles.growing import Room
from workcell.ik.ikspark.obstacles.pairs import region_pairs
from workcell.ik.ikspark.obstacles.rounding import Rounding
from workcell.ik.ikspark.rank import linearise
from workcell.ik.ikspark.search import Reached, Search
from workcell.ik.result import Candidate
from workcell.pose import Array

ROUNDS = 6
"""Ascents with ever more rows, after one whose point leaves a sphere outside of every region."""


class AmongCuboids:
    """The search of one query.

    Attributes:
        room: the free space; it grows as the search goes on.
        spare: a configuration that the judge accepts though a sphere is in no region, or None.
    """

    def __init__(self, search: Search, instance: Instance, stack: ExitStack, *, most: float) -> None:
        """Prepare; `most` cone programs are this way's share."""
        problem = search.problem
        assert problem.cover is not None
        self._search, self._instance, self._problem, self._cover = search, instance, problem, problem.cover
        self._stack, self._most = stack, most
        self.room = Room(problem)
        self._moving = np.flatnonzero(problem.cover.link > 0)
        self._needed = problem.cover.radius[self._moving] + problem.tolerances.safety_margin
        self._maps = moving_maps(instance.lift, problem) @ instance.goal
        self.spare: Array | None = None

    @property
    def exhausted(self) -> bool:
        """Whether another way has its turn: the share of the work is done, or no region holds an answer."""
        if self._most == inf:
            return False
        return self.spare is not None or self._search.stats["sdps"] >= self._most

    def climb(self) -> Reached:
        """One restart: an ascent, then others with rows for the spheres that are in no region."""
        search, lift = self._search, self._instance.lift
        first = reached = search.attempt(self._instance, search.direction(lift))
        rounding, convex = Rounding(self._maps, self._needed), None
        for _ in range(ROUNDS):
            if reached.x is None or self._is_settled(reached) or search.over():
                break
            homes = self._homes(reached.x, rounding, convex)
            if not homes:
                break
            convex = CuboidSet(self._instance, self.room.regions, homes)
            reached = search.attempt(convex, linearise(lift, reached.x)[1], ", in cuboids")
        if reached.accepted and self._is_settled(reached):
            return reached
        return Reached(first.x, first.ray)

    def answer(self, q: Array) -> Candidate:
        """The configuration, with the region that each sphere is in."""
        held = self.room.regions.holding(self._centres(q), self._needed)
        cuboids = np.full(len(self._cover), -1, dtype=np.int64)
        cuboids[self._moving] = held
        return self._search.answer(q, cuboids, self.room.free_space)

    def _centres(self, q: Array) -> Array:
        """(m, 3) world centres of the moving spheres."""
        return self._cover.centres_world(self._problem.robot.link_transforms(q))[self._moving]

    def _outside(self, centres: Array) -> NDArray[np.bool_]:
        """(m,) which spheres lie in no region."""
        return self.room.regions.holding(centres, self._needed) < 0

    def _is_settled(self, reached: Reached) -> bool:
        """Whether an accepted configuration has every sphere in a region, if need be in one grown for it."""
        if not reached.accepted or reached.q is None:
            return False
        centres = self._centres(reached.q)
        outside = self._outside(centres)
        if not outside.any():
            return True
        if self.room.clear(centres[outside], self._needed[outside]).all():
            self._grow(centres[outside], self._needed[outside])
            outside = self._outside(centres)
        if outside.any():
            self.spare = reached.q if self.spare is None else self.spare
        return not outside.any()

    def _grow(self, centres: Array, needed: Array) -> bool:
        """Whether the free space has changed."""
        changed, there = self.room.grow(centres, needed), self.room.free_space
        note = f"for {len(centres)} spheres in none; now {len(there)} and {len(there.polytopes)} polytopes"
        self._search.stages.add("cuboids grown", note=note)
        return changed

    def _homes(self, x: Array, rounding: Rounding, last: CuboidSet | None) -> list[Home]:
        """Spheres that get rows, with the regions that each may be in; none where nothing more can be demanded."""
        centres = self._maps[..., :-1] @ x + self._maps[..., -1]
        outside = np.flatnonzero(self._outside(centres))
        if not len(outside):
            return []
        if self._grow(centres[outside], self._needed[outside]):
            rounding.forget_regions()
            last = None
            outside = np.flatnonzero(self._outside(centres))
        regions = self.room.regions
        allowed = region_pairs(self._problem, regions)
        rounding.demand(outside, np.where(allowed, regions.depths(centres, self._needed), np.inf), last)
        return rounding.homes(allowed)
