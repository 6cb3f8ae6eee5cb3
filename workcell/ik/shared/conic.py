"""A thin layer over Clarabel: cone programs whose pattern is fixed and whose numbers change from solve to solve.

The form is Clarabel's: minimise x.P x / 2 + q.x (P is mostly zero) subject to A x + s = b, s in K, with K a product of
{0}, a nonnegative orthant, second-order cones, PSD triangles, exponential and power cones, in this order. A triangle of
a PSD matrix is its upper one, stacked by columns with off-diagonal entries times sqrt(2) (`svec`), so that inner
products of matrices are those of vectors.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import lru_cache
from typing import Any, Literal

import numpy as np
from numpy.typing import NDArray

from workcell.pose import Array

ConicStatus = Literal["solved", "infeasible", "almost_solved", "almost_infeasible", "failed"]
"""`infeasible` comes with a ray in `z`; the `almost_` statuses are never a proof of anything."""

_STATUS: dict[str, ConicStatus] = {
    "Solved": "solved",
    "PrimalInfeasible": "infeasible",
    "AlmostSolved": "almost_solved",
    "AlmostPrimalInfeasible": "almost_infeasible",
}


@dataclass(frozen=True, slots=True)
class Cones:
    """The product cone K, in row order.

    Attributes:
        zero: number of equality rows.
        nonneg: number of rows with s >= 0.
        soc: dimensions of the second-order cones {(t, v): |v| <= t}.
        psd: orders of the PSD triangles.
        exponential: number of exponential cones, the closure of {(u, v, w): v exp(u / v) <= w, v > 0}.
        power: exponents a of the power cones {(u, v, w): u^a v^(1 - a) >= |w|, u, v >= 0}.
    """

    zero: int
    nonneg: int
    soc: tuple[int, ...] = ()
    psd: tuple[int, ...] = ()
    exponential: int = 0
    power: tuple[float, ...] = ()

    @property
    def rows(self) -> int:
        """Number of rows of A."""
        return self.zero + self.nonneg + sum(self.beyond)

    @property
    def beyond(self) -> tuple[int, ...]:
        """Rows of each cone behind those of single rows."""
        triangles = tuple(n * (n + 1) // 2 for n in self.psd)
        return self.soc + triangles + (3,) * (self.exponential + len(self.power))

    def project_dual(self, z: Array) -> Array:
        """The point of the dual cone K* nearest to `z` (rows,): equality rows are free, all else is self-dual.

        But for exponential and power cones, whose part is replaced by zero: no proof of ours rests on one.
        """
        out = np.array(z, dtype=float)
        at = self.zero
        out[at : at + self.nonneg] = np.maximum(out[at : at + self.nonneg], 0.0)
        at += self.nonneg
        for size in self.soc:
            out[at : at + size] = _project_soc(out[at : at + size])
            at += size
        for order in self.psd:
            size = order * (order + 1) // 2
            values, vectors = np.linalg.eigh(smat(out[at : at + size], order))
            out[at : at + size] = svec((vectors * np.maximum(values, 0.0)) @ vectors.T)
            at += size
        out[at:] = 0.0
        return out


def _project_soc(point: Array) -> Array:
    t, v = point[0], point[1:]
    norm = float(np.linalg.norm(v))
    if norm <= t:
        return point
    if norm <= -t:
        return np.zeros_like(point)
    scale = 0.5 * (t + norm)
    return np.concatenate([[scale], scale * v / norm])


@lru_cache(maxsize=16)
def triangle(order: int) -> tuple[NDArray[np.int64], NDArray[np.int64], Array]:
    """Row and column of each entry of a PSD triangle, and its factor (1 or sqrt 2)."""
    columns, rows = np.tril_indices(order)
    return rows, columns, np.where(rows == columns, 1.0, np.sqrt(2.0))


@lru_cache(maxsize=16)
def _square(order: int) -> tuple[NDArray[np.int64], Array]:
    """For each entry of a symmetric matrix (order, order): its place in the triangle, and the inverse factor."""
    rows, columns, factor = triangle(order)
    place, inverse = np.zeros((order, order), dtype=np.int64), np.zeros((order, order))
    for k, (i, j) in enumerate(zip(rows, columns, strict=True)):
        place[i, j] = place[j, i] = k
        inverse[i, j] = inverse[j, i] = 1.0 / factor[k]
    return place, inverse


def svec(matrix: Array) -> Array:
    """PSD triangles (..., k) of symmetric matrices (..., n, n)."""
    rows, columns, factor = triangle(matrix.shape[-1])
    packed: Array = matrix[..., rows, columns] * factor
    return packed


def smat(vector: Array, order: int) -> Array:
    """Symmetric matrices (..., order, order) of PSD triangles (..., k)."""
    place, inverse = _square(order)
    matrix: Array = vector[..., place] * inverse
    return matrix


@dataclass(frozen=True, slots=True)
class ConicSolution:
    """One solve: `x` (variables), `z` (rows; the dual, or the ray when infeasible), the dual objective, iterations."""

    status: ConicStatus
    x: Array
    z: Array
    dual_objective: float
    iterations: int

    @property
    def usable(self) -> bool:
        """Whether `x` is a point worth reading (exact or reduced accuracy)."""
        return self.status in ("solved", "almost_solved")


class ConicSolver:
    """One Clarabel instance; `solve` keeps its symbolic work and replaces only the numbers.

    Args:
        A: scipy CSC matrix (rows, variables); its stored pattern is fixed, explicit zeros included.
        b: (rows,) right-hand side.
        cones: how the rows are to be read.
        tolerance: gap and feasibility tolerance.
        P: scipy CSC matrix (variables, variables), the upper triangle of a PSD one; None: zero.
    """

    def __init__(
        self, A: Any, b: Array, cones: Cones, *, tolerance: float = 1e-6, P: Any | None = None
    ) -> None:
        import clarabel
        from scipy.sparse import csc_matrix

        n = A.shape[1]
        blocks: list[Any] = [clarabel.ZeroConeT(cones.zero)] if cones.zero else []
        blocks += [clarabel.NonnegativeConeT(cones.nonneg)] if cones.nonneg else []
        blocks += [clarabel.SecondOrderConeT(size) for size in cones.soc]
        blocks += [clarabel.PSDTriangleConeT(order) for order in cones.psd]
        blocks += [clarabel.ExponentialConeT()] * cones.exponential
        blocks += [clarabel.PowerConeT(exponent) for exponent in cones.power]
        self.cones = cones
        self.solves = 0
        self._solver = clarabel.DefaultSolver(
            csc_matrix((n, n)) if P is None else P, np.zeros(n), A, b, blocks, _settings(tolerance)
        )

    def solve(self, q: Array, *, b: Array | None = None, values: Array | None = None) -> ConicSolution:
        """Minimise x.P x / 2 + q.x; `b` and `values` (A's entries, in CSC order), if given, replace earlier ones."""
        if b is not None:
            self._solver.update(b=b)
        if values is not None:
            self._solver.update(A=values)
        self._solver.update(q=q)
        raw = self._solver.solve()
        self.solves += 1
        return ConicSolution(
            status=_STATUS.get(str(raw.status), "failed"),
            x=np.asarray(raw.x),
            z=np.asarray(raw.z),
            dual_objective=float(raw.obj_val_dual),
            iterations=int(raw.iterations),
        )


def _settings(tolerance: float) -> Any:
    import clarabel

    settings = clarabel.DefaultSettings()
    settings.verbose = False
    # updates of the data need the pattern to stay as given
    settings.presolve_enable = False
    settings.chordal_decomposition_enable = False
    settings.input_sparse_dropzeros = False
    settings.max_threads = 1
    # rows and variables are of order one; without scaling an answer can't depend on earlier problems' numbers
    settings.equilibrate_enable = False
    # the polish and the certificate's own check make up for the digits that refinement would add
    settings.iterative_refinement_enable = tolerance < 1e-7
    settings.max_iter = 60
    settings.tol_gap_abs = settings.tol_gap_rel = settings.tol_feas = tolerance
    return settings
