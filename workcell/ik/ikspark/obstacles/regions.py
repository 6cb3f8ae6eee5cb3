"""The regions of a free space, cuboids and then polytopes, as rows `normal . p <= offset` of one table."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from workcell.geometry.free_space.cuboids import holds_spheres
from workcell.geometry.types import FreeSpace
from workcell.identity_cache import ByIdentity
from workcell.pose import Array

_FACES = np.vstack([-np.eye(3), np.eye(3)])
_known = ByIdentity()


@dataclass(frozen=True, slots=True)
class Regions:
    """Rows of all regions, one region after the other.

    Attributes:
        free_space: whose regions these are; region i is its cuboid i, or its polytope i - k.
        normals: (rows, 3) outward unit normals.
        offsets: (rows,) metres.
        first: (n + 1,) where each region's rows begin, and how many there are.
    """

    free_space: FreeSpace
    normals: Array
    offsets: Array
    first: NDArray[np.int64]

    @staticmethod
    def of(free_space: FreeSpace) -> Regions:
        """The table of a free space, made once."""
        return _known.get((free_space,), lambda: _packed(free_space))

    def __len__(self) -> int:
        return len(self.first) - 1

    def rows(self, region: int) -> slice:
        """The rows of a region."""
        return slice(int(self.first[region]), int(self.first[region + 1]))

    def depths(self, centres: Array, radii: Array) -> Array:
        """(m, n) metres by which each sphere, centres (m, 3), sticks out of each region; zero or less: inside."""
        if not len(self):
            return np.zeros((len(centres), 0))
        out = centres @ self.normals.T - self.offsets
        depths: Array = np.maximum.reduceat(out, self.first[:-1], axis=1) + radii[:, None]
        return depths

    def holding(self, centres: Array, radii: Array) -> NDArray[np.int64]:
        """(m,) the first region that each sphere lies inside, -1 where there is none."""
        if not len(self):
            return np.full(len(centres), -1)
        inside = np.zeros((len(centres), len(self)), dtype=bool)
        cuboids = len(self.free_space)
        inside[:, :cuboids] = holds_spheres(self.free_space, centres, radii)
        for k, polytope in enumerate(self.free_space.polytopes):
            inside[:, cuboids + k] = polytope.holds_spheres(centres, radii)
        chosen: NDArray[np.int64] = np.where(inside.any(axis=1), inside.argmax(axis=1), -1)
        return chosen


def _packed(free_space: FreeSpace) -> Regions:
    boxes = len(free_space)
    offsets = [np.hstack([-free_space.lower, free_space.upper]).ravel(), *(p.b for p in free_space.polytopes)]
    normals = [np.tile(_FACES, (boxes, 1)), *(p.A for p in free_space.polytopes)]
    counts = np.array([6] * boxes + [len(p.b) for p in free_space.polytopes], dtype=np.int64)
    first = np.concatenate([[0], np.cumsum(counts)])
    return Regions(free_space, np.vstack(normals), np.concatenate(offsets), first)
