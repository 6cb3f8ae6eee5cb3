"""The clearance engine: a robot's spheres among obstacles and against each other, compiled, with gradients in q."""

from __future__ import annotations

import functools
import importlib
import math
from collections.abc import Sequence
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from workcell.errors import InputError
from workcell.geometry.obstacle_arrays import ObstacleArrays
from workcell.geometry.packing import NO_GRADIENT, pack_spheres, pack_tree
from workcell.geometry.self_collision import SelfCollisionPairs
from workcell.geometry.types import Piece, SphereCover
from workcell.model.robot import Robot
from workcell.pose import Array

Index = NDArray[np.int64]


@dataclass(frozen=True, slots=True)
class Nearest:
    """The pair with the smallest gap at one configuration.

    Attributes:
        distance: signed, in metres; inf when there is nothing to hit.
        sphere: number in the cover; -1 when there is nothing to hit.
        obstacle: number of the obstacle; -1 when the nearest is a sphere of the robot itself.
        other_sphere: number of that sphere, else -1.
        gradient: (n,) of the distance, metres per radian or metre.
    """

    distance: float
    sphere: int
    obstacle: int
    other_sphere: int
    gradient: Array


@dataclass(frozen=True, slots=True)
class Contacts:
    """Pairs nearer than a margin, ordered by configuration.

    Attributes:
        row: (p,) number of the configuration.
        sphere: (p,) number in the cover.
        obstacle: (p,) number of the obstacle; -1 where two spheres of the robot meet.
        other_sphere: (p,) number of the other sphere, else -1.
        gap: (p,) signed distance in metres.
        gradient: (p, n) of the gap, metres per radian or metre.
    """

    row: Index
    sphere: Index
    obstacle: Index
    other_sphere: Index
    gap: Array
    gradient: Array

    def __len__(self) -> int:
        return len(self.gap)


class ClearanceEngine:
    """Signed distances of a robot's spheres to obstacles and to each other, with gradients with respect to q.

    Everything is packed once; queries run compiled kernels (on first use in a fresh installation they are compiled, and
    kept on disk). Distances are exact outside and are penetration depths, negative, inside. Queries raise `InputError`
    for configurations of the wrong shape or that are not finite; joint limits are not looked at.

    Args:
        robot: a tree or a chain.
        cover: its spheres, by link.
        obstacles: convex pieces in the world frame, or the same packed; none: nothing outside the robot counts.
        pairs: spheres that must not touch each other: (p, 2) numbers in the cover, or as `self_collision_pairs` finds
            them; None: the robot can't hit itself.

    Raises:
        InputError: a sphere on a link, or a pair of spheres, that is not there. ModelError: a hull without volume.
    """

    def __init__(
        self,
        robot: Robot,
        cover: SphereCover,
        obstacles: ObstacleArrays | Sequence[Piece] = (),
        pairs: SelfCollisionPairs | ArrayLike | None = None,
    ) -> None:
        self.robot, self.cover = robot, cover
        self.obstacles = obstacles if isinstance(obstacles, ObstacleArrays) else ObstacleArrays(obstacles)
        self.pairs = _checked_pairs(pairs, len(cover))
        self._contacts_a_row = 32
        self._tree, self._spheres = pack_tree(robot), pack_spheres(robot, cover)

    def clearance(self, q: ArrayLike) -> float:
        """The smallest signed distance in metres at q (n,); inf when there is nothing to hit."""
        return float(self._smallest(self._rows(q, 1), False)[0][0])

    def clearances(self, q: ArrayLike, *, threads: int = 1) -> Array:
        """The same (b,) for configurations q (b, n)."""
        rows = self._rows(q, 2)
        if threads < 1:
            raise InputError(f"{threads} threads can't run", where="threads", remedy="1 or more")
        if threads == 1 or len(rows) < 2 * threads:
            return self._smallest(rows, False)[0]
        with ThreadPoolExecutor(threads) as pool:
            parts = pool.map(lambda part: self._smallest(part, False)[0], np.array_split(rows, threads))
            return np.concatenate(list(parts))

    def clearance_and_gradient(self, q: ArrayLike) -> tuple[float, Array]:
        """The smallest signed distance at q (n,), and its gradient (n,), zero when there is nothing to hit."""
        gap, gradient, _ = self._smallest(self._rows(q, 1), True)
        return float(gap[0]), gradient[0]

    def clearances_and_gradients(self, q: ArrayLike) -> tuple[Array, Array]:
        """The same for configurations (b, n): (b,) and (b, n)."""
        return self._smallest(self._rows(q, 2), True)[:2]

    def nearest(self, q: ArrayLike) -> Nearest:
        """Who is nearest to whom at q (n,)."""
        gap, gradient, where = self._smallest(self._rows(q, 1), True)
        sphere, obstacle, other = map(int, where[0])
        return Nearest(float(gap[0]), sphere, obstacle, other, gradient[0])

    def sphere_clearances(self, q: ArrayLike) -> Array:
        """Signed distances (..., m) of all spheres, each to its nearest obstacle, at q (..., n)."""
        rows = self._rows(q)
        return self._of_spheres(rows, False)[0].reshape(*np.shape(q)[:-1], len(self.cover))

    def sphere_clearances_and_gradients(self, q: ArrayLike) -> tuple[Array, Array, Index]:
        """At q (n,) the signed distances (m,), their gradients (m, n), and each one's nearest obstacle (m,)."""
        gap, gradient, which = self._of_spheres(self._rows(q, 1), True)
        return gap[0], gradient[0], which[0]

    def pair_distances_and_gradients(self, q: ArrayLike) -> tuple[Array, Array]:
        """At q (n,) the signed distances (m, k) of every sphere to every obstacle, and their gradients (m, k, n)."""
        row = self._rows(q, 1)[0]
        gap = np.empty((len(self.cover), len(self.obstacles)))
        gradient = np.empty((*gap.shape, self.robot.joint_count))
        _kernels().pair_gaps(self._tree, self._spheres, self.obstacles.shapes, row, gap, gradient)
        return gap, self._by_variable(gradient, row)

    def self_clearances(self, q: ArrayLike) -> Array:
        """Signed distances (..., p) between the spheres of each pair at q (..., n)."""
        gap, _ = self._of_pairs(self._rows(q), False)
        return gap.reshape(*np.shape(q)[:-1], len(self.pairs))

    def self_clearances_and_gradients(self, q: ArrayLike) -> tuple[Array, Array]:
        """At q (n,) the signed distances (p,) between the spheres of each pair, and their gradients (p, n)."""
        gap, gradient = self._of_pairs(self._rows(q, 1), True)
        return gap[0], gradient[0]

    def contacts(self, q: ArrayLike, margin: float) -> Contacts:
        """All pairs with a gap below `margin` metres at configurations q (b, n)."""
        rows = self._rows(q, 2)
        if not math.isfinite(margin):
            raise InputError(f"a margin of {margin}", where="margin", remedy="finite metres")
        room = self._contacts_a_row * len(rows)
        while True:
            who, gap = np.empty((room, 4), dtype=np.int64), np.empty(room)
            gradient = np.empty((room, self.robot.joint_count))
            count = _contact_kernels().near_contacts(
                self._tree,
                self._spheres,
                self.obstacles.shapes,
                self.pairs,
                rows,
                float(margin),
                who,
                gap,
                gradient,
            )
            if count <= room:
                row, sphere, obstacle, other = who[:count].T
                rates = self._by_variable(gradient[:count], rows[row])
                return Contacts(row, sphere, obstacle, other, gap[:count], rates)
            room, self._contacts_a_row = count, 1 + count // len(rows)

    def _smallest(self, rows: Array, with_gradient: bool) -> tuple[Array, Array, Index]:
        gap, where = np.empty(len(rows)), np.empty((len(rows), 3), dtype=np.int64)
        gradient = np.empty(rows.shape if with_gradient else (0, 0))
        _kernels().smallest_gaps(
            self._tree, self._spheres, self.obstacles.shapes, self.pairs, rows, gap, gradient, where
        )
        return gap, self._by_variable(gradient, rows), where

    def _of_spheres(self, rows: Array, with_gradient: bool) -> tuple[Array, Array, Index]:
        gap = np.empty((len(rows), len(self.cover)))
        gradient = np.empty((*gap.shape, self.robot.joint_count)) if with_gradient else NO_GRADIENT
        which = np.empty(gap.shape, dtype=np.int64)
        _kernels().sphere_gaps(self._tree, self._spheres, self.obstacles.shapes, rows, gap, gradient, which)
        return gap, self._by_variable(gradient, rows), which

    def _of_pairs(self, rows: Array, with_gradient: bool) -> tuple[Array, Array]:
        gap = np.empty((len(rows), len(self.pairs)))
        gradient = np.empty((*gap.shape, self.robot.joint_count)) if with_gradient else NO_GRADIENT
        _kernels().self_gaps(self._tree, self._spheres, self.pairs, rows, gap, gradient)
        return gap, self._by_variable(gradient, rows)

    def _by_variable(self, gradient: Array, rows: Array) -> Array:
        """Gradients (c, ..., n) by the robot's variables, of those by its joints, at joint values (c, m)."""
        coupling = self.robot.coupling
        if coupling is None or gradient.size == 0:
            return gradient if coupling is None else gradient[..., : self.robot.dof]
        return coupling.gathered(gradient, coupling.variables(rows))

    def _rows(self, q: ArrayLike, ndim: int | None = None) -> Array:
        """Joint values (c, m) of configurations as the kernels take them: checked, writable, without gaps."""
        try:
            values = np.asarray(q, dtype=float)
        except (TypeError, ValueError):
            raise InputError("joint values are not an array of numbers", where="q") from None
        n = self.robot.dof
        if values.ndim == 0 or values.shape[-1] != n or (ndim is not None and values.ndim != ndim):
            wanted = {None: f"(..., {n})", 1: f"({n},)", 2: f"(b, {n})"}[ndim]
            raise InputError(
                f"{self.robot.name} takes joint values {wanted}, not an array of shape {values.shape}",
                where="q",
                remedy=f"in this order: {', '.join(self.robot.joint_names)}",
            )
        rows = np.ascontiguousarray(values.reshape(-1, n))
        flat = rows.ravel()
        # One product tells that all is finite, and costs less than looking at each.
        if not math.isfinite(flat @ flat) and not np.isfinite(flat).all():
            raise InputError("joint values are not finite", where="q")
        if self.robot.coupling is not None:
            return np.ascontiguousarray(self.robot.joint_values(rows))
        return rows if rows.flags.writeable else rows.copy()


def _checked_pairs(pairs: SelfCollisionPairs | ArrayLike | None, spheres: int) -> Index:
    """Pairs (p, 2) as the kernels take them."""
    listed = pairs.pairs if isinstance(pairs, SelfCollisionPairs) else () if pairs is None else pairs
    array = np.array(listed)
    if array.size == 0:
        return np.empty((0, 2), dtype=np.int64)
    if array.ndim != 2 or array.shape[1] != 2 or not np.issubdtype(array.dtype, np.integer):
        raise InputError(f"pairs of shape {array.shape}", where="pairs", remedy="integers (p, 2)")
    if array.min() < 0 or array.max() >= spheres or np.any(array[:, 0] == array[:, 1]):
        raise InputError(
            "a pair names a sphere twice, or one that is not there",
            where="pairs",
            remedy=f"two of 0 to {spheres - 1}",
        )
    return np.ascontiguousarray(array.astype(np.int64))


@functools.cache
def _kernels() -> Any:
    """Compiled kernels, imported on first use: numba takes half a second."""
    return importlib.import_module("workcell.kernels.sphere_gaps")


@functools.cache
def _contact_kernels() -> Any:
    return importlib.import_module("workcell.kernels.near_pairs")
