"""What trees rest on loses no candidate: boxes of every width around planted configurations."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from tests.proofs.exact.planting import planted
from workcell.proofs.exact.distances import distance
from workcell.proofs.exact.kinematics import placed
from workcell.proofs.exact.problems import Obstacle, Sphere
from workcell.proofs.exact.spans import ONE as SPAN_ONE
from workcell.proofs.exact.tree.closures import closures, narrowed
from workcell.proofs.exact.tree.collisions import inside, named_pairs
from workcell.proofs.exact.tree.fixed import ONE
from workcell.proofs.exact.tree.relations import Blur, relations
from workcell.proofs.exact.tree.views import fixed_arm, views
from workcell.proofs.exact.vectors import rotation_of, vector

T, A = 1e-4, 1e-3
COUNT = 200


def boxes(q, rng):
    """(low, high) (n, COUNT) around q, from a millionth of a radian to whole turns wide, q anywhere inside."""
    n = len(q)
    at = np.round(np.array(q) * ONE).astype(np.int64)[:, None]
    width = 10.0 ** (rng.uniform(-6, 1, size=(1, COUNT)) + rng.uniform(-1, 0, size=(n, COUNT)))
    width *= rng.uniform(size=(n, COUNT)) < 0.8
    left, right = (np.ceil(width * rng.uniform(size=(n, COUNT)) * ONE).astype(np.int64) for _ in range(2))
    return at, at - left - 1, at + right + 1


@settings(max_examples=120, deadline=None)
@given(st.integers(0, 10**9), st.integers(1, 8), st.booleans(), st.booleans())
def test_a_candidate_is_never_lost(tmp_path_factory, seed, n, square, at_the_edge):
    rng = np.random.default_rng(seed)
    off = (0.999 * T, 0.999 * A) if at_the_edge else (0.0, 0.0)
    asked, q = planted(tmp_path_factory.mktemp("planted"), rng, n, off, square)
    arm = fixed_arm(asked, [])
    unit = 2.0**arm.units
    blur = Blur(int(np.ceil(T / unit * ONE)), int(np.ceil(A * ONE)))
    at, low, high = boxes(q, rng)
    middle = (low + high) >> 1
    half = np.maximum(high - middle, middle - low)
    base, target = views(arm, middle)
    assert not np.any(relations(arm, base, target, half, blur).excluded)
    for closure in closures(arm):
        least, most = narrowed(closure, arm, (base, target), middle, low, high, blur)
        assert np.all(least <= at)
        assert np.all(at <= most)
        assert np.all((low <= least) & (most <= high))


@pytest.mark.parametrize("n", [2, 6, 7])
def test_closures_do_narrow(tmp_path, n):
    """Around a target that is reached, some joint to less than half; where none is, to nothing."""
    rng = np.random.default_rng(n)
    asked, q = planted(tmp_path, rng, n)
    arm = fixed_arm(asked, [])
    blur = Blur(int(np.ceil(T / 2.0**arm.units * ONE)), int(np.ceil(A * ONE)))
    at = np.round(np.array(q) * ONE).astype(np.int64)[:, None]
    low, high = at - ONE // 100, at + ONE // 100
    base, target = views(arm, at)
    (*_, whole) = closures(arm)
    least, most = narrowed(whole, arm, (base, target), at, low, high, blur)
    if n <= 6:
        assert np.any(most - least < ONE // 100)
    away = at + ONE // 20
    base, target = views(arm, away)
    least, most = narrowed(whole, arm, (base, target), away, away - ONE // 1000, away + ONE // 1000, blur)
    assert np.any(least > most)


@settings(max_examples=60, deadline=None)
@given(st.integers(0, 10**9), st.integers(1, 7), st.sampled_from(["box", "sphere", "cylinder"]))
def test_a_sphere_that_is_clear_somewhere_is_not_inside(tmp_path_factory, seed, n, sort):
    """A sphere that at q is a micrometre clear of an obstacle is not inside all over a box that holds q."""
    rng = np.random.default_rng(seed)
    asked, q = planted(tmp_path_factory.mktemp("planted"), rng, n)
    sizes = tuple(rng.uniform(0.05, 0.6, {"box": 3, "sphere": 1, "cylinder": 2}[sort]).tolist())
    obstacle = Obstacle(sort, 0, vector(rng.normal(size=3)), rotation_of(rng.normal(size=4)), sizes)
    sphere = Sphere(int(rng.integers(n + 1)), vector(0.2 * rng.normal(size=3)), 0.0)
    asked = replace(asked, arm=replace(asked.arm, spheres=(sphere,)), obstacles=(obstacle,))
    gap = distance(obstacle, placed(asked, q).centre(asked, 0)).low / SPAN_ONE
    touching = replace(sphere, radius=max(gap - 1e-6, 0.0))
    asked = replace(asked, arm=replace(asked.arm, spheres=(touching,)))
    if gap < 2e-6:
        return
    fixed = fixed_arm(asked, [obstacle.centre])
    blur = Blur(int(np.ceil(T / 2.0**fixed.units * ONE)), int(np.ceil(A * ONE)))
    _, low, high = boxes(q, rng)
    middle = (low + high) >> 1
    half = np.maximum(high - middle, middle - low)
    base, target = views(fixed, middle)
    named = named_pairs(asked, [(0, 0)], 0.0, fixed.units).of(np.zeros(COUNT, dtype=np.int64))
    assert not np.any(inside(fixed, base, target, half, blur, named))
