"""The cuboids and polytopes of a recording: numbered as they come, drawn once, asked what is inside them."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from workcell.geometry.free_space.polytopes import solid_of
from workcell.geometry.types import FreePolytope, FreeSpace
from workcell.pose import Array
from workcell.record.shapes import polytope_shape
from workcell.record.write.rrd import RrdWriter

_FREE_RGBA = (0.25, 0.75, 0.35, 0.12)


@dataclass(frozen=True, slots=True)
class FreeSolid:
    """A cuboid or a polytope: {x: A x <= b}, A (f, 3) unit normals.

    Attributes:
        box: corners (3,) and (3,) of a cuboid; None: a polytope.
        outline: (k, 3) one line along all edges of a polytope; none of a cuboid.
    """

    A: Array
    b: Array
    box: tuple[Array, Array] | None
    outline: Array

    @staticmethod
    def cuboid(lower: Array, upper: Array) -> FreeSolid:
        """The one between two corners."""
        normals = np.concatenate([np.eye(3), -np.eye(3)])
        return FreeSolid(normals, np.concatenate([upper, -lower]), (lower, upper), np.zeros((0, 3)))

    @staticmethod
    def polytope(polytope: FreePolytope) -> FreeSolid:
        """The same, with its edges."""
        solid = solid_of(polytope)
        return FreeSolid(polytope.A, polytope.b, None, solid.vertices[_walk(solid.edges)])

    def depth_outside(self, centres: Array, radii: Array) -> Array:
        """(..., m) metres by which spheres, centres (..., m, 3) and radii (m,), stick out; negative: wholly inside."""
        depth: Array = np.max(centres @ self.A.T - self.b, axis=-1) + radii
        return depth


class FreeSolids:
    """Numbers what is new, and draws it below `world/free_space`."""

    def __init__(self, writer: RrdWriter) -> None:
        self._writer = writer
        self._numbers: dict[bytes, int] = {}
        self._solids: list[FreeSolid] = []

    def __len__(self) -> int:
        return len(self._solids)

    def __getitem__(self, number: int) -> FreeSolid:
        return self._solids[number]

    def add(self, free_space: FreeSpace) -> None:
        """All of a free space."""
        for index in range(len(free_space) + len(free_space.polytopes)):
            self.number(free_space, index)

    def numbers(self, free_space: FreeSpace, indices: NDArray[np.int64]) -> NDArray[np.int64]:
        """Numbers of the cuboids, then the polytopes, of a free space with these indices; -1 stays -1."""
        used, inverse = np.unique(indices, return_inverse=True)
        known = [self.number(free_space, int(index)) if index >= 0 else -1 for index in used]
        return np.array(known, dtype=np.int64)[inverse]

    def number(self, free_space: FreeSpace, index: int) -> int:
        """The number of one of them."""
        if index < len(free_space):
            lower, upper = free_space.lower[index], free_space.upper[index]
            number, new = self._number_of(lower.tobytes() + upper.tobytes())
            if new:
                self._solids.append(FreeSolid.cuboid(lower, upper))
                self._writer.log_box(f"world/free_space/{number}", lower, upper, _FREE_RGBA)
            return number
        polytope = free_space.polytopes[index - len(free_space)]
        number, new = self._number_of(polytope.A.tobytes() + polytope.b.tobytes())
        if new:
            self._solids.append(FreeSolid.polytope(polytope))
            shape = polytope_shape(polytope, np.array(_FREE_RGBA))
            self._writer.log_shape(f"world/free_space/{number}", shape)
        return number

    def _number_of(self, key: bytes) -> tuple[int, bool]:
        """The number of a solid, and whether it is a new one."""
        new = key not in self._numbers
        return self._numbers.setdefault(key, len(self._numbers)), new


def _walk(edges: NDArray[np.int64]) -> list[int]:
    """A closed walk over a connected graph that goes along each edge once in either direction."""
    ways: dict[int, list[int]] = {}
    for a, b in edges.tolist():
        ways.setdefault(a, []).append(b)
        ways.setdefault(b, []).append(a)
    walk, stack = list[int](), [int(edges[0, 0])]
    while stack:  # Hierholzer's way through the doubled edges
        if ways[stack[-1]]:
            stack.append(ways[stack[-1]].pop())
        else:
            walk.append(stack.pop())
    return walk
