"""Rows of spheres that are too near: their size, and that their slopes are derivatives."""

import numpy as np
import pytest

from tests.ik.mechanisms.cases import platform
from workcell.geometry.types import Piece, SphereCover
from workcell.ik.mechanisms.penetration import HINGE_MARGIN, Penetration
from workcell.ik.mechanisms.polish import residuals_of
from workcell.ik.mechanisms.problem import MechanismProblem, MechanismTolerances
from workcell.model.mechanism.placing import moved, place
from workcell.pose import Pose


def crowded(mechanism, rng, **options):
    links = rng.integers(0, mechanism.link_count, 20)
    cover = SphereCover(links, rng.uniform(-0.2, 0.2, (20, 3)), np.full(20, 0.1), "outer", np.full(20, 0.02))
    pieces = tuple(
        Piece(f"b{k}", "box", Pose.from_xyz(rng.uniform(-0.5, 0.5, 3)), np.full(3, 0.1)) for k in range(6)
    )
    apart = np.array([(a, b) for a in range(20) for b in range(a) if links[a] != links[b]])
    return MechanismProblem(mechanism, obstacles=pieces, cover=cover, apart=apart, **options)


@pytest.mark.parametrize("seed", range(3))
def test_slopes_are_derivatives(seed):
    mechanism, rng = platform(), np.random.default_rng(seed)
    problem = crowded(mechanism, rng)
    hinge, residuals = Penetration(problem, weight=0.5), residuals_of(problem)
    q = mechanism.home
    value, slope = hinge(residuals.at(q))
    assert len(value) > 10 and np.all(value > 0)
    for column in range(mechanism.dof):
        step = 1e-7 * np.eye(mechanism.dof)[column]
        ahead, back = (hinge(residuals.at(moved(mechanism, q, s)))[0] for s in (step, -step))
        if len(ahead) == len(back) == len(value):
            np.testing.assert_allclose((ahead - back) / 2e-7, slope[:, column], atol=1e-5)


def test_sizes_are_what_is_wanted_less_what_there_is():
    mechanism = platform()
    link = mechanism.link_count - 1
    cover = SphereCover(np.array([0, link]), np.zeros((2, 3)), np.full(2, 0.1), "outer", np.full(2, 0.04))
    p = place(mechanism, mechanism.home).p[link]
    ball = Piece("ball", "sphere", Pose.from_xyz(p + np.array([0.25, 0, 0])), np.array([0.2]))
    problem = MechanismProblem(
        mechanism, obstacles=(ball,), cover=cover, tolerances=MechanismTolerances(safety_margin=0.01)
    )
    rows = residuals_of(problem).at(mechanism.home)
    assert Penetration(problem)(rows)[0] == pytest.approx([0.05 + 0.01 + HINGE_MARGIN])
    assert Penetration(problem, forgiven=1.0)(rows)[0] == pytest.approx([0.02 + HINGE_MARGIN])
    assert Penetration(MechanismProblem(mechanism)).nothing
    assert len(Penetration(MechanismProblem(mechanism))(rows)[0]) == 0
