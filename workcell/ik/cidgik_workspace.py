"""The workspace as rows on Z, added lazily: only what the points found so far break.

|y - c|^2 >= l^2 for a point y and a sphere's centre c is linear in Z (Eq. 6), so it stays valid for every configuration,
and rows found once are kept. Obstacles that are not spheres are parted from the point by a plane through their surface
where it is nearest: that is one choice of side, which ends with the restart that it was made in.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from workcell.geometry.clearance import ObstacleArrays
from workcell.geometry.types import Piece
from workcell.ik.cidgik_goals import Balls, Plane
from workcell.ik.cidgik_reduction import Vectors
from workcell.ik.cidgik_relaxation import Instance
from workcell.pose import Array, Pose

KEEP_OFF = 1e-4
"""Metres added to what a row demands, so that its edge is not a near miss."""
MOST_ROWS = 96
"""Rows that one cone program may carry; the latest are kept."""
_MOVES = 1e-9

Key = tuple[str, int, int]


@dataclass(frozen=True, slots=True)
class Rules:
    """What points keep, in the world: see `Workspace`. `pieces` are solids of any kind."""

    radius: Array
    obstacles: Balls
    inside: Balls
    planes: tuple[Plane, ...] = ()
    apart: tuple[tuple[int, int], ...] = ()
    pieces: tuple[Piece, ...] = ()


@dataclass(frozen=True, slots=True)
class Broken:
    """One broken rule: by how many metres, its key, and whether its row holds for every configuration."""

    depth: float
    key: Key


class Keeper:
    """The rules of one query over the relaxation's variables, and the rows that were needed so far.

    Attributes:
        lasting: rows (f + 1,) that hold for every solution, by key.
        passing: rows of planes chosen in this restart.
    """

    def __init__(self, instance: Instance, points: Vectors, rules: Rules, base: Pose) -> None:
        self._instance, self._rules = instance, rules
        self.vectors = instance.vector(points)
        self._full = points.at(instance.G)
        self._movable = np.any(np.abs(self.vectors[:, :-3]) > _MOVES, axis=1)
        inverse = base.inverse()
        self._plane = instance.structure.skeleton.plane
        self._base = base
        self._centres = self._seen(rules.obstacles.centre, inverse)
        self._inside = self._seen(rules.inside.centre, inverse)
        self._pieces = ObstacleArrays(rules.pieces)
        self.lasting: dict[Key, Array] = {}
        self.passing: list[Array] = []

    def _seen(self, centres: Array, inverse: Pose) -> Array:
        local: Array = (centres @ inverse.rotation.T + inverse.position) @ self._plane.T
        return local

    def forget_passing(self) -> None:
        """At a restart: planes chosen before are forgotten."""
        self.passing = []
        self._load()

    def add_broken(self, columns: Array) -> int:
        """Rows for the rules that the points break at [X; I] (N, d); how many were added."""
        y = self._full @ columns
        added = self._add_balls(y) + self._add_inside(y) + self._add_apart(y)
        added += self._add_planes(y) + self._add_pieces(y)
        if added:
            self._load()
        return added

    def _load(self) -> None:
        rows = [*self.lasting.values(), *self.passing][-MOST_ROWS:]
        width = self._instance.directions.shape[1] + 1
        self._instance.set_slots(np.array(rows).reshape(-1, width))

    def _keep(self, key: Key, row: Array) -> int:
        """Keep a lasting row, the latest at the end; whether it is new."""
        new = key not in self.lasting
        self.lasting.pop(key, None)
        self.lasting[key] = row
        return int(new)

    def _add_balls(self, y: Array) -> int:
        if not len(self._centres):
            return 0
        needed = self._rules.obstacles.radius + self._rules.radius[:, None]
        gap = np.linalg.norm(y[:, None] - self._centres, axis=-1) - needed
        gap[~self._movable] = np.inf
        return sum(
            self._keep(("ball", i, j), self._outside(i, self._centres[j], needed[i, j]))
            for i, j in _worst(gap)
        )

    def _outside(self, i: int, centre: Array, radius: float) -> Array:
        difference = self._away(i, centre)
        row = self._instance.rows_of(difference[None], difference[None])[0]
        row[-1] -= (radius + KEEP_OFF) ** 2
        return row

    def _away(self, i: int, centre: Array) -> Array:
        difference = self.vectors[i].copy()
        difference[-len(centre) :] -= centre
        return difference

    def _add_inside(self, y: Array) -> int:
        if not len(self._inside):
            return 0
        room = self._rules.inside.radius - self._rules.radius[:, None]
        gap = room - np.linalg.norm(y[:, None] - self._inside, axis=-1)
        gap[~self._movable] = np.inf
        added = 0
        for i, j in _worst(gap):
            difference = self._away(i, self._inside[j])
            row = -self._instance.rows_of(difference[None], difference[None])[0]
            row[-1] += max(room[i, j] - KEEP_OFF, 0.0) ** 2
            added += self._keep(("inside", i, j), row)
        return added

    def _add_apart(self, y: Array) -> int:
        added = 0
        for i, j in self._rules.apart:
            needed = self._rules.radius[i] + self._rules.radius[j]
            if np.linalg.norm(y[i] - y[j]) < needed:
                difference = self.vectors[i] - self.vectors[j]
                row = self._instance.rows_of(difference[None], difference[None])[0]
                row[-1] -= (needed + KEEP_OFF) ** 2
                added += self._keep(("apart", i, j), row)
        return added

    def _add_planes(self, y: Array) -> int:
        added = 0
        for j, plane in enumerate(self._rules.planes):
            if plane.equal:
                continue
            for i in range(len(y)) if plane.points is None else plane.points:
                normal, offset = self.plane_in_base(plane)
                offset += self._rules.radius[i]
                if self._movable[i] and normal @ y[i] < offset:
                    added += self._keep(("plane", i, j), self._half_space(i, normal, offset + KEEP_OFF))
        return added

    def plane_in_base(self, plane: Plane) -> tuple[Array, float]:
        """Normal (d,) and offset seen from the base."""
        normal = self._plane @ (self._base.rotation.T @ plane.normal)
        return normal, float(plane.offset - plane.normal @ self._base.position)

    def _half_space(self, i: int, normal: Array, offset: float) -> Array:
        constant = np.zeros_like(self.vectors[i])
        constant[-len(normal) :] = normal
        row = self._instance.rows_of(self.vectors[i][None], constant[None])[0]
        row[-1] -= offset
        return row

    def _add_pieces(self, y: Array) -> int:
        if not len(self._pieces):
            return 0
        world = y @ self._base.rotation.T + self._base.position
        distance, gradient = self._pieces.distances_and_gradients(world)
        needed = self._rules.radius[:, None]
        gap = distance - needed
        gap[~self._movable] = np.inf
        pairs = _worst(gap)
        for i, j in pairs:
            normal = self._base.rotation.T @ gradient[i, j]
            offset = float(normal @ y[i] - distance[i, j] + needed[i, 0] + KEEP_OFF)
            self.passing.append(self._half_space(i, normal, offset))
        return len(pairs)


def _worst(gap: Array) -> Sequence[tuple[int, int]]:
    """(point, obstacle) for each obstacle that some point is inside of: its deepest point."""
    deepest = gap.argmin(axis=0)
    return [(int(i), int(j)) for j, i in enumerate(deepest) if gap[i, j] < 0]
