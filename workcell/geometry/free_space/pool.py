"""A free space that grows where it is asked for, for queries that share it: cuboids first, polytopes in corners.

Biased seeds of IKSPARK (section X-C, see `workcell.ik.ikspark.solver`) without the draw: the seeds are where spheres
that no cuboid holds want to be.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import ArrayLike, NDArray

from workcell import clock
from workcell.errors import InputError
from workcell.geometry.free_space.cuboids import GAP, CuboidInflation, holds_spheres, outermost
from workcell.geometry.free_space.polytopes import inflate_polytope
from workcell.geometry.free_space.valid import still_free
from workcell.geometry.obstacle_arrays import ObstacleArrays
from workcell.geometry.types import FreePolytope, FreeSpace, Piece
from workcell.pose import Array

NOTHING = FreeSpace(np.zeros((0, 3)), np.zeros((0, 3)), margin=np.zeros(0))
"""No free space at all."""
MOST_CUBOIDS, MOST_POLYTOPES = 400, 100
"""How many a pool may have; one that is full grows no more."""
_CELL = 1e-3
"""Metres: a point next to one that was asked in vain is not asked again."""
_KEPT_OFF = 4 * GAP
"""Metres that a ball must be off obstacles to be held by something that keeps `GAP` from them."""


@dataclass(frozen=True, slots=True)
class PoolCounts:
    """What a pool has done: how often it was asked, about how many points, in how many CPU seconds of growing."""

    calls: int = 0
    points: int = 0
    seeds: int = 0
    cpu_s: float = 0.0


class FreeSpacePool:
    """Free space among obstacles that only grows. The same questions in the same order make the same cuboids.

    Args:
        obstacles: convex pieces in the world frame.
        bounds: (2, 3) corners of the workspace.
        radii: of the spheres that it is to hold, where a question does not say.
        free_space: to begin with; what is not free of the obstacles is left out.
    """

    def __init__(
        self,
        obstacles: Sequence[Piece],
        bounds: ArrayLike,
        radii: ArrayLike = (),
        free_space: FreeSpace = NOTHING,
    ) -> None:
        self.obstacles, self.bounds = tuple(obstacles), np.asarray(bounds, dtype=float)
        self.counts = PoolCounts()
        self._radii = np.unique(np.asarray(radii, dtype=float))
        self._space = still_free(free_space, self.obstacles)
        self._in_vain: set[bytes] = set()
        self._packed: ObstacleArrays | None = None
        self._inflation: CuboidInflation | None = None

    @property
    def free_space(self) -> FreeSpace:
        """All of it: the same object until it grows."""
        return self._space

    def among(self, obstacles: Sequence[Piece], radii: ArrayLike | None = None) -> FreeSpacePool:
        """A pool of its own that begins with what of this one is free of other obstacles; for other spheres, if given.

        Only obstacles that this one does not know are looked at.
        """
        known = set(map(id, self.obstacles))
        fresh = [piece for piece in obstacles if id(piece) not in known]
        pool = FreeSpacePool(obstacles, self.bounds, self._radii if radii is None else radii)
        pool._space = still_free(self._space, fresh)
        return pool

    def grow(self, points: ArrayLike, radii: ArrayLike | None = None) -> FreeSpace:
        """Adds what holds spheres around points, where nothing does yet; returns the whole.

        A cuboid from each centre (Algorithm 3); where that holds less of the sphere than fits there, one from the
        sphere's bounding cube; where that is not free but the sphere is, a polytope. Points inside obstacles add
        nothing. No points: what there is.

        Args:
            points: (k, 3) centres in the world frame, metres.
            radii: (k,) metres; None: the largest of the pool's that is free there.

        Raises:
            InputError: points or radii of the wrong shape, or not finite.
        """
        centre, radius = _checked(points, radii)
        if not len(centre):
            return self._space
        began = clock.cpu_seconds()
        room = self._room(centre)
        if radii is None:
            at = np.searchsorted(self._radii, room, side="right") - 1
            radius = np.where(at >= 0, np.append(self._radii, 0.0)[at], 0.0)
        fits = np.minimum(radius, room)  # of a sphere that touches something, what is free of it
        left = (room > 0) & ~self.holds(centre, fits) & ~self._were_in_vain(centre)
        seeds = int(np.count_nonzero(left))
        if left.any() and len(self._space) < MOST_CUBOIDS:
            left = self._add_cuboids(centre, fits, left)
            self._add_polytopes(centre, radius, left & (radius <= room))
            self._in_vain |= {key.tobytes() for key in _cells(centre[left & ~self.holds(centre, fits)])}
        now = self.counts
        spent = now.cpu_s + clock.cpu_seconds() - began
        self.counts = PoolCounts(now.calls + 1, now.points + len(centre), now.seeds + seeds, spent)
        return self._space

    def holds(self, centres: ArrayLike, radii: ArrayLike) -> NDArray[np.bool_]:
        """Which spheres, centres (..., m, 3) and radii (m,), are inside a cuboid or polytope: bool (..., m)."""
        centre, radius = np.asarray(centres, dtype=float), np.asarray(radii, dtype=float)
        held: NDArray[np.bool_] = np.any(holds_spheres(self._space, centre, radius), axis=-1)
        for polytope in self._space.polytopes:
            held = held | polytope.holds_spheres(centre, radius)
        return held

    def _room(self, points: Array) -> Array:
        """(k,) metres of free space around points (k, 3), up to obstacles and bounds."""
        if self._packed is None:
            self._packed = ObstacleArrays(self.obstacles)
        walls = np.minimum(points - self.bounds[0], self.bounds[1] - points).min(axis=1)
        room: Array = np.minimum(walls, self._packed.nearest(points)[0]) - _KEPT_OFF
        return room

    def _were_in_vain(self, points: Array) -> NDArray[np.bool_]:
        return np.array([key.tobytes() in self._in_vain for key in _cells(points)], dtype=bool)

    def _add_cuboids(self, centre: Array, fits: Array, left: NDArray[np.bool_]) -> NDArray[np.bool_]:
        """Which spheres (k,) are left, once cuboids were grown for those that were."""
        if self._inflation is None:
            self._inflation = CuboidInflation(self.obstacles, self.bounds)
        self._join(self._inflation.cuboids(centre[left]))
        left = left & ~self.holds(centre, fits)
        if left.any():
            self._join(self._inflation.cuboids(centre[left], half=fits[left]))
            left &= ~self.holds(centre, fits)
        return left

    def _add_polytopes(self, centre: Array, radius: Array, left: NDArray[np.bool_]) -> None:
        """Polytopes around the spheres that are left, one after another, until each is inside one."""
        for k in np.flatnonzero(left):
            if len(self._space.polytopes) >= MOST_POLYTOPES or self.holds(
                centre[k : k + 1], radius[k : k + 1]
            ):
                continue
            found = inflate_polytope(centre[k], self.obstacles, self.bounds, radius=float(radius[k]))
            if found is not None:
                self._space = replace(self._space, polytopes=(*self._space.polytopes, found))

    def _join(self, more: FreeSpace) -> None:
        """Takes more cuboids in, and leaves out what then lies in another one; the others keep their order."""
        lower, upper = np.vstack([self._space.lower, more.lower]), np.vstack([self._space.upper, more.upper])
        margin = np.concatenate([_margin(self._space), _margin(more)])
        kept = np.sort(outermost(lower, upper))
        if len(kept) != len(self._space) or np.any(kept >= len(self._space)):
            skipped = self._space.skipped_seeds + more.skipped_seeds
            polytopes: tuple[FreePolytope, ...] = self._space.polytopes
            self._space = FreeSpace(
                lower[kept],
                upper[kept],
                margin=margin[kept],
                skipped_seeds=skipped,
                polytopes=polytopes,
            )


def _margin(free_space: FreeSpace) -> Array:
    return np.zeros(len(free_space)) if free_space.margin is None else free_space.margin


def _cells(points: Array) -> NDArray[np.int64]:
    return np.round(points / _CELL).astype(np.int64)


def _checked(points: ArrayLike, radii: ArrayLike | None) -> tuple[Array, Array]:
    try:
        centre = np.asarray(points, dtype=float)
        radius = np.asarray(0.0 if radii is None else radii, dtype=float)
    except (TypeError, ValueError):
        raise InputError("points and radii are not arrays of numbers", where="points") from None
    if centre.size == 0:
        centre = centre.reshape(0, 3)
    if centre.ndim != 2 or centre.shape[1] != 3 or radius.shape not in ((), (len(centre),)):
        raise InputError(
            f"points of shape {centre.shape} with radii of shape {radius.shape}",
            where="points",
            remedy="arrays (k, 3) and (k,)",
        )
    if not (np.isfinite(centre).all() and np.isfinite(radius).all() and np.all(radius >= 0)):
        raise InputError("points must be finite, and radii zero or more", where="points")
    return centre, np.broadcast_to(radius, (len(centre),))
