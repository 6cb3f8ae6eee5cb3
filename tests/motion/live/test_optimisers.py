"""NLopt's optimisers find the least of objectives within bounds, by any gradient."""

from __future__ import annotations

import sys

import numpy as np
import pytest

from workcell.errors import InputError, UnknownNameError
from workcell.motion.live.optimisers import OPTIMISERS, Minimiser, installed

needs_nlopt = pytest.mark.skipif(not installed(), reason="needs workcell[live]")


class Bowl:
    """|A (q - least)|^2 within a box, counting how often it is asked."""

    def __init__(self, least, lower, upper):
        self.least, self._bounds = np.asarray(least), (np.asarray(lower), np.asarray(upper))
        self.A = np.array([[1.0, 0.3, 0.0], [0.0, 2.0, -0.4], [0.1, 0.0, 0.7]])
        self.gradients = 0

    def value(self, q):
        return float(np.sum((self.A @ (q - self.least)) ** 2))

    def value_and_gradient(self, q):
        self.gradients += 1
        return self.value(q), 2.0 * self.A.T @ self.A @ (q - self.least)

    def bounds(self):
        return self._bounds


@needs_nlopt
@pytest.mark.parametrize("name", OPTIMISERS)
def test_the_least_is_found_inside_and_on_bounds(name):
    search = Minimiser(name, 3, most=5000)
    inside = Bowl([0.02, -0.03, 0.01], [-0.1] * 3, [0.1] * 3)
    q = search(inside, np.zeros(3))
    assert inside.value(q) < 1e-6 and (inside.gradients > 0) == OPTIMISERS[name].startswith("LD")
    # a box apart from the least: the same optimiser, asked again
    outside = Bowl([0.5, 0.0, 0.0], [-0.1] * 3, [0.1] * 3)
    q = search(outside, np.array([0.7, 0.0, 0.0]))
    assert np.all(np.abs(q) <= 0.1 + 1e-12)
    scipy_optimize = pytest.importorskip("scipy.optimize")
    best = scipy_optimize.minimize(outside.value, np.zeros(3), bounds=[(-0.1, 0.1)] * 3, tol=1e-12)
    assert outside.value(q) <= best.fun + 1e-4


@needs_nlopt
@pytest.mark.parametrize("name", ["slsqp", "mma", "ccsaq"])
def test_differences_lead_where_gradients_lead(name):
    bowl = Bowl([0.02, -0.03, 0.01], [-0.1] * 3, [0.1] * 3)
    by_own, by_differences = (
        Minimiser(name, 3, gradient=gradient, most=2000)(bowl, np.zeros(3))
        for gradient in ("analytic", "differences")
    )
    np.testing.assert_allclose(by_own, by_differences, atol=1e-3)


@needs_nlopt
def test_what_can_t_be_improved_is_never_made_worse():
    bowl = Bowl([0.0, 0.0, 0.0], [-0.1] * 3, [0.1] * 3)
    for name in OPTIMISERS:
        q = Minimiser(name, 3, most=3)(bowl, np.zeros(3))
        assert bowl.value(q) == 0.0


def test_an_unknown_optimiser_and_a_missing_package_are_said(monkeypatch):
    with pytest.raises(UnknownNameError, match="slsqp"):
        Minimiser("newton", 3)
    monkeypatch.setitem(sys.modules, "nlopt", None)
    with pytest.raises(InputError, match=r"workcell\[live\]"):
        Minimiser("slsqp", 3)
