"""CIDGIK's relaxation, the part that all queries of one robot share: vectors, rows, and which are needed."""

from __future__ import annotations

from dataclasses import dataclass
from functools import lru_cache
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from workcell.ik.cidgik.reduction import Reduction, Vectors, stack
from workcell.ik.cidgik.rows import FrameRows, LimitRows, rigid_rows
from workcell.ik.cidgik.skeleton import Skeleton
from workcell.ik.shared.conic import triangle
from workcell.pose import Array

if TYPE_CHECKING:
    from workcell.ik.shared.conic import ConicSolver

_RANK = 1e-7
_ZERO = 1e-10
_SEED = 7


@dataclass(frozen=True, slots=True)
class Dropped:
    """A unit vector of the basis that need only be normal to one or two others, and so is left out.

    Attributes:
        index: in the whole basis.
        rows: of the equalities, that say what it is normal to.
    """

    index: int
    rows: tuple[int, ...]


class Structure:
    """What all queries of a robot with the same kinds of goals, points and limits share; of some `links`, or of all.

    Attributes:
        skeleton, reduction, rigid, limits, frames: vectors and rows.
        whole: number of columns of [X; I], dropped ones included.
        dropped: basis vectors that are left out.
        keep: indices of [X; I] that stay; the last `dimension` are I.
        rank, order: number of columns of X that stay, and of [X; I].
        sub: (K,) places of Z's triangle in the triangle over the whole basis.
        free: (K,) which entries of Z are variables (the others are those of I).
        used: equality rows that stay, independent of each other.
        metric: the paper's points.
        points: the skeleton's points on these links, in their order.
        idle: solvers by number of slots, of standing rows and of free coordinates.
    """

    def __init__(self, skeleton: Skeleton, links: tuple[int, ...] | None = None) -> None:
        self.skeleton = skeleton
        self.reduction = Reduction(skeleton, links)
        self.rigid = rigid_rows(self.reduction)
        self.limits = LimitRows(self.reduction)
        self.frames = FrameRows(self.reduction)
        self.whole = self.reduction.rank + skeleton.dimension
        G = self.reduction.columns_at(np.random.default_rng(_SEED).uniform(-2.5, 2.5, skeleton.robot.dof))
        rows, constants = self.equalities(G)
        # what is dropped from a part might be normal to something outside of it
        self.dropped = self._droppable(rows, constants, self._pinned(G)) if links is None else ()
        gone = {entry.index for entry in self.dropped}
        self.keep = np.array([k for k in range(self.whole) if k not in gone])
        self.order = len(self.keep)
        self.rank = self.order - skeleton.dimension
        a, b, _ = triangle(self.order)
        self.sub = places(self.whole)[self.keep[a], self.keep[b]]
        self.free = a < self.rank
        self.fixed_value = (a == b).astype(float)[~self.free]
        self.used = self._select(rows, gone)
        self.metric = self._metric(gone)
        held = [(link, local) for link, local in skeleton.points if link in self.reduction.links]
        self.points = stack([self.reduction.point(*one) for one in held], self.reduction.like)
        self.idle: dict[tuple[int, int, int], list[ConicSolver]] = {}

    def equalities(self, G: Array) -> tuple[Array, Array]:
        """All (m, K) triangles over the whole basis and their (m,) constants."""
        packed, constant = self.rigid.at(G)
        turned = self.frames.equalities(G)
        return np.vstack([packed, turned]), np.concatenate([constant, np.zeros(len(turned))])

    def _droppable(self, rows: Array, constants: Array, pinned: set[int]) -> tuple[Dropped, ...]:
        """Basis vectors v with no rows but |v| = 1 and v normal to at most two others."""
        if self.skeleton.dimension == 2:
            return ()
        a, b, _ = triangle(self.whole)
        live, found = np.ones(len(rows), dtype=bool), []
        for v in sorted(set(range(self.reduction.rank)) - pinned):
            mine = (a == v) | (b == v)
            touching = np.flatnonzero(live & np.any(np.abs(rows[:, mine]) > _ZERO, axis=1))
            if not self._only_normal(rows[touching], constants[touching], v):
                continue
            mixed = [int(k) for k in touching if np.any(np.abs(rows[k, a != b]) > _ZERO)]
            others = others_in(rows[mixed], v, self.whole)
            independent = _independent_rows(others)
            if len(independent) <= 2:
                found.append(Dropped(v, tuple(mixed[k] for k in independent)))
                live[touching] = False
        return tuple(found)

    def _only_normal(self, rows: Array, constants: Array, v: int) -> bool:
        """Whether rows say no more of v than its length, or that it is normal to something."""
        a, b, _ = triangle(self.whole)
        own, with_others = (a == v) & (b == v), ((a == v) | (b == v)) & (a != b)
        if np.any(np.abs(rows[:, ~(own | with_others)]) > _ZERO):
            return False
        length = np.abs(rows[:, own]).max(axis=1, initial=0.0) > _ZERO
        normal = np.abs(rows[:, with_others]).max(axis=1, initial=0.0) > _ZERO
        return not np.any(length & normal) and not np.any(normal & (np.abs(constants) > _ZERO))

    def _pinned(self, G: Array) -> set[int]:
        """Basis vectors in limits, in free frames or in points: these can't be left out."""
        a, b, _ = triangle(self.whole)
        n = self.skeleton.robot.dof
        limits, _ = self.limits.at(G, np.full(n, 0.3), np.ones(n))
        quaternions, _ = self.frames.quaternions(G)
        used = np.any(np.abs(limits) > _ZERO, axis=0) | np.any(np.abs(quaternions) > _ZERO, axis=(0, 1))
        found = set(a[used].tolist()) | set(b[used].tolist())
        for link, local in self.skeleton.points:
            found |= set(np.flatnonzero(self.reduction.point(link, local).alpha).tolist())
        return found

    def _select(self, rows: Array, gone: set[int]) -> Array:
        """Equality rows without dropped vectors, as many as are independent."""
        from scipy.linalg import qr

        a, b, _ = triangle(self.whole)
        dead = np.isin(a, list(gone)) | np.isin(b, list(gone))
        left = np.flatnonzero(~np.any(np.abs(rows[:, dead]) > _ZERO, axis=1))
        A = rows[np.ix_(left, self.sub)][:, self.free]
        if not A.size:
            return np.zeros(0, dtype=np.int64)
        _, R, order = qr(A.T, mode="economic", pivoting=True)
        scale = np.abs(np.diag(R))
        rank = int(np.count_nonzero(scale > _RANK * max(float(scale[0]), _ZERO)))
        chosen: Array = np.sort(left[order[:rank]])
        return chosen

    def _metric(self, gone: set[int]) -> Vectors:
        """The paper's points p_i, q_i (and those along a frame's other axes) in whose metric ranks are weighed."""
        chosen = []
        for link in self.reduction.links:
            if link in self.skeleton.known:
                continue
            origin, directions = self.reduction.point(link, np.zeros(3)), self.reduction.directions[link]
            count = len(directions.alpha) if link in self.skeleton.framed else 1
            chosen += [origin] + [origin.plus(directions.one(k)) for k in range(count)]
        moving = [v for v in chosen if not any(v.alpha[k] for k in gone) and np.any(v.alpha)]
        return stack(moving, self.reduction.like)


@lru_cache(maxsize=64)
def places(order: int) -> NDArray[np.int64]:
    """(order, order) for each entry of a symmetric matrix its place in the triangle."""
    place = np.zeros((order, order), dtype=np.int64)
    a, b, _ = triangle(order)
    place[a, b] = place[b, a] = np.arange(len(a))
    return place


def others_in(rows: Array, v: int, order: int) -> Array:
    """What rows (m, K) say column v is normal to: coefficients (m, order) over [X; I]."""
    place, (_, _, factor) = places(order)[v], triangle(order)
    found: Array = rows[:, place] * factor[place]
    found[:, v] = 0.0
    return found


def _independent_rows(rows: Array) -> list[int]:
    kept: list[int] = []
    for k in range(len(rows)):
        if np.linalg.matrix_rank(rows[[*kept, k]], tol=_RANK) > len(kept):
            kept.append(k)
    return kept
