"""Free space that grows where a search needs it: cuboids inflated around spheres (IKSPARK, Algorithm 3)."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from workcell.geometry.free_space.cuboids import inflate_cuboids
from workcell.geometry.free_space.fill import workspace_box
from workcell.geometry.free_space.polytopes import inflate_polytope
from workcell.geometry.obstacle_arrays import ObstacleArrays
from workcell.geometry.types import FreePolytope, FreeSpace
from workcell.ik.ikspark.obstacles.door import trust
from workcell.ik.ikspark.obstacles.regions import Regions
from workcell.ik.problem import IKProblem
from workcell.pose import Array

_SLIDES = 3
"""Steps along the distance's gradient that bring a seed out of obstacles."""
_BESIDE = 1e-3
"""Metres beyond what a sphere needs, to which a seed is brought."""
_NOTHING = np.zeros((0, 3))


class Room:
    """The free space that one query is answered in: the problem's own, and what is added to it.

    Attributes:
        problem: the query.
        free_space: all of it.
        grown: whether anything was added.
        obstacles: the problem's, packed.
    """

    def __init__(self, problem: IKProblem) -> None:
        self.problem = problem
        given = problem.free_space
        self.free_space = FreeSpace(_NOTHING, _NOTHING) if given is None else given
        self.grown = False
        self.obstacles = ObstacleArrays(problem.obstacles)

    @property
    def regions(self) -> Regions:
        """Its cuboids and polytopes."""
        return Regions.of(self.free_space)

    def grow(self, centres: Array, needed: Array) -> bool:
        """Add cuboids around spheres that collide nowhere, and beside those that do; whether there are more now.

        Args:
            centres: (k, 3) of spheres that no region holds.
            needed: (k,) what they keep from obstacles.
        """
        seeds = self._slid(centres, needed)
        if not len(seeds):
            return False
        if self.problem.grow is not None:
            more = self.problem.grow(seeds)
            changed = len(more) + len(more.polytopes) > len(self.free_space) + len(self.free_space.polytopes)
            self.free_space = more
            trust(more, self.problem)
        else:
            made = inflate_cuboids(seeds, self.problem.obstacles, workspace_box(self.problem.robot))
            changed = self._add(made)
        self.grown |= changed
        return changed

    def add_polytopes(self, centres: Array, needed: Array) -> bool:
        """Add a polytope around each sphere, where that holds it: for the corners that no cuboid fits into."""
        box, made = workspace_box(self.problem.robot), list[FreePolytope]()
        for k in range(len(centres)):
            one = centres[k : k + 1], needed[k : k + 1]
            if any(polytope.holds_spheres(*one).all() for polytope in made):
                continue
            polytope = inflate_polytope(centres[k], self.problem.obstacles, box)
            if polytope is not None and polytope.holds_spheres(*one).all():
                made.append(polytope)
        if made:
            self.free_space = replace(self.free_space, polytopes=(*self.free_space.polytopes, *made))
            self.grown = True
        return bool(made)

    def clear(self, centres: Array, needed: Array) -> NDArray[np.bool_]:
        """Whether spheres (k,) keep what they need from every obstacle."""
        distance = self.obstacles.nearest(centres)[0]
        clear: NDArray[np.bool_] = distance >= needed
        return clear

    def _slid(self, centres: Array, needed: Array) -> Array:
        """The centres, those of colliding spheres moved out of their obstacles; without those that stay inside."""
        at = centres
        for _ in range(_SLIDES):
            distance, gradient, _ = self.obstacles.nearest(at)
            short = needed + _BESIDE - distance
            if not np.any(short > _BESIDE):
                break
            at = np.where((short > _BESIDE)[:, None], at + short[:, None] * gradient, at)
        return at

    def _add(self, made: FreeSpace) -> bool:
        """Add those cuboids that lie in no other one."""
        old = self.free_space
        inside = np.all(
            (made.lower[:, None] >= old.lower - 1e-6) & (made.upper[:, None] <= old.upper + 1e-6), axis=2
        ).any(axis=1)
        new = ~inside
        if not new.any():
            return False
        lower, upper = np.vstack([old.lower, made.lower[new]]), np.vstack([old.upper, made.upper[new]])
        table = old.admissible
        if table is not None:
            table = np.hstack([table, np.ones((len(table), int(new.sum())), dtype=bool)])
        self.free_space = replace(
            old, lower=lower, upper=upper, admissible=table, margin=None, covered_fraction=float("nan")
        )
        return True
