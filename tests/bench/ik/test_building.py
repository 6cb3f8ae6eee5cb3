"""Regions of free space as IKSPARK builds them, and what Problem 7 says of their pairs with spheres."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from workcell.bench.ik.ikspark_tables.building import (
    SCATTER,
    anywhere,
    biased_seeds,
    build,
    prune,
    workspace,
)
from workcell.bench.ik.ikspark_tables.cells import Cell, cells
from workcell.bench.ik.ikspark_tables.table7 import WAYS, table7
from workcell.geometry.free_space.cuboids import holds_spheres
from workcell.geometry.free_space.polytopes import inflate_polytope
from workcell.geometry.separation import separations
from workcell.geometry.types import FreeSpace
from workcell.ik.judge.exact import ExactDistances
from workcell.ik.problem import IKProblem

NOWHERE = np.zeros((0, 3))


@pytest.fixture(scope="module")
def drawn() -> list[Cell]:
    """Three random cells."""
    return cells("random", "mid", 3)


def test_a_region_that_holds_everything_is_allowed_and_one_out_of_reach_is_not(drawn: list[Cell]) -> None:
    problem = drawn[0].problem
    low, high = workspace(problem)
    everything, far = FreeSpace(low[None], high[None]), FreeSpace(high[None] + 1.0, high[None] + 2.0)
    assert prune(problem, everything).all() and not prune(problem, far).any()
    whole = inflate_polytope(problem.target.position, (), np.array([low, high]))
    assert whole is not None and prune(problem, FreeSpace(NOWHERE, NOWHERE, polytopes=(whole,))).all()
    assert prune(problem, FreeSpace(NOWHERE, NOWHERE)).shape == (10, 0)


def test_no_pair_of_a_solution_is_ever_pruned(drawn: list[Cell]) -> None:
    """Spheres at a configuration that solves the problem are in regions that the relaxation must allow."""
    for cell in drawn:
        cover, robot = cell.problem.cover, cell.problem.robot
        assert cover is not None
        centres = cover.centres_world(robot.link_transforms(cell.planted))
        half = 0.02 + cover.radius[:, None]
        space = FreeSpace(centres - half, centres + half)
        held = holds_spheres(space, centres, cover.radius)
        assert held.diagonal().all() and (prune(cell.problem, space) >= held).all()


def test_seeds_lie_in_no_obstacle_and_biased_ones_near_the_spheres_of_a_solution(drawn: list[Cell]) -> None:
    problem = drawn[1].problem
    open_cell = replace(problem, obstacles=())
    rng = np.random.default_rng
    for seeds in (anywhere(problem, rng(0), 10), biased_seeds(problem, rng(0), 10)):
        assert seeds.shape == (10, 3) and ExactDistances(problem.obstacles)(seeds).min() > 0.0
        low, high = workspace(problem)
        assert np.all((seeds >= low) & (seeds <= high))
    assert problem.cover is not None
    ends = biased_seeds(open_cell, rng(1), 10)
    last = problem.robot.link_transforms(drawn[1].planted)[problem.cover.link[-1]]
    centre = (
        last[:3, :3] @ problem.cover.centre[-1] + last[:3, 3]
    )  # the target alone says where that sphere is
    assert np.linalg.norm(ends[9] - centre) <= SCATTER + 1e-3


def test_regions_are_free_of_obstacles_and_repeat(drawn: list[Cell]) -> None:
    problem = drawn[2].problem
    one, two = (build(problem, biased=True, polytopes=False, seed=4) for _ in range(2))
    assert np.array_equal(one.free_space.lower, two.free_space.lower)
    assert np.array_equal(one.allowed, two.allowed) and one.allowed.shape == (10, len(one.free_space))
    assert separations(one.free_space.lower, one.free_space.upper, problem.obstacles)[0].min() > 0.0
    grown = build(problem, biased=True, polytopes=True, seed=4)
    assert len(grown.free_space.polytopes) == 10 and grown.allowed.shape == (10, 10)
    for piece in problem.obstacles:
        corners = _corners(problem, piece.name)
        for polytope in grown.free_space.polytopes:
            assert (corners @ polytope.A.T >= polytope.b).all(axis=0).any()


def _corners(problem: IKProblem, name: str) -> np.ndarray:
    (piece,) = (piece for piece in problem.obstacles if piece.name == name)
    signs = np.array([[x, y, z] for x in (-1, 1) for y in (-1, 1) for z in (-1, 1)])
    return piece.pose.apply(signs * piece.size)


def test_table_7_has_a_row_for_each_way_with_the_paper_beside() -> None:
    rows = table7(1, 0)
    assert [row["row"] for row in rows] == [f"sawyer/random/mid/{way.name}" for way in WAYS]
    assert [row["paper"] for row in rows] == [0.56, 0.854, 0.98, None]
    assert all(row["n"] == 1 and row["regions_mean"] >= 1 and 0 <= row["pairs_kept"] <= 1 for row in rows)
