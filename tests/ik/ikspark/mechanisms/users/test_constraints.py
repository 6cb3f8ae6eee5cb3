"""Users' constraints: the same optima as cvxpy's own, refused by name, and asked of a configuration."""

from __future__ import annotations

import cvxpy as cp
import numpy as np
import pytest
from scipy import sparse

from tests.ik.ikspark.mechanisms.users.affine import SLED, ByHand
from workcell.errors import InputError, UnknownNameError
from workcell.ik.ikspark.mechanisms.users.constraints import conic_rows, violations
from workcell.ik.ikspark.mechanisms.users.expressions import Expressions
from workcell.ik.mechanisms.problem import MechanismProblem, UserConstraint
from workcell.ik.shared.conic import Cones, ConicSolver
from workcell.model.mechanism.placing import place

NOWHERE = np.array([0.0, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0, 0.5])
"""The base at the origin, not turned; the sled's origin at z = 0.5, its tip at (0.1, 0, 0.7)."""


def in_a_ball(e):
    return [cp.norm(e.point("tip") - np.array([0.1, 0.2, 0.3])) <= 0.5]


def with_own_variables(e):
    t, u = cp.Variable(), cp.Variable(3, nonneg=True)
    return [cp.norm(e.point("tip"), 1) <= t, t <= cp.sum(u), u <= 0.3, e.slide("slides") >= 0.2 * t]


def in_an_ellipsoid(e):
    shape = np.array([[2.0, 0.3, 0.0], [0.3, 1.0, 0.0], [0.0, 0.0, 3.0]])
    return [cp.quad_form(e.point("tip", (0.0, 0.1, 0.0)), shape) <= 1]


def semidefinite(e):
    p = e.point("tip")
    return [cp.bmat([[1 + p[0], p[1]], [p[1], 1 - p[0]]]) >> 0]


def exponential(e):
    return [cp.exp(e.point("tip")[0]) + e.point("tip")[1] <= 2, cp.log(1 + e.slide("slides")) >= 0.1]


def power(e):
    return [cp.power(e.point("tip")[2], 1.5) <= 0.6]


def turned(e):
    return [e.rotation("tip")[:, 0] @ np.array([0.0, 0.0, 1.0]) >= 0.8, e.point("tip")[1] == 0.25]


def minimum(rows, cost):
    """The least of a linear cost over users' rows and a box of x."""
    size = len(cost)
    A = sparse.vstack(
        [sparse.eye(size, rows.A.shape[1]), -sparse.eye(size, rows.A.shape[1])],
    )
    zero = rows.cones.zero
    inside = sparse.vstack([rows.A[:zero], A, rows.A[zero:]]).tocsc()
    b = np.concatenate([rows.b[:zero], np.ones(2 * size), rows.b[zero:]])
    old = rows.cones
    cones = Cones(zero, old.nonneg + 2 * size, old.soc, old.psd, old.exponential, old.power)
    assert cones.rows == len(b)
    solution = ConicSolver(inside, b, cones, tolerance=1e-9).solve(
        np.concatenate([cost, np.zeros(rows.auxiliaries)])
    )
    assert solution.status == "solved"
    return float(cost @ solution.x[:size])


@pytest.mark.parametrize(
    "builds",
    [
        *([one] for one in (in_a_ball, with_own_variables, in_an_ellipsoid, semidefinite)),
        *([one] for one in (exponential, power, turned)),
        [in_a_ball, with_own_variables, exponential],
        [semidefinite, turned, power, in_an_ellipsoid],
    ],
    ids=lambda builds: "+".join(build.__name__ for build in builds),
)
def test_optima_are_those_of_cvxpy(builds):
    constraints = [UserConstraint(build.__name__, build) for build in builds]
    rows = conic_rows(constraints, ByHand())
    assert rows.A.shape == (rows.cones.rows, ByHand.size + rows.auxiliaries)
    rng = np.random.default_rng(0)
    for _ in range(2):
        cost = rng.standard_normal(ByHand.size)
        x = cp.Variable(ByHand.size)
        own = [one for build in builds for one in build(Expressions.of(ByHand(), x))]
        oracle = cp.Problem(cp.Minimize(cost @ x), [*own, cp.abs(x) <= 1])
        oracle.solve(solver="CLARABEL", tol_gap_abs=1e-9, tol_gap_rel=1e-9, tol_feas=1e-9)
        assert minimum(rows, cost) == pytest.approx(oracle.value, abs=2e-6)


def test_no_constraints_are_no_rows():
    rows = conic_rows([], ByHand())
    assert rows.A.shape == (0, ByHand.size)
    assert (len(rows.b), rows.auxiliaries) == (0, 0)


def test_rows_without_variables_are_left_out():
    rows = conic_rows(
        [UserConstraint("two", lambda e: [e.point("tip")[0] <= 1, e.point("floor")[0] <= 1])], ByHand()
    )
    assert rows.A.shape[0] == 1


def test_expressions_are_those_of_the_configuration():
    q = np.array([0.1, -0.2, 0.3, 0.5, -0.5, 0.5, 0.5, 0.7])
    placed = place(SLED, q)
    x = cp.Variable(ByHand.size)
    x.value = ByHand.lifted(placed.R[2], placed.p[2], 0.7)
    for one, two in [(Expressions.of(ByHand(), x), Expressions.at(placed))]:
        for name in ("tip", "floor"):
            np.testing.assert_allclose(one.rotation(name).value, two.rotation(name).value, atol=1e-12)
            local = (0.3, 0.2, 0.1)
            np.testing.assert_allclose(one.point(name, local).value, two.point(name, local).value, atol=1e-12)
        assert one.slide("slides").value == two.slide("slides").value == 0.7
    T = SLED.frames["tip"].T_link_frame
    expected = placed.R[2] @ T.apply([0.3, 0.2, 0.1]) + placed.p[2]
    np.testing.assert_allclose(
        Expressions.at(placed).point("tip", (0.3, 0.2, 0.1)).value, expected, atol=1e-12
    )


BAD = {
    "not convex": lambda e: [cp.norm(e.point("tip")) >= 1],
    "does not depend": lambda e: [cp.Variable() <= 1],
    "contradicts itself": lambda e: [e.point("tip")[0] >= 1, e.point("tip")[0] <= 0.5],
    "is no cvxpy constraint": lambda e: [3 < 5],
    "returned 5": lambda e: 5,
    "returned []": lambda e: [],
    "ZeroDivisionError": lambda e: [1 / 0],
    "no site named 'top'": lambda e: [e.point("top")[0] <= 1],
    "is a free joint": lambda e: [e.slide("floats") <= 1],
    "no joint named": lambda e: [e.slide("slider") <= 1],
    "3 finite numbers": lambda e: [e.point("tip", (0, 0))[0] <= 1],
    "a parameter has no value": lambda e: [e.point("tip")[0] <= cp.Parameter()],
    "whole-number": lambda e: [e.point("tip")[0] <= cp.Variable(integer=True)],
    "not finite": lambda e: [e.point("tip")[0] <= np.nan],
}


@pytest.mark.parametrize("said", BAD)
def test_what_can_t_be_kept_is_refused_by_name(said):
    good = UserConstraint("good", in_a_ball)
    with pytest.raises(InputError, match=r"constraint 'mine'.*") as caught:
        conic_rows([good, UserConstraint("mine", BAD[said])], ByHand())
    assert said in str(caught.value)


def test_an_empty_polytope_is_refused():
    A, b = np.vstack([np.eye(3), -np.eye(3)]), np.array([1.0, 1.0, 1.0, 1.0, 1.0, -1.5])
    with pytest.raises(InputError, match="constraint 'empty': nothing satisfies it"):
        conic_rows([UserConstraint("empty", lambda e: [A @ e.point("tip") <= b])], ByHand())


def test_constraints_that_contradict_each_other_are_refused():
    high = UserConstraint("high", lambda e: [e.point("tip")[2] >= 1.0])
    low = UserConstraint("low", lambda e: [e.point("tip")[2] <= 0.5])
    with pytest.raises(InputError, match="'high', 'low': nothing satisfies all of them"):
        conic_rows([high, low], ByHand())


@pytest.mark.parametrize("tolerance", [0.0, -1.0, np.nan, np.inf])
def test_a_tolerance_is_positive(tolerance):
    with pytest.raises(InputError, match="tolerance"):
        conic_rows([UserConstraint("mine", in_a_ball, tolerance)], ByHand())


def broken(build, q=NOWHERE, tolerance=1e-6):
    problem = MechanismProblem(SLED, constraints=(UserConstraint("mine", build, tolerance),))
    return violations(problem, q)


def test_a_configuration_that_keeps_everything_breaks_nothing():
    assert broken(lambda e: [e.point("tip") == np.array([0.1, 0.0, 0.7]), e.slide("slides") <= 0.5]) == []
    assert broken(lambda e: [e.rotation("floor") == np.eye(3)]) == []


def test_a_broken_constraint_is_named_with_its_excess():
    (reason,) = broken(lambda e: [e.point("tip")[2] <= 0.6])
    assert reason == "constraint 'mine' is broken by 0.1"
    assert broken(lambda e: [e.point("tip")[2] <= 0.6], tolerance=0.11) == []


def test_own_variables_are_chosen_as_well_as_can_be():
    def between(least):
        def build(e):
            t = cp.Variable()
            return [
                cp.norm(e.point("tip")) <= t,
                t <= least,
                cp.SOC(cp.Constant(1.0), cp.hstack([t / 4, 0.1])),
            ]

        return build

    length = float(np.hypot(0.1, 0.7))
    assert broken(between(length + 1e-3)) == []
    (reason,) = broken(between(length - 0.2))
    assert float(reason.rsplit(" ", 1)[1]) == pytest.approx(0.1, abs=1e-4)


def test_own_variables_that_nothing_suits():
    def build(e):
        t = cp.Variable(2)
        return [cp.SOC(cp.Constant(-1.0), t), t[0] == e.slide("slides")]

    (reason,) = broken(build)
    assert "whatever its own variables are" in reason


def test_violations_name_bad_constraints_too():
    with pytest.raises(InputError, match="constraint 'mine'"):
        broken(lambda e: 5)
    with pytest.raises(UnknownNameError):
        SLED.frame("nowhere")
