"""The paper's recipe: its set holds what it should, and what it finds lies in its cuboids and is judged."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from workcell.bench.ik.ikspark_tables.algorithm1 import ascend_to_rank_one
from workcell.bench.ik.ikspark_tables.building import every_pair, prune
from workcell.bench.ik.ikspark_tables.cells import Cell, Kind, cells
from workcell.bench.ik.ikspark_tables.perspective import PerspectiveSet, sphere_centres
from workcell.bench.ik.ikspark_tables.recipe import ITERATIONS, STARTS, solve_by_recipe
from workcell.geometry.types import FreeSpace
from workcell.ik.ikspark.instance import instance_of
from workcell.ik.judge.verify import verify


def _around(cell: Cell) -> FreeSpace:
    """A cuboid around each sphere where the arm is planted."""
    cover, robot = cell.problem.cover, cell.problem.robot
    assert cover is not None
    centres = cover.centres_world(robot.link_transforms(cell.planted))
    half = cover.radius[:, None] + 0.03
    return FreeSpace(centres - half, centres + half)


def test_centres_of_a_lifted_configuration_are_the_spheres() -> None:
    (cell,) = cells("random", "mid", 1)
    cover = cell.problem.cover
    assert cover is not None
    expected = cover.centres_world(cell.problem.robot.link_transforms(cell.planted))
    with instance_of(cell.problem) as instance:
        centres, radii = sphere_centres(cell.problem, instance)
        x = instance.lift.lift(cell.planted)
        assert np.allclose(centres[..., :-1] @ x + centres[..., -1], expected, atol=1e-9)
    assert np.array_equal(radii, cover.radius)


def test_the_set_holds_the_planted_configuration_and_is_empty_where_a_sphere_has_no_room() -> None:
    (cell,) = cells("random", "low", 1)
    space = _around(cell)
    with instance_of(cell.problem) as instance:
        x = instance.lift.lift(cell.planted)
        pairs = every_pair(cell.problem, space)
        towards = PerspectiveSet(cell.problem, instance, space, pairs).solve(-x)
        # the lift's own blocks have the largest inner product that any point of the relaxation has with them
        assert towards.usable and -towards.dual_objective >= x @ x - 1e-4
        away = FreeSpace(space.lower[:1] + 3.0, space.upper[:1] + 3.0)
        nowhere = PerspectiveSet(cell.problem, instance, away, every_pair(cell.problem, away))
        assert nowhere.solve(-x).status == "infeasible"


def test_a_point_of_rank_one_with_every_pair_fixed_has_its_spheres_in_their_cuboids() -> None:
    (cell,) = cells("random", "low", 1, seed=3)
    space, cover = _around(cell), cell.problem.cover
    assert cover is not None
    with instance_of(cell.problem) as instance:
        fixed = np.eye(len(cover), dtype=bool)
        ascent = ascend_to_rank_one(
            PerspectiveSet(cell.problem, instance, space, fixed), instance.lift.lift(cell.planted), 50
        )
        assert ascent.rank_one and ascent.x is not None
        centres, radii = sphere_centres(cell.problem, instance)
        at = centres[..., :-1] @ ascent.x + centres[..., -1]
    assert (at - radii[:, None] >= space.lower - 1e-5).all()
    assert (at + radii[:, None] <= space.upper + 1e-5).all()


@pytest.mark.parametrize("kind", ["random", "workcell"])
def test_the_recipe_repeats_and_answers_only_with_what_the_judge_accepts(kind: Kind) -> None:
    solved = 0
    for seed, cell in enumerate(cells(kind, "mid", 4)):
        one, two = solve_by_recipe(cell.problem, seed), solve_by_recipe(cell.problem, seed)
        assert one.status is two.status and one.stats["ikspark.sdps"] == two.stats["ikspark.sdps"]
        assert one.stats["ikspark.restarts"] <= STARTS
        assert one.stats["ikspark.sdps"] <= STARTS * ITERATIONS
        assert 0.0 <= one.stats["ikspark.build_cpu_s"] <= one.stats["cpu_s"]
        if one.solved:
            assert one.q is not None and two.q is not None and np.array_equal(one.q, two.q)
            assert verify(cell.problem, one.q).accepted
            solved += 1
    assert solved >= 2


def test_a_cell_without_room_is_not_built_and_not_solved() -> None:
    (cell,) = cells("workcell", "low", 1)
    cramped = replace(cell.problem, free_space=FreeSpace(np.zeros((1, 3)), np.full((1, 3), 0.1)))
    assert not prune(cramped, cramped.free_space or _around(cell)).any()
    result = solve_by_recipe(cramped, 0)
    assert not result.solved and result.stats["ikspark.built"] == 0.0 and result.stats["ikspark.sdps"] == 0.0
