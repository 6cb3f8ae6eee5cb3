"""CIDGIK's relaxation (Problem 3 and 4) of one structure, reduced, and on a Clarabel instance that is reused.

Equalities are solved for: what is left are free coordinates y with Z = Z0 + sum_i y_i Z_i, in which the set has an
interior. So the cone program has no equality rows, redundant ones among them, and stays small.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from workcell.ik.cidgik_goals import Goal
from workcell.ik.cidgik_reduction import Reduction, Vectors, goal_columns
from workcell.ik.cidgik_rows import FrameRows, LimitRows, products, rigid_rows, stack
from workcell.ik.cidgik_skeleton import Skeleton
from workcell.ik.conic import Cones, ConicSolution, ConicSolver, triangle
from workcell.pose import Array

_RANK = 1e-7
_ZERO = 1e-10
SLOT_SIZES = (0, 4, 12, 32, 96)
"""Numbers of workspace rows that cone programs are made for."""


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
    """What all queries of a robot with the same kinds of goals, points and limits share.

    Attributes:
        reduction, rigid, limits, frames: vectors and rows.
        dropped: basis vectors that are left out.
        keep: indices of [X; I] that stay.
        used: equality rows that stay, independent of each other.
    """

    def __init__(self, skeleton: Skeleton, points: tuple[Vectors, ...] = ()) -> None:
        self.skeleton = skeleton
        self.reduction = Reduction(skeleton)
        self.rigid = rigid_rows(self.reduction)
        self.limits = LimitRows(self.reduction)
        self.frames = FrameRows(self.reduction)
        r, d = self.reduction.rank, skeleton.dimension
        self._order = r + d
        rng = np.random.default_rng(7)
        G = self.sample_goal(rng)
        rows, constants = self.equalities(G)
        self._pinned: set[int] = set()
        self.dropped: tuple[Dropped, ...] = ()
        self._drop(rows, constants, G)
        gone = {entry.index for entry in self.dropped}
        self.keep = np.array([k for k in range(self._order) if k not in gone])
        self.rank, self.order = len(self.keep) - d, len(self.keep)
        place = _places(self._order)
        a, b, _ = triangle(self.order)
        self.sub = place[self.keep[a], self.keep[b]]
        self.free = a < self.rank
        self.fixed_value = (a == b).astype(float)[~self.free]
        self.used = self._select(rows, gone)
        self.metric = self._metric(gone)
        self.idle: dict[int, list[ConicSolver]] = {}

    def sample_goal(self, rng: np.random.Generator) -> Array:
        """The goals' columns at some configuration."""
        q = rng.uniform(-2.5, 2.5, self.skeleton.robot.dof)
        return self.columns_at(q)

    def columns_at(self, q: Array) -> Array:
        """The goals' columns (g, d) if the robot stood at q (n,)."""
        from workcell.ik.cidgik_reduction import _base_transforms, _goal_columns_of

        return _goal_columns_of(self.skeleton, _base_transforms(self.skeleton, q[None]))[0]

    def equalities(self, G: Array) -> tuple[Array, Array]:
        """All (m, K) triangles over the whole basis and their (m,) constants."""
        packed, constant = self.rigid.at(G)
        turned = self.frames.equalities(G)
        return np.vstack([packed, turned]), np.concatenate([constant, np.zeros(len(turned))])

    def _drop(self, rows: Array, constants: Array, G: Array) -> None:
        """Find basis vectors v with no rows but |v| = 1 and v normal to at most d - 1 others."""
        a, b, _ = triangle(self._order)
        r, d = self.reduction.rank, self.skeleton.dimension
        if self.skeleton.dimension == 2:
            return
        pinned = self._inequality_columns(G)
        live = np.ones(len(rows), dtype=bool)
        for v in range(r):
            touching = np.flatnonzero(live & np.any(np.abs(rows[:, (a == v) | (b == v)]) > _ZERO, axis=1))
            if v in pinned or not self._only_normal(rows[touching], constants[touching], v):
                continue
            mixed = [int(k) for k in touching if np.any(np.abs(rows[k, a != b]) > _ZERO)]
            others = np.array([_others(rows[k], v, self._order) for k in mixed]).reshape(-1, self._order)
            independent = _independent_rows(others)
            if len(independent) < d:
                self.dropped = (*self.dropped, Dropped(v, tuple(mixed[k] for k in independent)))
                live[touching] = False

    def _only_normal(self, rows: Array, constants: Array, v: int) -> bool:
        """Whether rows say no more of v than its length, or that it is normal to something."""
        a, b, _ = triangle(self._order)
        own, with_others = (a == v) & (b == v), ((a == v) | (b == v)) & (a != b)
        rest = ~(own | with_others)
        if np.any(np.abs(rows[:, rest]) > _ZERO):
            return False
        length = np.abs(rows[:, own]).max(axis=1, initial=0.0) > _ZERO
        normal = np.abs(rows[:, with_others]).max(axis=1, initial=0.0) > _ZERO
        return not np.any(length & normal) and not np.any(normal & (np.abs(constants) > _ZERO))

    def _inequality_columns(self, G: Array) -> set[int]:
        """Basis vectors in limits, in free frames or in points: these can't be left out."""
        a, b, _ = triangle(self._order)
        limits, _ = self.limits.at(G, np.full(self.skeleton.robot.dof, 0.3), np.ones(self.skeleton.robot.dof))
        quaternions, _ = self.frames.quaternions(G)
        used = np.any(np.abs(limits) > _ZERO, axis=0) | np.any(np.abs(quaternions) > _ZERO, axis=(0, 1))
        found = set(a[used]) | set(b[used])
        for link, local in self.skeleton.points:
            found |= set(np.flatnonzero(self.reduction.point(link, local).alpha))
        return found

    def _select(self, rows: Array, gone: set[int]) -> Array:
        """Equality rows without dropped vectors, as many as are independent."""
        from scipy.linalg import qr

        a, b, _ = triangle(self._order)
        touched = np.zeros(len(rows), dtype=bool)
        for v in gone:
            touched |= np.any(np.abs(rows[:, (a == v) | (b == v)]) > _ZERO, axis=1)
        left = np.flatnonzero(~touched)
        A = rows[np.ix_(left, self.sub)][:, self.free]
        if not A.size:
            return np.zeros(0, dtype=np.int64)
        _, R, order = qr(A.T, mode="economic", pivoting=True)
        scale = np.abs(np.diag(R))
        rank = int(np.count_nonzero(scale > _RANK * max(scale[0], 1e-300)))
        return np.sort(left[order[:rank]])

    def _metric(self, gone: set[int]) -> Vectors:
        """The paper's points p_i, q_i (and those along a frame's other axes) in whose metric ranks are weighed."""
        chosen = []
        for link in range(1, self.skeleton.robot.dof + 1):
            if link in self.skeleton.known:
                continue
            origin = self.reduction.point(link, np.zeros(3))
            chosen.append(origin)
            directions = self.reduction.directions[link]
            count = len(directions.alpha) if link in self.skeleton.framed else 1
            for k in range(count):
                parts = (getattr(origin, n) + getattr(directions, n)[k] for n in ("alpha", "base", "goal"))
                chosen.append(Vectors(*parts))
        free = [v for v in chosen if not any(v.alpha[k] for k in gone) and np.any(v.alpha)]
        return stack(free, self.reduction.origins)


def _places(order: int) -> Array:
    place = np.zeros((order, order), dtype=np.int64)
    a, b, _ = triangle(order)
    place[a, b] = place[b, a] = np.arange(len(a))
    return place


def _others(row: Array, v: int, order: int) -> Array:
    """What a row says v is normal to: coefficients (order,) over [X; I]."""
    a, b, factor = triangle(order)
    out = np.zeros(order)
    for entries, other in ((a == v, b), (b == v, a)):
        mask = entries & (a != b)
        out[other[mask]] += row[mask] * factor[mask]
    return out


def _independent_rows(rows: Array) -> list[int]:
    kept: list[int] = []
    for k in range(len(rows)):
        if np.linalg.matrix_rank(rows[[*kept, k]], tol=_RANK) > len(kept):
            kept.append(k)
    return kept


class Instance:
    """The relaxation at given goals and limits.

    Attributes:
        structure, G: what is shared, and the goals' columns.
        Z0, directions: (K,) and (K, f): svec(Z) = Z0 + directions y.
        metric: (N, N) lower triangular L; ranks are weighed on L^T Z L.
        solves: cone programs so far.
    """

    def __init__(
        self, structure: Structure, goals: tuple[Goal, ...], lower: Array, upper: Array, slack: float
    ) -> None:
        self.structure = structure
        self.G = goal_columns(structure.skeleton, goals)
        self.middle, self.half = 0.5 * (lower + upper), 0.5 * (upper - lower) + slack
        self._solve_equalities()
        limits, least = structure.limits.at(self.G, self.middle, np.minimum(self.half, np.pi))
        self.limit_rows = self._reduced(limits, -least)
        blocks, constant = structure.frames.quaternions(self.G)
        self.quaternion_rows = self._reduced(
            blocks.reshape(-1, blocks.shape[-1]), np.tile(constant, len(blocks))
        )
        W = np.vstack(
            [structure.metric.at(self.G)[:, structure.keep], np.eye(structure.order)[structure.rank :]]
        )
        self.metric = np.linalg.cholesky(W.T @ W + 1e-9 * np.eye(structure.order))
        self.slots = np.zeros((0, self.directions.shape[1] + 1))
        self.solves = 0
        self._solver: ConicSolver | None = None
        self._slot_count = -1
        self._stale = True

    def _solve_equalities(self) -> None:
        structure = self.structure
        packed, constants = structure.equalities(self.G)
        rows, constants = packed[np.ix_(structure.used, structure.sub)], constants[structure.used]
        free = structure.free
        A, b = rows[:, free], constants - rows[:, ~free] @ structure.fixed_value
        m = len(A)
        Q, R = np.linalg.qr(A.T, mode="complete")
        x0 = Q[:, :m] @ np.linalg.solve(R[:m].T, b) if m else np.zeros(int(free.sum()))
        size = len(free)
        self.Z0, self.directions = np.zeros(size), np.zeros((size, int(free.sum()) - m))
        self.Z0[free], self.Z0[~free] = x0, structure.fixed_value
        self.directions[free] = Q[:, m:]

    def _reduced(self, packed: Array, constant: Array) -> Array:
        """(m, f + 1) rows over (y, 1) from triangles over the whole basis (dropped vectors do not occur)."""
        rows = packed[:, self.structure.sub]
        return np.column_stack([rows @ self.directions, rows @ self.Z0 + constant])

    def vector(self, vectors: Vectors) -> Array:
        """Coefficients (..., N) over the kept [X; I]."""
        kept: Array = vectors.at(self.G)[..., self.structure.keep]
        return kept

    def rows_of(self, a: Array, b: Array) -> Array:
        """(m, f + 1) rows over (y, 1) of products of vectors (m, N)."""
        packed = products(a, b)
        return np.column_stack([packed @ self.directions, packed @ self.Z0])

    def set_slots(self, rows: Array) -> None:
        """Demand `rows (y, 1) >= 0` beside the limits; earlier ones are forgotten."""
        self.slots, self._stale = rows, True

    def solve(self, C: Array) -> ConicSolution:
        """Minimise <C, Z> for a symmetric (N, N) C; x are the coordinates y."""
        from workcell.ik.conic import svec

        q = self.directions.T @ svec(C)
        b = values = None
        if self._stale:
            count = next((size for size in SLOT_SIZES if size >= len(self.slots)), len(self.slots))
            A, b = self._numbers(count)
            if count != self._slot_count:
                self.release()
                fresh = self._acquire(A, b, count)
            else:
                fresh = False
            values = None if fresh else A.T.ravel()
            b = None if fresh else b
            self._stale = False
        assert self._solver is not None
        self.solves += 1
        return self._solver.solve(q, b=b, values=values)

    def _numbers(self, count: int) -> tuple[Array, Array]:
        f = self.directions.shape[1]
        empty = np.zeros((count - len(self.slots), f + 1))
        empty[:, -1] = 1.0
        rows = np.vstack(
            [
                self.limit_rows,
                self.slots,
                empty,
                np.column_stack([self.directions, self.Z0]),
                self.quaternion_rows,
            ]
        )
        return -rows[:, :-1], rows[:, -1]

    def _acquire(self, A: Array, b: Array, count: int) -> bool:
        """Take an idle solver of this shape, or make one (True: it has these numbers)."""
        from scipy.sparse import csc_matrix

        idle = self.structure.idle.setdefault(count, [])
        self._slot_count = count
        if idle:
            self._solver = idle.pop()
            return False
        rows, f = A.shape
        indices, starts = np.tile(np.arange(rows), f), np.arange(f + 1) * rows
        sparse = csc_matrix((A.T.ravel(), indices, starts), shape=A.shape)
        frames = len(self.quaternion_rows) // 10
        cones = Cones(0, len(self.limit_rows) + count, (), (self.structure.order, *(4,) * frames))
        self._solver = ConicSolver(sparse, b, cones)
        return True

    def release(self) -> None:
        """Hand the solver back for the next query of this structure."""
        if self._solver is not None:
            self.structure.idle.setdefault(self._slot_count, []).append(self._solver)
            self._solver, self._slot_count, self._stale = None, -1, True

    def matrix(self, y: Array) -> Array:
        """Z (N, N)."""
        from workcell.ik.conic import smat

        return smat(self.Z0 + self.directions @ y, self.structure.order)

    def basis(self, Z: Array) -> Array:
        """X (r, d) over the whole basis, dropped vectors filled in: normal to what they must be."""
        structure = self.structure
        d = structure.skeleton.dimension
        full = np.zeros((structure.reduction.rank + d, d))
        full[-d:] = np.eye(d)
        full[structure.keep[:-d]] = Z[: structure.rank, structure.rank :]
        if structure.dropped:
            rows, _ = structure.equalities(self.G)
            for entry in structure.dropped:
                full[entry.index] = 0.0
                normals = [_others(rows[k], entry.index, len(full)) @ full for k in entry.rows]
                full[entry.index] = _normal_to(normals)
        return full[:-d]


def _normal_to(vectors: list[Array]) -> Array:
    """A unit vector normal to up to two others."""
    first = vectors[0] if vectors else np.array([1.0, 0.0, 0.0])
    second = vectors[1] if len(vectors) > 1 else np.eye(3)[int(np.argmin(np.abs(first)))]
    n = np.cross(first, second)
    length = float(np.linalg.norm(n))
    if length < 1e-9:
        helper = first if np.linalg.norm(first) > 1e-9 else second
        n = np.cross(helper, np.eye(3)[int(np.argmin(np.abs(helper)))])
        length = float(np.linalg.norm(n))
    return n / length if length > 0 else np.array([1.0, 0.0, 0.0])
