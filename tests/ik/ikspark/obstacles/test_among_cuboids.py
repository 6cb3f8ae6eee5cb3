"""Among obstacles every sphere of an answer is in the region that it names; the fallback has its own name."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import replace

import numpy as np
import pytest

from tests.ik.arms import beads, box
from tests.ik.lifted_arms import seven_axis
from workcell.errors import InputError
from workcell.geometry.free_space.cuboids import holds_spheres, inflate_cuboids
from workcell.geometry.free_space.polytopes import inflate_polytope
from workcell.geometry.types import FreeSpace
from workcell.ik.ikspark.solver import CUTS, solve_ikspark
from workcell.ik.judge.verify import verify
from workcell.ik.problem import Budget, Clearance, IKProblem
from workcell.ik.registry import SOLVERS, is_planned_by
from workcell.ik.result import Candidate
from workcell.ik.solve import solve
from workcell.pose import Array

BUDGET = Budget(20.0, effort=1.0)
BOUNDS = np.array([[-1.5, -1.5, -1.0], [1.5, 1.5, 2.0]])


def cells(count: int, seed: int = 8) -> Iterator[IKProblem]:
    """Random boxes around an arm that a configuration clears."""
    robot, rng = seven_axis(), np.random.default_rng(seed)
    cover = beads(robot, 0.06)
    while count:
        q = robot.random_configuration(rng)
        places = rng.uniform([-0.8, -0.8, -0.3], [0.8, 0.8, 1.3], (8, 3))
        boxes = tuple(box(f"box{i}", tuple(place), (0.1, 0.12, 0.15)) for i, place in enumerate(places))
        problem = IKProblem(robot, robot.fk(q), obstacles=boxes, cover=cover)
        if verify(problem, q).accepted:
            count -= 1
            yield problem


def assert_inside(problem: IKProblem, candidate: Candidate) -> None:
    """Every moving sphere, with its radius, is inside the region that it is assigned to."""
    assert candidate.q is not None and candidate.cuboids is not None and candidate.free_space is not None
    space, cover = candidate.free_space, problem.cover
    assert cover is not None
    centres = cover.centres_world(problem.robot.link_transforms(candidate.q))
    for link, centre, radius, k in zip(cover.link, centres, cover.radius, candidate.cuboids, strict=True):
        if link == 0:
            assert k == -1
        elif k < len(space):
            assert np.all(centre - radius >= space.lower[k]) and np.all(centre + radius <= space.upper[k])
        else:
            polytope = space.polytopes[k - len(space)]
            assert np.all(polytope.A @ centre + radius <= polytope.b)


def test_answers_are_in_cuboids_that_the_search_has_grown() -> None:
    for seed, problem in enumerate(cells(6)):
        candidate = solve_ikspark(problem, BUDGET, seed, fallback=False)
        assert candidate.q is not None and verify(problem, candidate.q).accepted
        assert candidate.by == ""
        assert_inside(problem, candidate)
        again = solve_ikspark(problem, BUDGET, seed, fallback=False)
        assert np.array_equal(candidate.q, again.q) and candidate.stats["sdps"] == again.stats["sdps"]


def test_a_given_free_space_that_holds_the_answer_is_the_one_that_is_named() -> None:
    problem = next(cells(1, seed=3))
    grown = solve_ikspark(problem, BUDGET, 0, fallback=False)
    given = replace(problem, free_space=grown.free_space)
    candidate = solve_ikspark(given, BUDGET, 0, fallback=False)
    assert candidate.free_space is given.free_space
    assert_inside(given, candidate)


def another_answer(problem: IKProblem, q: Array) -> Array:
    """A configuration far from q (n,) that solves the problem too."""
    for seed in range(1, 20):
        other = solve_ikspark(problem, BUDGET, seed, fallback=False).q
        if other is not None and np.abs(problem.robot.unwrap(other, q) - q).max() > 0.5:
            return other
    raise AssertionError("every seed leads to the same configuration")


def cuboids_around(problem: IKProblem, q: Array, half: float) -> FreeSpace:
    """A small cuboid around each moving sphere at q (n,), cut off where obstacles are."""
    assert problem.cover is not None
    moving = problem.cover.link > 0
    centres = problem.cover.centres_world(problem.robot.link_transforms(q))[moving]
    grown = inflate_cuboids(centres, problem.obstacles, BOUNDS)
    held = holds_spheres(grown, centres, problem.cover.radius[moving]).argmax(axis=1)
    return FreeSpace(
        np.maximum(grown.lower[held], centres - half), np.minimum(grown.upper[held], centres + half)
    )


def test_given_cuboids_decide_where_the_plain_answer_lies_outside_of_them() -> None:
    for problem in list(cells(4, seed=11)):
        plain = solve_ikspark(problem, BUDGET, 0, fallback=False)
        assert plain.q is not None and plain.stats["in_given"] == 0.0
        space = cuboids_around(problem, another_answer(problem, plain.q), 0.08)
        given = replace(problem, free_space=space)
        candidate = solve_ikspark(given, BUDGET, 0, fallback=False)
        assert candidate.free_space is space and candidate.stats["in_given"] == 1.0
        assert_inside(given, candidate)
        assert not np.allclose(candidate.q, plain.q, atol=0.05)


def test_polytopes_hold_spheres_too() -> None:
    problem = next(cells(1, seed=4))
    q = solve_ikspark(problem, BUDGET, 0, fallback=False).q
    assert q is not None and problem.cover is not None
    centres = problem.cover.centres_world(problem.robot.link_transforms(q))[problem.cover.link > 0]
    grown = [inflate_polytope(centre, problem.obstacles, BOUNDS) for centre in centres]
    nothing = np.zeros((0, 3))
    space = FreeSpace(nothing, nothing, polytopes=tuple(p for p in grown if p is not None))
    given = replace(problem, free_space=space, q_reference=q, max_step=0.05)
    candidate = solve_ikspark(given, BUDGET, 0, fallback=False)
    assert candidate.free_space is not None
    assert candidate.free_space.polytopes[: len(space.polytopes)] == space.polytopes
    assert candidate.cuboids is not None and np.any(candidate.cuboids >= len(candidate.free_space))
    assert_inside(given, candidate)


def test_queries_that_share_a_free_space_ask_it_to_grow() -> None:
    problem = next(cells(1, seed=5))
    shared = [solve_ikspark(problem, BUDGET, 0, fallback=False).free_space]
    asked = []

    def grow(points):
        asked.append(points)
        return shared[0]

    nothing = FreeSpace(np.zeros((0, 3)), np.zeros((0, 3)))
    candidate = solve_ikspark(replace(problem, free_space=nothing, grow=grow), BUDGET, 0, fallback=False)
    assert asked and candidate.free_space is shared[0]
    assert_inside(problem, candidate)


def test_what_no_cuboid_holds_is_the_fallback_s_and_says_so() -> None:
    """The cover touches the obstacle at every configuration; the judge, who knows better, does not mind."""
    robot = seven_axis()
    q = np.array([0.3, 0.6, -0.4, 1.2, 0.2, 0.8, 0.0])
    cover = beads(robot, 0.06)
    at = cover.centres_world(robot.link_transforms(q))[-1]
    problem = IKProblem(robot, robot.fk(q), (box("part", tuple(at), (0.01, 0.01, 0.01)),), cover)
    problem = replace(problem, checker=lambda q: Clearance(0.01))
    result = solve(problem, "ikspark", BUDGET)
    assert result.solved and result.solver == CUTS and result.cuboids is None
    assert SOLVERS[CUTS].within == "ikspark" and is_planned_by("ikspark", CUTS)
    assert solve_ikspark(problem, BUDGET, 0, fallback=False).q is None
    local = solve_ikspark(problem, BUDGET, 0, local=True)
    assert local.q is not None and local.cuboids is None


def test_the_fallback_comes_after_a_counted_amount_of_work(monkeypatch: pytest.MonkeyPatch) -> None:
    problem = next(p for k, p in enumerate(cells(6)) if solve_ikspark(p, BUDGET, k).stats["restarts"] > 1)
    alone = solve(problem, "ikspark", BUDGET)
    assert alone.solver == "ikspark" and any(stage.name == "cuboids grown" for stage in alone.stages)
    monkeypatch.setattr("workcell.ik.ikspark.solver.CUBOIDS_FIRST", 1)
    result = solve(problem, "ikspark", BUDGET)
    assert result.solver == CUTS and result.cuboids is None
    assert any("half-spaces" in stage.note for stage in result.stages)


def test_nothing_is_proved_about_free_space_that_was_grown() -> None:
    """A wall in the shoulder, free space that holds no arm: only what was given is proved to be too small."""
    robot = seven_axis()
    q = np.array([0.3, 0.6, -0.4, 1.2, 0.2, 0.8, 0.0])
    shoulder = box("wall", (0.0, 0.0, 0.3), (0.02, 0.02, 0.02))
    problem = IKProblem(robot, robot.fk(q), (shoulder,), beads(robot, 0.04))
    small = FreeSpace([[-1, -1, 0]], [[-0.3, 1, 0.9]])
    few = Budget(20.0, effort=0.3)
    assert solve_ikspark(problem, few, 0).certificate is None
    given = solve_ikspark(replace(problem, free_space=small), few, 0).certificate
    assert given is not None and given.scope == "model"
    growing = replace(problem, free_space=small, grow=lambda points, radii=None: small)
    assert solve_ikspark(growing, few, 0).certificate is None


def test_half_spaces_alone_are_a_solver() -> None:
    problem = next(cells(1, seed=6))
    result = solve(problem, CUTS, BUDGET)
    assert result.solved and result.solver == CUTS and result.cuboids is None
    assert not any("cuboid" in stage.name for stage in result.stages)


def test_bounds_around_a_reference_hold_among_cuboids() -> None:
    rng = np.random.default_rng(0)
    for problem in cells(3, seed=7):
        q = solve_ikspark(problem, BUDGET, 0, fallback=False).q
        assert q is not None
        reference = np.clip(q + rng.uniform(-0.04, 0.04, 7), problem.robot.lower, problem.robot.upper)
        near = replace(problem, q_reference=reference, max_step=0.08, max_link_rotation=0.4)
        candidate = solve_ikspark(near, BUDGET, 0, fallback=False)
        assert candidate.q is not None and verify(near, candidate.q).accepted
        assert_inside(near, candidate)


def test_free_space_of_another_scene_or_cover_is_refused() -> None:
    problem = next(cells(1))
    middle = problem.obstacles[2].pose.position
    over = FreeSpace(np.array([middle - 0.3, [2.0, 2, 2]]), np.array([middle + 0.3, [2.5, 2.5, 2.5]]))
    with pytest.raises(InputError, match="cuboid 0 overlaps the obstacle 'box"):
        solve_ikspark(replace(problem, free_space=over), BUDGET, 0)
    far = FreeSpace(
        np.array([[2.0, 2, 2]]), np.array([[2.5, 2.5, 2.5]]), admissible=np.ones((3, 1), dtype=bool)
    )
    with pytest.raises(InputError, match="table of pairs is of another"):
        solve_ikspark(replace(problem, free_space=far), BUDGET, 0)
    polytope = inflate_polytope(middle, (), BOUNDS)
    assert polytope is not None
    nothing = np.zeros((0, 3))
    with pytest.raises(InputError, match="polytope 0"):
        solve_ikspark(
            replace(problem, free_space=FreeSpace(nothing, nothing, polytopes=(polytope,))), BUDGET, 0
        )
