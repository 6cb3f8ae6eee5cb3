"""The conic layer: packing, projections, and small programs with known answers."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.sparse import csc_matrix

from workcell.ik.shared.conic import Cones, ConicSolver, smat, svec


@given(st.integers(1, 6), st.integers(0, 10_000))
def test_triangles_keep_inner_products(order: int, seed: int) -> None:
    A, B = np.random.default_rng(seed).standard_normal((2, order, order))
    A, B = A + A.T, B + B.T
    assert svec(A) @ svec(B) == pytest.approx(np.sum(A * B))
    assert smat(svec(A), order) == pytest.approx(A)


def test_triangles_stack_columns() -> None:
    M = np.array([[1.0, 2.0, 4.0], [2.0, 3.0, 5.0], [4.0, 5.0, 6.0]])
    root = np.sqrt(2.0)
    assert svec(M) == pytest.approx([1, 2 * root, 3, 4 * root, 5 * root, 6])


@settings(max_examples=40)
@given(st.integers(0, 10_000))
def test_projection_onto_the_dual_cone(seed: int) -> None:
    rng = np.random.default_rng(seed)
    cones = Cones(zero=2, nonneg=3, soc=(3, 4), psd=(2, 3))
    z = 3 * rng.standard_normal(cones.rows)
    p = cones.project_dual(z)
    # Moreau: the rest lies in the polar cone and is orthogonal to the projection
    assert cones.project_dual(p) == pytest.approx(p, abs=1e-9)
    assert (z - p) @ p == pytest.approx(0.0, abs=1e-9)
    assert cones.project_dual(p - z)[2:] == pytest.approx((p - z)[2:], abs=1e-9)
    assert p[:2] == pytest.approx(z[:2])


def largest_eigenvalue_program(tolerance: float = 1e-9) -> ConicSolver:
    """Minimise q.x over x = svec(Q), Q >= 0, trace 1: the smallest eigenvalue of smat(q)."""
    A = np.vstack([svec(np.eye(3)), -np.eye(6)])
    b = np.concatenate([[1.0], np.zeros(6)])
    return ConicSolver(csc_matrix(A), b, Cones(zero=1, nonneg=0, psd=(3,)), tolerance=tolerance)


def test_smallest_eigenvalue_again_and_again() -> None:
    solver = largest_eigenvalue_program()
    rng = np.random.default_rng(3)
    for _ in range(5):
        C = rng.standard_normal((3, 3))
        C = C + C.T
        solution = solver.solve(svec(C))
        assert solution.status == "solved"
        assert solution.dual_objective == pytest.approx(np.linalg.eigvalsh(C)[0], abs=1e-7)
    assert solver.solves == 5


def test_infeasible_comes_with_a_ray_and_updates_are_seen() -> None:
    # |v| <= 1 and v_1 = b
    A = csc_matrix(np.array([[1.0, 0.0], [0.0, 0.0], [-1.0, 0.0], [0.0, -1.0]]))
    cones = Cones(zero=1, nonneg=0, soc=(3,))
    solver = ConicSolver(A, np.array([0.5, 1.0, 0.0, 0.0]), cones)
    assert solver.solve(np.array([0.0, 1.0])).x == pytest.approx([0.5, -np.sqrt(0.75)], abs=1e-5)
    b = np.array([2.0, 1.0, 0.0, 0.0])
    outcome = solver.solve(np.array([0.0, 1.0]), b=b)
    assert outcome.status == "infeasible"
    z = cones.project_dual(outcome.z)
    assert b @ z < 0
    assert A.toarray().T @ z == pytest.approx([0.0, 0.0], abs=1e-6 * np.linalg.norm(z))
    halved = A.copy()
    halved.data[halved.data == 1.0] = 4.0
    assert solver.solve(np.array([0.0, 1.0]), b=b, values=halved.data).status == "solved"


def test_exponential_and_power_cones_come_last() -> None:
    """The least w with exp(u) <= w at u = 1/2, and the largest t with x^0.3 y^0.7 >= t at x = 2, y = 3."""
    cones = Cones(zero=0, nonneg=0, exponential=1, power=(0.3,))
    A = csc_matrix(-np.array([[0.0, 0], [0, 0], [1, 0], [0, 0], [0, 0], [0, 1]]))
    solution = ConicSolver(A, np.array([0.5, 1, 0, 2, 3, 0]), cones, tolerance=1e-9).solve(
        np.array([1.0, -1.0])
    )
    assert solution.status == "solved"
    assert solution.x == pytest.approx([np.exp(0.5), 2**0.3 * 3**0.7], abs=1e-6)
    assert cones.rows == 6
    assert not cones.project_dual(np.ones(6)).any(), "nothing of theirs takes part in a proof"
