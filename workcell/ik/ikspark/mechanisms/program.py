"""A mechanism's relaxation as a cone program on Clarabel: rows by family, dependent equalities left out."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import replace
from itertools import pairwise
from typing import TYPE_CHECKING, Any

import numpy as np

from workcell.ik.ikspark.mechanisms.rows import ConeName, Rows, says_something
from workcell.ik.shared.conic import Cones, ConicSolution, ConicSolver, smat
from workcell.pose import Array

if TYPE_CHECKING:
    from workcell.ik.ikspark.mechanisms.users.constraints import UserRows

Multipliers = dict[tuple[str, int], Array]
"""Of rows, by family and index: as many numbers as rows."""
_DEPENDENT = 1e-9
"""Part of the largest pivot below which an equality row follows from the others."""
_CONTRADICTION = 1e-8
"""What such a row may miss, as part of its largest number, for it to be true as well."""
_OTHERWISE = (1e-8, 1e-5)
"""Clarabel's tolerances for what it fails to solve to the usual one: refined steps first, then fewer digits."""
_ORDER: tuple[ConeName, ...] = ("zero", "nonneg", "soc", "psd")


class Program:
    """The set of all x (N,) that keep some rows.

    Args:
        size: N.
        rows: what x keeps.
        extra: rows with further variables.
        tolerance: of Clarabel.

    Attributes:
        solves: cone programs solved so far.
        contradiction: multipliers that show that the equalities contradict each other; None: they don't.
    """

    def __init__(
        self, size: int, rows: Iterable[Rows], extra: UserRows | None = None, *, tolerance: float = 1e-7
    ) -> None:
        self.size, self.solves, self._tolerance = size, 0, tolerance
        self._extra = extra
        kept = [one for one in rows if says_something(one)]
        self._rows = [one for cone in _ORDER for one in kept if one.cone == cone]
        self.contradiction: Multipliers | None = None
        self._kept_equalities = self._independent()
        self._solver: ConicSolver | None = None
        self._cuts: tuple[Rows, ...] = ()

    def _independent(self) -> Array:
        """Indices of equalities of which the others follow."""
        from scipy.linalg import qr

        E = self._stacked("zero")
        A, b = E[:, :-1], -E[:, -1]
        if len(E) == 0:
            return np.zeros(0, dtype=np.int64)
        R, pivots = qr(A.T, mode="r", pivoting=True)
        diagonal = np.abs(np.diagonal(R))
        rank = int((diagonal > _DEPENDENT * diagonal.max(initial=1.0)).sum())
        chosen, left = np.sort(pivots[:rank]), np.sort(pivots[rank:])
        if len(left):
            combination = np.linalg.lstsq(A[chosen].T, A[left].T, rcond=None)[0]
            off = b[left] - combination.T @ b[chosen]
            size = np.maximum(np.abs(E).max(axis=1)[left], 1.0)
            worst = int(np.argmax(np.abs(off) / size))
            if abs(off[worst]) > _CONTRADICTION * size[worst]:
                z = np.zeros(len(E))
                z[left[worst]], z[chosen] = 1.0, -combination[:, worst]
                # the sum of z times rows is constant: -z b; as a Farkas combination it has to be negative
                self.contradiction = self._named("zero", z * np.sign(float(z @ b)))
        return chosen

    def _stacked(self, cone: ConeName) -> Array:
        parts = [one.rows for one in self._rows if one.cone == cone]
        return np.vstack(parts) if parts else np.zeros((0, self.size + 1))

    def _named(self, cone: ConeName, z: Array) -> Multipliers:
        found, at = {}, 0
        for one in self._rows:
            if one.cone == cone:
                found[(one.family, one.index)] = z[at : at + len(one.rows)]
                at += len(one.rows)
        return found

    def cut(self, cuts: Sequence[Rows]) -> None:
        """Keep these rows besides; earlier ones are forgotten. They are equalities or inequalities."""
        if cuts or self._cuts:
            self._cuts, self._solver = tuple(cuts), None

    def solve(self, q: Array, *, tolerance: float | None = None) -> ConicSolution:
        """Minimise q.x (N,) over the set; `z` is of the rows as they are solved, see `multipliers`."""
        if tolerance is not None:
            return self._cropped(self._made(tolerance).solve(self._padded(q)))
        if self._solver is None:
            self._solver = self._made(self._tolerance)
        solution = self._solver.solve(self._padded(q))
        for other in _OTHERWISE:
            if solution.status not in ("failed", "almost_infeasible"):
                break
            solution = self._made(other).solve(self._padded(q))
        return self._cropped(solution)

    def _padded(self, q: Array) -> Array:
        self.solves += 1
        extra = 0 if self._extra is None else self._extra.auxiliaries
        return np.concatenate([q, np.zeros(extra)])

    def _cropped(self, solution: ConicSolution) -> ConicSolution:
        return replace(solution, x=solution.x[: self.size])

    def _made(self, tolerance: float) -> ConicSolver:
        A, b, cones = self._assembled()
        return ConicSolver(A, b, cones, tolerance=tolerance)

    def _assembled(self) -> tuple[Any, Array, Cones]:
        from scipy.sparse import csc_matrix

        zero = [self._stacked("zero")[self._kept_equalities]]
        zero += [one.rows for one in self._cuts if one.cone == "zero"]
        nonneg = [one.rows for one in (*self._rows, *self._cuts) if one.cone == "nonneg"]
        soc = [one.rows for one in self._rows if one.cone == "soc"]
        psd = [one.rows for one in self._rows if one.cone == "psd"]
        orders = tuple(int(np.sqrt(2 * len(rows) + 0.25) - 0.5 + 1e-9) for rows in psd)
        cones = Cones(sum(map(len, zero)), sum(map(len, nonneg)), tuple(len(rows) for rows in soc), orders)
        f = np.vstack([*zero, *nonneg, *soc, *psd])
        if self._extra is None:
            return csc_matrix(-f[:, :-1]), f[:, -1], cones
        return _merged(f, cones, self._extra)

    def multipliers(self, z: Array) -> Multipliers | None:
        """A dual z by families of rows; None where rows that are no part of the relaxation have a share in it."""
        if self._extra is not None or self._cuts:
            return None
        found = self._named("zero", _spread(z, self._kept_equalities, len(self._stacked("zero"))))
        at = len(self._kept_equalities)
        for one in self._rows:
            if one.cone != "zero":
                found[(one.family, one.index)] = z[at : at + len(one.rows)]
                at += len(one.rows)
        return found

    def inside(self, x: Array, *, slack: float = 1e-9) -> bool:
        """Whether x (N,) keeps all rows but for equalities, cuts among them."""
        one = np.append(x, 1.0)
        for rows in (*self._rows, *self._cuts):
            if rows.cone == "zero":
                continue
            if not keeps(rows.cone, rows.rows @ one, slack):
                return False
        return True


def keeps(cone: ConeName, values: Array, slack: float) -> bool:
    """Whether values are in a cone, but for a slack."""
    if cone == "zero":
        return bool(np.abs(values).max() <= slack)
    if cone == "nonneg":
        return bool(values.min() >= -slack)
    if cone == "soc":
        return bool(np.linalg.norm(values[1:]) <= values[0] + slack)
    order = int(np.sqrt(2 * len(values) + 0.25) - 0.5 + 1e-9)
    return bool(np.linalg.eigvalsh(smat(values, order))[0] >= -slack)


def _spread(z: Array, chosen: Array, count: int) -> Array:
    whole = np.zeros(count)
    whole[chosen] = z[: len(chosen)]
    return whole


def _merged(f: Array, cones: Cones, extra: UserRows) -> tuple[Any, Array, Cones]:
    """Our rows f (rows, N + 1) and users' rows as one program, cone by cone; users' have variables behind ours."""
    from scipy import sparse

    wide = sparse.csr_matrix(np.hstack([-f[:, :-1], np.zeros((len(f), extra.auxiliaries))]))
    theirs, parts_A, parts_b = extra.A.tocsr(), [], []
    for one, two in zip(_parts(cones), _parts(extra.cones), strict=True):
        parts_A += [wide[one], theirs[two]]
        parts_b += [f[one, -1], extra.b[two]]
    together = Cones(
        cones.zero + extra.cones.zero,
        cones.nonneg + extra.cones.nonneg,
        cones.soc + extra.cones.soc,
        cones.psd + extra.cones.psd,
        extra.cones.exponential,
        extra.cones.power,
    )
    return sparse.vstack(parts_A).tocsc(), np.concatenate(parts_b), together


def _parts(cones: Cones) -> list[slice]:
    """Where each kind of cone has its rows: equalities, inequalities, second-order cones, triangles, the others."""
    triangles = sum(order * (order + 1) // 2 for order in cones.psd)
    ends = np.cumsum([0, cones.zero, cones.nonneg, sum(cones.soc), triangles]).tolist()
    return [slice(a, b) for a, b in pairwise([*ends, cones.rows])]
