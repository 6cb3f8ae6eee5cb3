"""The table of spheres and cuboids: nothing that happens is dropped, much that can't is; files are sound."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from tests.ik.arms import random_arm
from workcell.errors import InputError
from workcell.geometry.free_space.admissible import (
    admissible_pairs,
    check_table,
    load_table,
    save_table,
    with_table,
)
from workcell.geometry.free_space.cuboids import holds_spheres
from workcell.geometry.types import FreeSpace, SphereCover
from workcell.model.loading.load import load_robot


def some_cover(rng: np.random.Generator, links: int, count: int = 24) -> SphereCover:
    return SphereCover(
        rng.integers(0, links + 1, count), rng.normal(0, 0.08, (count, 3)), rng.uniform(0.02, 0.08, count)
    )


def some_space(rng: np.random.Generator, count: int = 8) -> FreeSpace:
    middle, half = rng.uniform(-1.2, 1.2, (count, 3)), rng.uniform(0.05, 0.4, (count, 3))
    return FreeSpace(middle - half, middle + half)


@given(st.integers(0, 2**32 - 1), st.sampled_from(["sawyer", "ur10", "iiwa14"]))
@settings(max_examples=6, deadline=None)
def test_a_sphere_that_was_seen_in_a_cuboid_is_admissible_there(seed: int, name: str) -> None:
    rng = np.random.default_rng(seed)
    robot = load_robot(name)
    cover, space = some_cover(rng, robot.dof), some_space(rng)
    q = robot.random_configuration(rng, 1500)
    seen = holds_spheres(space, cover.centres_world(robot.link_transforms(q)), cover.radius).any(axis=0)
    table = admissible_pairs(robot, cover, space)
    assert not np.any(seen & ~table)


def test_what_the_limits_forbid_is_dropped() -> None:
    robot = load_robot("iiwa14")
    cover = SphereCover(np.array([0, 2, 7]), np.zeros((3, 3)), np.full(3, 0.05))
    far = FreeSpace([[2.0, -0.5, 0], [-0.1, -0.1, -0.1]], [[3.0, 0.5, 1], [0.1, 0.1, 0.1]])
    table = admissible_pairs(robot, cover, far)
    assert not table[:, 0].any()  # out of reach
    assert table[0, 1] and not table[1, 1]  # the base is there, the upper arm's start is higher
    tiny = FreeSpace([[0.3, 0.3, 0.3]], [[0.35, 0.35, 0.35]])
    assert not admissible_pairs(robot, cover, tiny).any()  # no sphere fits


@given(st.integers(0, 2**32 - 1))
@settings(max_examples=6, deadline=None)
def test_sliding_joints_count_their_travel(seed: int) -> None:
    rng = np.random.default_rng(seed)
    robot = random_arm(rng, 5, sliding=True)
    cover, space = some_cover(rng, robot.dof), some_space(rng)
    q = robot.random_configuration(rng, 1500)
    seen = holds_spheres(space, cover.centres_world(robot.link_transforms(q)), cover.radius).any(axis=0)
    assert not np.any(seen & ~admissible_pairs(robot, cover, space))


def test_a_table_comes_back_from_its_file_and_only_for_its_own(tmp_path: Path) -> None:
    rng = np.random.default_rng(4)
    robot = load_robot("ur10")
    cover, space = some_cover(rng, robot.dof), some_space(rng)
    kept = with_table(robot, cover, space)
    path = save_table(tmp_path / "pairs.npz", robot, cover, kept)
    again = load_table(path, robot, cover, space)
    assert again.admissible is not None and np.array_equal(again.admissible, kept.admissible)
    moved = replace(space, upper=space.upper + 0.01)
    with pytest.raises(InputError, match="another robot, cover or free space"):
        load_table(path, robot, cover, moved)
    path.write_bytes(path.read_bytes()[:-40])
    with pytest.raises(InputError, match="not a readable table"):
        load_table(path, robot, cover, space)
    with pytest.raises(InputError, match="no table"):
        save_table(path, robot, cover, space)
    other = replace(cover, radius=cover.radius + 0.001)
    check_table(robot, cover, kept)
    check_table(robot, other, space)  # no table, nothing to refuse
    for changed in (
        (robot, other, kept),
        (load_robot("sawyer"), cover, kept),
        (robot, cover, replace(kept, upper=kept.upper + 1)),
    ):
        with pytest.raises(InputError, match="table of pairs is of another"):
            check_table(*changed)
        with pytest.raises(InputError, match="with_table"):
            save_table(path, *changed)
    with pytest.raises(InputError, match="a column for each cuboid"):
        replace(space, admissible=np.ones((3, 3), dtype=bool))
