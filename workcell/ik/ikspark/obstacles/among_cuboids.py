"""The search with every sphere in a region of free space: IKSPARK among obstacles, as its section VII has it.

Rows of a sphere are added when a point has it collide: a point that keeps all rows that were left out is optimal with
them too, and a sphere that collides nowhere has a region, if need be one that Algorithm 3 inflates around it. The
regions are the problem's, and those inflated around and beside the spheres of points that were found (the paper's
biased seeds). The first restart has the perspective relaxation, later ones branch.
"""

from __future__ import annotations

from contextlib import ExitStack
from math import isfinite

import numpy as np
from numpy.typing import NDArray

from workcell.ik.ikspark.instance import Instance
from workcell.ik.ikspark.obstacles.branching import Branch, Instances
from workcell.ik.ikspark.obstacles.centres import moving_maps
from workcell.ik.ikspark.obstacles.demands import Demands, Point
from workcell.ik.ikspark.obstacles.growing import Room
from workcell.ik.ikspark.obstacles.pairs import region_pairs
from workcell.ik.ikspark.obstacles.rounding import Rounding
from workcell.ik.ikspark.rank import ConvexSet, linearise
from workcell.ik.ikspark.search import Reached, Search
from workcell.ik.result import Candidate
from workcell.pose import Array

ROUNDS = 6
"""Ascents with ever more rows, after one whose point has a sphere collide."""


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
        self._instances, self._most = Instances(problem, stack), most
        self.room = Room(problem)
        self._moving = np.flatnonzero(problem.cover.link > 0)
        self._needed = problem.cover.radius[self._moving] + problem.tolerances.safety_margin
        self._maps = moving_maps(instance.lift, problem) @ instance.goal
        self._restarts = 0
        self.spare: Array | None = None

    @property
    def exhausted(self) -> bool:
        """Whether its share of the work is done, or it has a spare answer for the fallback to give."""
        return isfinite(self._most) and (self.spare is not None or self._search.stats["sdps"] >= self._most)

    def climb(self) -> Reached:
        """One restart: an ascent, then others with rows for the spheres that collide."""
        search, lift = self._search, self._instance.lift
        first = reached = search.attempt(self._instance, search.direction(lift))
        demands = self._demands()
        for _ in range(ROUNDS):
            if reached.x is None or self._is_settled(reached) or search.over():
                break
            convex = self._tightened(reached.x, demands)
            if convex is None:
                break
            reached = search.attempt(convex, linearise(lift, reached.x)[1], ", in cuboids")
        return reached if self._is_settled(reached) else Reached(first.x, first.ray)

    def answer(self, q: Array) -> Candidate:
        """The configuration, with the region that each sphere is in."""
        held = self.room.regions.holding(self._centres(q), self._needed)
        cuboids = np.full(len(self._cover), -1, dtype=np.int64)
        cuboids[self._moving] = held
        return self._search.answer(q, cuboids, self.room.free_space)

    def _demands(self) -> Demands:
        self._restarts += 1
        if self._restarts == 1:
            return Rounding(self._instance, self._maps, self._needed)
        return Branch(self._instances, self._maps, self._needed)

    def _tightened(self, x: Array, demands: Demands) -> ConvexSet | None:
        """The set with rows for the spheres that collide at x (N,); None where nothing more can be demanded."""
        centres = self._maps[..., :-1] @ x + self._maps[..., -1]
        outside = np.flatnonzero(self._outside(centres))
        if not len(outside):
            return None
        recounted = self.room.seed(centres[outside], self._needed[outside])
        self._tell_growth(len(outside))
        outside = np.flatnonzero(self._outside(centres))
        colliding = outside[~self.room.clear(centres[outside], self._needed[outside])]
        if not len(colliding):
            return None
        regions = self.room.regions
        allowed = region_pairs(self._problem, regions)
        depths = np.where(allowed, regions.depths(centres, self._needed), np.inf)
        return demands.tightened(Point(centres, colliding, regions, depths, recounted))

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
        if outside.any() and self.room.clear(centres[outside], self._needed[outside]).all():
            self.room.hold(centres[outside], self._needed[outside])
            self._tell_growth(int(np.count_nonzero(outside)))
            outside = self._outside(centres)
        if outside.any() and self.spare is None:
            self.spare = reached.q
        return not outside.any()

    def _tell_growth(self, spheres: int) -> None:
        there = self.room.free_space
        note = f"for {spheres} spheres in none; now {len(there)} and {len(there.polytopes)} polytopes"
        self._search.stages.add("cuboids grown", note=note)
