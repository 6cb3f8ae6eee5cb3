"""Free space that grows where a search needs it: around spheres that no region holds (IKSPARK, Algorithm 3)."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from workcell.geometry.free_space.fill import workspace_box
from workcell.geometry.free_space.pool import NOTHING, FreeSpacePool
from workcell.geometry.obstacle_arrays import ObstacleArrays
from workcell.ik.ikspark.obstacles.regions import Regions
from workcell.ik.problem import IKProblem
from workcell.pose import Array

_SLIDES = 3
"""Steps along the distance's gradient that bring a seed out of obstacles."""
_BESIDE = 1e-3
"""Metres beyond what a sphere needs, to which a seed is brought."""
_HELD_FROM = 5e-5
"""Metres beyond what a sphere needs from which on a region that holds it can be grown: regions keep off obstacles."""
_NO_POINTS = np.zeros((0, 3))


class Room:
    """The free space that one query is answered in: the problem's own, and what is added to it.

    Where queries share a free space (`IKProblem.grow`), it is that; else what is added is this query's alone.

    Attributes:
        problem: the query.
        free_space: all of it.
        obstacles: the problem's, packed.
    """

    def __init__(self, problem: IKProblem) -> None:
        self.problem = problem
        given = NOTHING if problem.free_space is None else problem.free_space
        self.free_space = given if problem.grow is None else problem.grow(_NO_POINTS)
        self.obstacles = ObstacleArrays(problem.obstacles)
        self._pool: FreeSpacePool | None = None

    @property
    def regions(self) -> Regions:
        """Its cuboids and polytopes."""
        return Regions.of(self.free_space)

    def hold(self, centres: Array, needed: Array) -> bool:
        """Add what holds spheres (k,) that keep `needed` (k,) from obstacles: cuboids, and polytopes in corners.

        Returns whether the free space has changed.
        """
        return self._grow(centres, needed)

    def seed(self, centres: Array, needed: Array) -> bool:
        """Add cuboids around spheres' centres (k, 3), and beside those that collide: the paper's biased seeds.

        Returns whether the free space has changed.
        """
        return self._grow(slid_out(self.obstacles, centres, needed), np.zeros(len(centres)))

    def _grow(self, points: Array, radii: Array) -> bool:
        before = self.free_space
        self.free_space = (self.problem.grow or self._own().grow)(points, radii)
        return self.free_space is not before

    def _own(self) -> FreeSpacePool:
        if self._pool is None:
            problem = self.problem
            self._pool = FreeSpacePool(
                problem.obstacles, workspace_box(problem.robot), free_space=self.free_space
            )
        return self._pool

    def clear(self, centres: Array, needed: Array) -> NDArray[np.bool_]:
        """Whether spheres (k,) keep what they need from every obstacle, so that a region of their own can be grown."""
        clear: NDArray[np.bool_] = self.obstacles.nearest(centres)[0] >= needed + _HELD_FROM
        return clear


def slid_out(obstacles: ObstacleArrays, centres: Array, needed: Array) -> Array:
    """Centres (k, 3), those of spheres that collide moved out of their obstacles, as far as that is easy.

    Args:
        obstacles: packed.
        centres: metres, in the world frame.
        needed: (k,) metres that a centre has to keep from obstacles.
    """
    at = centres
    for _ in range(_SLIDES):
        distance, gradient, _ = obstacles.nearest(at)
        short = needed + _BESIDE - distance
        if not np.any(short > _BESIDE):
            break
        at = np.where((short > _BESIDE)[:, None], at + short[:, None] * gradient, at)
    return at
