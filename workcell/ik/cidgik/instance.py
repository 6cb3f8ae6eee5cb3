"""CIDGIK's relaxation at one query's goals and limits (Problems 3 and 4), on a Clarabel solver that is reused.

The equalities are solved first: what is left are free coordinates y with svec(Z) = Z0 + D y, in which the set has an
interior. The cone program then has no equality rows, redundant ones among them, and stays small.
"""

from __future__ import annotations

import math

import numpy as np

from workcell.ik.cidgik.reduction import Vectors, goal_columns
from workcell.ik.cidgik.rows import products
from workcell.ik.cidgik.structure import Structure, others_in
from workcell.ik.shared.conic import Cones, ConicSolution, ConicSolver, smat, svec
from workcell.ik.trees.query import PLANE_SLACK, Goal
from workcell.pose import Array

SLOT_SIZES = (0, 4, 12, 32, 96, 192)
"""Numbers of workspace rows that cone programs are made for: empty slots cost time, so does a new program."""
_RIDGE = 1e-9
_INDEPENDENT = 1e-7
_PARALLEL = 1e-9
_BROKEN = 1e-6
_SINGULAR = 1e-9


class Instance:
    """One query's relaxation, ready to be minimised over.

    Attributes:
        structure: what is shared.
        G: (g, d) the goals' columns.
        middle, half: (n,) of the joint intervals, radians.
        Z0, D: (K,) and (K, f): svec(Z) = Z0 + D y.
        limit_rows, frame_rows: (m, f + 1) over (y, 1): nonnegative, and triangles of 4x4 matrices.
        metric: (N, N) lower triangular L; ranks are weighed on L^T Z L.
        standing: (m, f + 1) rows that stay whatever the slots hold, nonnegative.
        added: points in planes, `(point, normal, offset)`, that are equalities too.
        contradiction: whether one of these can't hold.
        solves: cone programs so far.
    """

    def __init__(
        self,
        structure: Structure,
        goals: tuple[Goal, ...],
        middle: Array,
        half: Array,
        planes: tuple[tuple[Vectors, Array, float], ...] = (),
    ) -> None:
        self.structure = structure
        self.G = goal_columns(structure.skeleton, goals)
        self.middle, self.half = middle, np.minimum(half, np.pi)
        self.added, self.contradiction = planes, False
        self._packed, self._constants = structure.equalities(self.G)
        self._solve_equalities()
        for point, normal, offset in planes:
            self._add_equality(point, normal, offset)
        limits, least = structure.limits.at(self.G, self.middle, self.half)
        self.limit_rows = self.reduced(limits[:, structure.sub], -least)
        blocks, constant = structure.frames.quaternions(self.G)
        triangles = blocks.reshape(-1, blocks.shape[-1])[:, structure.sub]
        self.frame_rows = self.reduced(triangles, np.tile(constant, len(blocks)))
        W = structure.metric.at(self.G)[:, structure.keep]
        gram = W.T @ W + _RIDGE * np.eye(structure.order)
        gram[structure.rank :, structure.rank :] += np.eye(structure.skeleton.dimension)
        self.metric = np.linalg.cholesky(gram)
        self.slots = self.standing = np.zeros((0, self.D.shape[1] + 1))
        self.solves = 0
        self._solver: ConicSolver | None = None
        self._size = -1
        self._stale = True

    def equalities(self) -> tuple[Array, Array]:
        """A (m, v) and b (m,) over the variable entries of svec(Z): the structure's equalities, then the added ones."""
        structure = self.structure
        rows = self._packed[np.ix_(structure.used, structure.sub)]
        constants = self._constants[structure.used]
        if self.added:
            rows = np.vstack([rows, *(self._plane_row(point, normal) for point, normal, _ in self.added)])
            constants = np.append(constants, [offset for _, _, offset in self.added])
        return rows[:, structure.free], constants - rows[:, ~structure.free] @ structure.fixed_value

    def _solve_equalities(self) -> None:
        A, b = self.equalities()
        A, b = A[: len(self.structure.used)], b[: len(self.structure.used)]
        free, m = self.structure.free, len(A)
        Q, R = np.linalg.qr(A.T, mode="complete")
        sizes = np.abs(np.diag(R))
        if m and sizes.min() > _SINGULAR * sizes.max():
            x0, rest = Q[:, :m] @ np.linalg.solve(R[:m].T, b), Q[:, m:]
        else:
            # at a few goals rows that are independent elsewhere say the same
            U, s, Vt = np.linalg.svd(A)
            kept = int(np.count_nonzero(s > _SINGULAR * s.max(initial=0.0)))
            x0, rest = Vt[:kept].T @ ((U[:, :kept].T @ b) / s[:kept]), Vt[kept:].T
        self.Z0, self.D = np.zeros(len(free)), np.zeros((len(free), rest.shape[1]))
        self.Z0[~free] = self.structure.fixed_value
        self.Z0[free], self.D[free] = x0, rest

    def _plane_row(self, point: Vectors, normal: Array) -> Array:
        """Triangle (K,) of normal . point."""
        constant = np.zeros(self.structure.order)
        constant[-len(normal) :] = normal
        return products(self.vector(point), constant)

    def _add_equality(self, point: Vectors, normal: Array, offset: float) -> None:
        """Solve for normal . point = offset as well."""
        row = self.reduced(self._plane_row(point, normal)[None], np.zeros(1))[0]
        size, missing = float(np.linalg.norm(row[:-1])), offset - float(row[-1])
        if size < _INDEPENDENT:
            self.contradiction |= abs(missing) > PLANE_SLACK
            return
        step = row[:-1] / size
        self.Z0 = self.Z0 + self.D @ step * (missing / size)
        self.D = self.D @ np.linalg.qr(step[:, None], mode="complete")[0][:, 1:]

    def reduced(self, packed: Array, constant: Array) -> Array:
        """(m, f + 1) rows over (y, 1) of triangles (m, K) in Z and constants (m,)."""
        rows: Array = np.column_stack([packed @ self.D, packed @ self.Z0 + constant])
        return rows

    def vector(self, vectors: Vectors) -> Array:
        """Coefficients (..., N) over the kept [X; I]."""
        kept: Array = vectors.at(self.G)[..., self.structure.keep]
        return kept

    def rows_of(self, a: Array, b: Array) -> Array:
        """(m, f + 1) rows over (y, 1) of products of vectors (m, N)."""
        return self.reduced(products(a, b), np.zeros(len(a)))

    def set_slots(self, rows: Array) -> None:
        """Demand `rows (y, 1) >= 0` beside the limits, rows (k, f + 1); earlier ones are forgotten."""
        self.slots, self._stale = rows, True

    def stand(self, rows: Array) -> None:
        """Demand `rows (y, 1) >= 0` from the first solve on, rows (k, f + 1): no proof may lean on them."""
        self.standing = rows

    def solve(self, C: Array) -> ConicSolution:
        """Minimise <C, Z> for a symmetric C (N, N). x are the coordinates y; z is over `rows()`, then empty slots."""
        self.solves += 1
        if self.determined:
            return self._looked_at()
        q = self.D.T @ svec(C)
        if not self._stale:
            assert self._solver is not None  # the first solve is always stale
            return self._solver.solve(q)
        self._stale = False
        size = next((size for size in SLOT_SIZES if size >= len(self.slots)), len(self.slots))
        A, b = self._numbers(size)
        if size != self._size:
            self._hand_back()
            self._size = size
            idle = self._idle(size)
            if not idle:
                self._solver = self._new_solver(A, b, size)
                return self._solver.solve(q)
            self._solver = idle.pop()
        assert self._solver is not None
        return self._solver.solve(q, b=b, values=A.T.ravel())

    @property
    def determined(self) -> bool:
        """Whether the equalities leave a single Z: nothing is to be minimised."""
        return bool(self.D.shape[1] == 0)

    def _looked_at(self) -> ConicSolution:
        """The only Z, or a ray that says which row it breaks."""
        inequalities = np.concatenate([self.limit_rows[:, -1], self.standing[:, -1], self.slots[:, -1]])
        values, vectors = np.linalg.eigh(smat(self.Z0, self.structure.order))
        z = np.zeros(len(inequalities) + len(self.Z0) + len(self.frame_rows))
        broken = True
        if inequalities.min(initial=0.0) < -_BROKEN:
            z[int(inequalities.argmin())] = 1.0
        elif values[0] < -_BROKEN:
            v = vectors[:, :1]
            z[len(inequalities) : len(inequalities) + len(self.Z0)] = svec(v @ v.T)
        else:
            broken = False
        return ConicSolution("infeasible" if broken else "solved", np.zeros(0), z, 0.0, 0)

    def _numbers(self, size: int) -> tuple[Array, Array]:
        """A and b: limits, standing rows, slots (the empty ones last, 1 >= 0), Z, frames."""
        empty = np.zeros((size - len(self.slots), self.D.shape[1] + 1))
        empty[:, -1] = 1.0
        whole = np.column_stack([self.D, self.Z0])
        rows = np.vstack([self.limit_rows, self.standing, self.slots, empty, whole, self.frame_rows])
        return -rows[:, :-1], rows[:, -1]

    def _new_solver(self, A: Array, b: Array, size: int) -> ConicSolver:
        from scipy.sparse import csc_matrix

        m, f = A.shape
        # every entry is stored: the pattern must hold for all queries
        sparse = csc_matrix((A.T.ravel(), np.tile(np.arange(m), f), np.arange(f + 1) * m), shape=A.shape)
        frames = (4,) * (len(self.frame_rows) // 10)
        inequalities = len(self.limit_rows) + len(self.standing) + size
        return ConicSolver(sparse, b, Cones(0, inequalities, (), (self.structure.order, *frames)))

    def split(self, z: Array) -> tuple[Array, Array, Array, Array]:
        """A dual over limits, slots in use, Z (K,) and frames (k, 10)."""
        limits, used, K = len(self.limit_rows), len(self.slots), len(self.Z0)
        begin = limits + len(self.standing)
        first = begin + max(self._size, used)
        return (
            z[:limits],
            z[begin : begin + used],
            z[first : first + K],
            z[first + K :].reshape(-1, 10),
        )

    def _idle(self, size: int) -> list[ConicSolver]:
        """Solvers of this shape that no query uses."""
        return self.structure.idle.setdefault((size, len(self.standing), self.D.shape[1]), [])

    def _hand_back(self) -> None:
        if self._solver is not None:
            self._idle(self._size).append(self._solver)
        self._solver, self._size = None, -1

    def release(self) -> None:
        """Hand the solver back for the next query of this structure."""
        self._hand_back()
        self._stale = True

    def matrix(self, y: Array) -> Array:
        """Z (N, N)."""
        return smat(self.Z0 + self.D @ y, self.structure.order)

    def excess(self, Z: Array) -> tuple[float, Array]:
        """h(Z) in the points' metric (Eq. 12), and the objective C = U U^T of Problem 5 pulled back to Z's basis."""
        L, d = self.metric, self.structure.skeleton.dimension
        values, vectors = np.linalg.eigh(L.T @ Z @ L)
        U = L @ vectors[:, :-d]
        return float(values[:-d].sum()), U @ U.T

    def nuclear(self) -> Array:
        """C = I over all points: the nuclear norm."""
        C: Array = self.metric @ self.metric.T
        return C

    def random_objective(self, rng: np.random.Generator) -> Array:
        """A Wishart matrix of rank one to three over all points: fewer restarts than with higher ranks."""
        order = len(self.metric)
        R = self.metric @ rng.standard_normal((order, int(rng.integers(1, 4))))
        C: Array = R @ R.T / order
        return C

    def toward(self, q: Array) -> Array:
        """The objective that is zero at a configuration (n,)."""
        X = self.structure.reduction.basis_at(q)
        columns = np.vstack([X, np.eye(X.shape[1])])[self.structure.keep]
        return self.excess(columns @ columns.T)[1]

    def directions(self, Z: Array) -> dict[int, Array]:
        """By link, its basis directions (s, d) as Z has them."""
        columns = np.vstack([self.basis(Z), np.eye(self.structure.skeleton.dimension)])
        found = self.structure.reduction.directions
        return {link: vectors.at(self.G) @ columns for link, vectors in found.items()}

    def basis(self, Z: Array) -> Array:
        """X (r, d) over the whole basis, dropped vectors filled in: normal to what they must be normal to."""
        structure, d = self.structure, self.structure.skeleton.dimension
        columns = np.zeros((structure.whole, d))
        columns[-d:] = np.eye(d)
        columns[structure.keep[:-d]] = Z[: structure.rank, structure.rank :]
        for entry in structure.dropped:
            rows = self._packed[list(entry.rows)]
            columns[entry.index] = _normal_to(others_in(rows, entry.index, len(columns)) @ columns)
        return columns[:-d]


def _normal_to(vectors: Array) -> Array:
    """A unit vector normal to up to two others (k, 3)."""
    (ax, ay, az), (bx, by, bz) = np.vstack([vectors, np.zeros((2, 3))])[:2].tolist()
    across = np.array([ay * bz - az * by, az * bx - ax * bz, ax * by - ay * bx])
    length = math.hypot(*across)
    if length < _PARALLEL:
        # any normal of the one direction that there is will do
        along = np.array([ax, ay, az]) if math.hypot(ax, ay, az) > _PARALLEL else np.array([bx, by, bz])
        across = np.cross(along, np.eye(3)[int(np.argmin(np.abs(along)))])
        length = math.hypot(*across)
    normal: Array = across / length if length > 0 else np.array([1.0, 0.0, 0.0])
    return normal
