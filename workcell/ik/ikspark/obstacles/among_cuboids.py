"""The search with every sphere in a region of free space: IKSPARK among obstacles, as its section VII has it.

The regions that are there decide first: rows of a sphere are added when a point has it in none of them, as a point that
keeps all rows that were left out is optimal with them too. Where that leads nowhere, or nothing is there, the free
space grows, by Algorithm 3 from around and beside the spheres of points that were found (the paper's biased seeds);
then a sphere that collides nowhere has a region, and the others get rows. The first restart has the perspective
relaxation, later ones branch.
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
from workcell.ik.ikspark.obstacles.own import OwnSpheres
from workcell.ik.ikspark.obstacles.pairs import region_pairs
from workcell.ik.ikspark.obstacles.rounding import Rounding
from workcell.ik.ikspark.rank import ConvexSet, linearise
from workcell.ik.ikspark.search import Reached, Search
from workcell.ik.result import Candidate
from workcell.pose import Array

ROUNDS = 6
"""Ascents with ever more rows, after one whose point has a sphere in no region."""

GIVEN_ALONE = 3
"""Restarts in the regions of a given free space, as in the paper, before it grows; one where queries share it."""


class AmongCuboids:
    """The search of one query.

    Attributes:
        room: the free space; it grows as the search goes on.
        spare: a configuration that the judge accepts though a sphere is in no region, or None.
    """

    def __init__(
        self, search: Search, instance: Instance, own: OwnSpheres, stack: ExitStack, *, most: float
    ) -> None:
        """Prepare; `most`, in cone programs, is this way's share of the work."""
        problem = search.problem
        assert problem.cover is not None
        self._search, self._instance, self._problem, self._cover = search, instance, problem, problem.cover
        self._instances, self._own, self._most = Instances(problem, stack), own, most
        self.room = Room(problem)
        self._given = self.room.free_space
        self._alone = 0 if not len(self.room.regions) else GIVEN_ALONE if problem.grow is None else 1
        self._moving = np.flatnonzero(problem.cover.link > 0)
        self._needed = problem.cover.radius[self._moving] + problem.tolerances.safety_margin
        self._maps = moving_maps(instance.lift, problem) @ instance.goal
        self._restarts = 0
        self._at: tuple[Array | None, Array] = (None, np.zeros((0, 3)))
        self.spare: Array | None = None

    @property
    def exhausted(self) -> bool:
        """Whether its share of the work is done, or it has a spare answer for the fallback to give."""
        return isfinite(self._most) and (self.spare is not None or self._search.work >= self._most)

    def climb(self) -> Reached:
        """One restart: an ascent, then others with rows, in the regions that are there, then in more of them."""
        search, self._restarts = self._search, self._restarts + 1
        first = search.attempt(self._instance, search.direction(self._instance.lift))
        for grows in self._turns():
            reached = self._ascended(first, grows)
            if reached.accepted and not self._outside_at(reached).any():
                search.stats["in_given"] = float(self.room.free_space is self._given)
                return reached
        return Reached(first.x, first.ray)

    def _turns(self) -> tuple[bool, ...]:
        """Whether the free space grows, by turns of this restart."""
        if self._alone == 0:
            return (True,)
        return (False,) if self._restarts < self._alone else (False, True)

    def _ascended(self, reached: Reached, grows: bool) -> Reached:
        """Ascents with ever more rows, from a point without; where `grows`, the free space grows with them."""
        demands = self._demands()
        self._own.restart()
        for _ in range(ROUNDS):
            if reached.x is None or self._is_settled(reached, grows) or self._search.over():
                break
            convex = self._tightened(reached, demands, grows)
            if convex is None:
                break
            direction = self._own.pushed(linearise(self._instance.lift, reached.x)[1])
            where = ", in cuboids" if grows else ", in the cuboids that are there"
            reached = self._search.attempt(convex, direction, where)
        return reached

    def answer(self, q: Array) -> Candidate:
        """The configuration, with the region that each sphere is in."""
        held = self.room.regions.holding(self._centres(q), self._needed)
        cuboids = np.full(len(self._cover), -1, dtype=np.int64)
        cuboids[self._moving] = held
        return self._search.answer(q, cuboids, self.room.free_space)

    def _demands(self) -> Demands:
        if self._restarts == 1:
            return Rounding(self._instances, self._maps, self._needed)
        return Branch(self._instances, self._maps, self._needed)

    def _tightened(self, reached: Reached, demands: Demands, grows: bool) -> ConvexSet | None:
        """The set with rows for spheres that need them where an ascent ended; None: nothing more can be demanded."""
        x = reached.x
        assert x is not None
        parted = self._own.part(reached)
        centres, recounted = self._maps[..., :-1] @ x + self._maps[..., -1], False
        outside = np.flatnonzero(self._outside(centres))
        if grows and len(outside):
            recounted = self.room.seed(centres[outside], self._needed[outside])
            self._count_growth(len(outside))
            outside = np.flatnonzero(self._outside(centres))
            outside = outside[~self.room.clear(centres[outside], self._needed[outside])]
        if not len(outside) and not parted:
            return None
        regions = self.room.regions
        allowed = region_pairs(self._problem, regions)
        depths = np.where(allowed, regions.depths(centres, self._needed), np.inf)
        return demands.tightened(Point(centres, outside, regions, depths, recounted, self._own.rows))

    def _centres(self, q: Array) -> Array:
        """(m, 3) world centres of the moving spheres; those at the configuration asked about last are kept."""
        if self._at[0] is not q:
            T = self._problem.robot.link_transforms(q)
            self._at = q, self._cover.centres_world(T)[self._moving]
        return self._at[1]

    def _outside(self, centres: Array) -> NDArray[np.bool_]:
        """(m,) which spheres lie in no region."""
        return self.room.regions.holding(centres, self._needed) < 0

    def _outside_at(self, reached: Reached) -> NDArray[np.bool_]:
        """(m,) which spheres lie in no region at a configuration that was reached."""
        assert reached.q is not None
        return self._outside(self._centres(reached.q))

    def _is_settled(self, reached: Reached, grows: bool) -> bool:
        """Whether an accepted configuration has every sphere in a region; where `grows`, in one grown for it."""
        if not reached.accepted or reached.q is None:
            return False
        outside = self._outside_at(reached)
        if not grows or not outside.any():
            return not outside.any()
        centres = self._centres(reached.q)
        if self.room.clear(centres[outside], self._needed[outside]).all():
            self.room.hold(centres[outside], self._needed[outside])
            self._count_growth(int(np.count_nonzero(outside)))
            outside = self._outside(centres)
        if outside.any() and self.spare is None:
            self.spare = reached.q
        return not outside.any()

    def _count_growth(self, spheres: int) -> None:
        there = self.room.free_space
        note = f"for {spheres} spheres in none; now {len(there)} and {len(there.polytopes)} polytopes"
        self._search.stages.add("cuboids grown", note=note)
        self._search.stats["growths"] += 1
