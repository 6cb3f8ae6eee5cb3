"""Small quadratic programs against a well-known solver."""

import cvxpy
import numpy as np
import pytest

from tests.motion.live.kernels import called
from workcell.motion.live.kernels.program import Program


def room_for(n, rows):
    """A program of n variables."""
    return Program(
        np.empty((n, n)), np.empty((n, n)), np.empty(n), np.empty((rows, n)), np.empty(rows),
        np.zeros(2, dtype=np.int64), np.zeros(n + 2, dtype=np.int64), np.empty(n + 2), np.empty((n + 2, n)),
        np.empty((n + 2, n + 2)), np.empty(n), np.empty(n + 2), np.empty(n), np.zeros(rows, dtype=np.bool_),
    )  # fmt: skip


def solved(H, centre, rows, bounds):
    """Whether ours finds a solution, and x."""
    room = room_for(len(centre), max(len(bounds), 1))
    room.x[:] = centre
    room.rows[: len(bounds)], room.bounds[: len(bounds)] = rows, bounds
    room.used[0] = len(bounds)
    return called.solve(room, H.copy()), room.x.copy()


@pytest.mark.parametrize("seed", range(40))
def test_random_programs_have_the_solution_that_another_solver_finds(seed):
    rng = np.random.default_rng(seed)
    n, m = int(rng.integers(2, 9)), int(rng.integers(1, 25))
    A = rng.normal(size=(n, n))
    H, centre = A @ A.T + 0.1 * np.eye(n), rng.normal(size=n)
    rows = rng.normal(size=(m, n))
    inside = rng.normal(size=n)
    bounds = rows @ inside - rng.uniform(0.0, 1.0, size=m)
    found, x = solved(H, centre, rows, bounds)
    y = cvxpy.Variable(n)
    problem = cvxpy.Problem(
        cvxpy.Minimize(cvxpy.quad_form(y - centre, cvxpy.psd_wrap(H))), [rows @ y >= bounds]
    )
    best = problem.solve(solver=cvxpy.CLARABEL)
    assert found
    assert np.all(rows @ x >= bounds - 1e-8)
    assert (x - centre) @ H @ (x - centre) == pytest.approx(best, rel=1e-6, abs=1e-7)


def test_rows_that_exclude_each_other_have_no_solution():
    rows = np.array([[1.0, 0.0], [-1.0, 0.0]])
    assert not solved(np.eye(2), np.zeros(2), rows, np.array([1.0, 1.0]))[0]


def test_rows_that_say_the_same_twice_do_no_harm():
    rows = np.array([[1.0, 1.0], [1.0, 1.0], [2.0, 2.0]])
    found, x = solved(np.eye(2), np.zeros(2), rows, np.array([1.0, 1.0, 2.0]))
    assert found
    assert x == pytest.approx([0.5, 0.5], abs=1e-9)
