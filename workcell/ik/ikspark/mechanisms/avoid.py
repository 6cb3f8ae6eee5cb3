"""Spheres of a mechanism that must keep clear of obstacles and of each other: rows that enter where they don't.

A sphere that touches an obstacle is put into the region of free space that it sticks out of least, if the problem has
any or can grow some, and the faces of that region that it breaks become rows (the branch of Eq. 71 in which its delta
is one); where there is none, the plane that touches the obstacle does, which is no choice of the paper's. Two spheres
that overlap are parted along the line between their centres: IKSPARK itself leaves collisions of the robot with itself
out.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from workcell.geometry.obstacle_arrays import ObstacleArrays
from workcell.ik.ikspark.mechanisms.lift import MechanismLift
from workcell.ik.ikspark.mechanisms.rows import Rows
from workcell.ik.ikspark.obstacles.growing import slid_out
from workcell.ik.ikspark.obstacles.regions import Regions
from workcell.ik.mechanisms.problem import MechanismProblem
from workcell.ik.shared.convex import KEEP_OFF
from workcell.model.mechanism.mechanism import WORLD
from workcell.pose import Array

_MOST_PAIRS = 24
"""Pairs of spheres that are parted at once: the deepest."""


class Avoidance:
    """Spheres, obstacles and regions of one question.

    Attributes:
        by_planes: rows that were made of planes that touch obstacles, since `forget`.
    """

    def __init__(self, problem: MechanismProblem, lift: MechanismLift) -> None:
        cover = problem.cover
        assert cover is not None
        self._maps = lift.points(cover.link, cover.centre)
        self._needed = cover.radius + problem.tolerances.safety_margin
        self._obstacles = ObstacleArrays(problem.obstacles)
        self._regions = None if problem.free_space is None else Regions.of(problem.free_space)
        self._grow = problem.grow
        self._hindered = _hindered(problem)
        moves = np.any(np.abs(self._maps[:, :, :-1]) > 1e-9, axis=(1, 2)) & (cover.link != WORLD)
        self._movable = moves & self._hindered
        self._pairs = np.zeros((0, 2), dtype=np.int64) if problem.apart is None else problem.apart
        self.forget()

    def forget(self) -> None:
        """Begin anew: no sphere has a region."""
        self._region: dict[int, int] = {}
        self._rows: list[Rows] = []
        self.by_planes = 0

    def rows(self, x: Array) -> list[Rows] | None:
        """All rows so far, with those that the point x (N,) breaks; None: it breaks none."""
        centres = self._maps[..., :-1] @ x + self._maps[..., -1]
        found = [*self._off_obstacles(centres), *self._apart(centres)]
        if not found:
            return None
        self._rows += found
        return self._rows

    def _off_obstacles(self, centres: Array) -> list[Rows]:
        if not len(self._obstacles):
            return []
        distance, normal, _ = self._obstacles.nearest(centres)
        touching = np.flatnonzero(self._movable & (distance < self._needed))
        if not len(touching):
            return []
        self._make_room(centres[touching], self._needed[touching])
        found: list[Rows] = []
        for j in touching.tolist():
            inside = self._faces(j, centres[j])
            if inside is not None:
                found += inside
                continue
            row = normal[j] @ self._maps[j]
            row[-1] -= float(normal[j] @ centres[j]) - float(distance[j]) + self._needed[j] + KEEP_OFF
            found.append(Rows("plane", j, "nonneg", row[None]))
            self.by_planes += 1
        return found

    def _make_room(self, centres: Array, needed: Array) -> None:
        """Regions for spheres that touch, beside the obstacles that they touch, if the free space can grow."""
        if self._grow is None:
            return
        beside = slid_out(self._obstacles, centres, needed)
        clear = self._obstacles.nearest(beside)[0] >= needed
        self._regions = Regions.of(self._grow(beside[clear], needed[clear]))

    def _faces(self, j: int, centre: Array) -> list[Rows] | None:
        """Faces of its region that a sphere breaks; None: there is no region, or it holds the sphere."""
        if self._regions is None or not len(self._regions):
            return None
        depths = self._regions.depths(centre[None], self._needed[j : j + 1])[0]
        region = self._region.setdefault(j, int(np.argmin(depths)))
        span = self._regions.rows(region)
        normals, offsets = (
            self._regions.normals[span],
            self._regions.offsets[span] - self._needed[j] - KEEP_OFF,
        )
        broken = normals @ centre > offsets
        if not np.any(broken):
            return None
        rows = -normals[broken] @ self._maps[j]
        rows[:, -1] += offsets[broken]
        return [Rows("region face", j, "nonneg", rows)]

    def _apart(self, centres: Array) -> list[Rows]:
        if not len(self._pairs):
            return []
        a, b = self._pairs.T
        between = centres[a] - centres[b]
        length = np.linalg.norm(between, axis=1)
        wanted = self._needed[a] + self._needed[b]
        deep = np.flatnonzero(length < wanted)
        deep = deep[np.argsort(length[deep] - wanted[deep])][:_MOST_PAIRS]
        found = []
        for k in deep.tolist():
            if length[k] < 1e-9:
                continue
            normal = between[k] / length[k]
            row = normal @ (self._maps[a[k]] - self._maps[b[k]])
            if not np.any(np.abs(row[:-1]) > 1e-9):
                continue
            row[-1] -= wanted[k] + KEEP_OFF
            found.append(Rows("apart", k, "nonneg", row[None]))
        return found


def _hindered(problem: MechanismProblem) -> NDArray[np.bool_]:
    """(m,) whether a sphere has to keep off obstacles: not on a link that is to touch one."""
    assert problem.cover is not None
    frames = [problem.mechanism.frame(region.frame) for region in problem.regions if np.any(region.equal)]
    touching = [frame.link for frame in frames]
    hindered: NDArray[np.bool_] = ~np.isin(problem.cover.link, touching)
    return hindered
