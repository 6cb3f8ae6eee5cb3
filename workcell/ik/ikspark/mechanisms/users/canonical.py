"""cvxpy constraints as rows of a cone program: a given variable keeps its place, new ones come behind it."""

from __future__ import annotations

from typing import Any

import numpy as np
from scipy import sparse

from workcell.errors import InputError
from workcell.ik.shared.conic import Cones, ConicSolver
from workcell.pose import Array

_NOTHING = 1e-12
"""Entries below which a row says nothing of the variables."""
_RAY = 1e-6
"""How far a proof of emptiness, whose claim is scaled to one, may be from zero for each variable."""


def canonical(constraints: list[Any], x: Any, *, where: str) -> tuple[Any, Array, Cones]:
    """Rows (A, b, cones) of cvxpy constraints over (x, auxiliaries); each row or cone is scaled to at most one.

    Args:
        constraints: convex by cvxpy's rules.
        x: the cvxpy variable (N,) whose columns come first.
        where: for messages.

    Raises:
        InputError: cvxpy can't bring them into the form, or a number is not finite.
    """
    import cvxpy as cp

    if not constraints:
        return sparse.csc_matrix((0, x.size)), np.zeros(0), Cones(0, 0)
    question = cp.Problem(cp.Minimize(0), constraints)
    try:
        data, _, _ = question.get_problem_data(cp.CLARABEL)
    except (cp.error.DCPError, cp.error.SolverError, ValueError) as error:
        raise InputError(f"cvxpy can't take it apart: {error}", where=where) from error
    dims = data["dims"]
    if dims.pnd:
        raise InputError("power cones of many dimensions are not supported", where=where)
    cones = Cones(
        int(dims.zero),
        int(dims.nonneg),
        tuple(map(int, dims.soc)),
        tuple(map(int, dims.psd)),
        int(dims.exp),
        tuple(map(float, dims.p3d)),
    )
    A, b = sparse.csc_matrix(data["A"]), np.asarray(data["b"], dtype=float)
    if not (np.all(np.isfinite(A.data)) and np.all(np.isfinite(b))):
        raise InputError("a number in it is not finite", where=where)
    return *_scaled(_in_order(A, data["param_prob"].var_id_to_col, x), b, cones), cones


def _in_order(A: Any, first_column: dict[int, int], x: Any) -> Any:
    """The columns of x first, the others behind them; x is not there where no constraint has it."""
    size = x.size
    if x.id not in first_column:
        return sparse.hstack([sparse.csc_matrix((A.shape[0], size)), A]).tocsc()
    at = first_column[x.id]
    columns = np.arange(A.shape[1])
    own = (columns >= at) & (columns < at + size)
    return A[:, np.concatenate([columns[own], columns[~own]])]


def _scaled(A: Any, b: Array, cones: Cones) -> tuple[Any, Array]:
    """Rows, and cones as a whole, divided by their largest entry of A."""
    rows = np.asarray(abs(A).max(axis=1).todense()).ravel() if A.shape[1] else np.zeros(A.shape[0])
    at = cones.zero + cones.nonneg
    for size in cones.beyond:
        rows[at : at + size] = rows[at : at + size].max(initial=0.0)
        at += size
    factor = 1.0 / np.where(rows > _NOTHING, rows, 1.0)
    return (sparse.diags(factor) @ A).tocsc(), b * factor


def without_bare_rows(A: Any, b: Array, cones: Cones) -> tuple[Any, Array, Cones]:
    """Equalities and inequalities without a variable, which hold, left out."""
    plain = cones.zero + cones.nonneg
    bare = np.zeros(A.shape[0], dtype=bool)
    if A.shape[1]:
        bare[:plain] = np.asarray(abs(A).max(axis=1).todense()).ravel()[:plain] <= _NOTHING
    kept = Cones(
        cones.zero - int(bare[: cones.zero].sum()),
        cones.nonneg - int(bare[cones.zero :].sum()),
        cones.soc,
        cones.psd,
        cones.exponential,
        cones.power,
    )
    return A[~bare].tocsc(), b[~bare], kept


def contradictory(A: Any, b: Array, cones: Cones) -> bool:
    """Whether no point at all satisfies the rows, by a ray of the dual cone that was looked at again."""
    solution = ConicSolver(A, b, cones, tolerance=1e-8).solve(np.zeros(A.shape[1]))
    if solution.status != "infeasible":
        return False
    z = cones.project_dual(solution.z)
    claim = -float(b @ z)
    return bool(claim > 0 and np.abs(A.T @ z).max(initial=0.0) <= _RAY * claim)
