"""Pruning drops no pair of sphere and region that a configuration which reaches the target uses."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from tests.ik.arms import beads
from tests.ik.lifted_arms import parallel_elbow, seven_axis, skew_arm
from workcell.geometry.types import FreePolytope, FreeSpace
from workcell.ik.ikspark.obstacles.pairs import Balls, chain_balls, region_pairs, step_balls
from workcell.ik.ikspark.obstacles.regions import Regions
from workcell.ik.problem import IKProblem
from workcell.model.robot import Robot
from workcell.pose import Array, Pose

BASE = Pose(np.array([0.3, -0.2, 0.5]), np.array([0.5, 0.5, 0.5, -0.5]))
NOWHERE = np.zeros((0, 3))
ARMS = [seven_axis(), replace(parallel_elbow(), T_world_base=BASE), skew_arm(6, 6)]


def regions_around(rng: np.random.Generator, reach: float, spots: Array = NOWHERE) -> FreeSpace:
    """Boxes anywhere, the first of them near spots, and turned ones as polytopes."""
    middle, half = rng.uniform(-reach, reach, (30, 3)), rng.uniform(0.1, 0.5, (30, 3))
    near = spots[:10] + rng.uniform(-0.2, 0.2, spots[:10].shape)
    middle[: len(near)] = near
    turned = []
    for _ in range(10):
        axes = np.linalg.qr(rng.standard_normal((3, 3)))[0]
        at = axes @ rng.uniform(-reach, reach, 3)
        turned.append(FreePolytope(np.vstack([axes, -axes]), np.concatenate([at + 0.4, 0.4 - at]), 0.0))
    return FreeSpace(middle - half, middle + half, polytopes=tuple(turned))


@pytest.mark.parametrize("step", [0.05, 0.4, None])
@pytest.mark.parametrize("robot", ARMS, ids=lambda robot: f"{robot.name}{robot.dof}")
def test_no_pair_that_is_used_is_dropped(robot: Robot, step: float | None) -> None:
    rng = np.random.default_rng(0)
    cover, used, dropped = beads(robot, 0.03), 0, 0
    moving = np.flatnonzero(cover.link > 0)
    for _ in range(20):
        q = robot.random_configuration(rng)
        centres = cover.centres_world(robot.link_transforms(q))[moving]
        regions = Regions.of(regions_around(rng, 1.2 * robot.reach(), centres[::2]))
        problem = IKProblem(robot, robot.fk(q), cover=cover)
        if step is not None:
            reference = q + rng.uniform(-step, step, robot.dof)
            problem = replace(problem, q_reference=reference, max_step=step)
        allowed = region_pairs(problem, regions)
        inside = regions.depths(centres, cover.radius[moving]) <= 0.0
        assert not np.any(inside & ~allowed)
        used, dropped = used + np.count_nonzero(inside), dropped + np.count_nonzero(~allowed)
    assert used > 50 and dropped > 1000


def assert_holds(balls: Balls, centres: Array) -> None:
    assert np.all(np.linalg.norm(centres - balls.centre, axis=1) <= balls.radius + 1e-9)


@pytest.mark.parametrize("robot", ARMS, ids=lambda robot: f"{robot.name}{robot.dof}")
def test_balls_hold_the_spheres_of_all_that_counts_as_reaching_the_target(robot: Robot) -> None:
    rng, cover = np.random.default_rng(1), beads(robot, 0.03)
    for _ in range(50):
        reference, step = robot.random_configuration(rng), rng.uniform(0.01, 0.3)
        q = np.clip(reference + rng.uniform(-step, step, robot.dof), robot.lower, robot.upper)
        problem = IKProblem(robot, robot.fk(q), cover=cover, q_reference=reference, max_step=step)
        centres = cover.centres_world(robot.link_transforms(q))[cover.link > 0]
        for balls in (*chain_balls(problem), *step_balls(problem)):
            assert_holds(balls, centres)


def test_depths_and_places_in_regions_agree() -> None:
    rng = np.random.default_rng(2)
    regions = Regions.of(regions_around(rng, 1.0))
    centres, radii = rng.uniform(-1, 1, (200, 3)), rng.uniform(0.0, 0.1, 200)
    depths = regions.depths(centres, radii)
    held = regions.holding(centres, radii)
    assert np.array_equal(held >= 0, (depths <= 0).any(axis=1))
    assert np.all(depths[held >= 0, held[held >= 0]] <= 0)
    assert len(regions) == 40 and np.any(held >= 30)
    nothing = Regions.of(FreeSpace(np.zeros((0, 3)), np.zeros((0, 3))))
    assert np.all(nothing.holding(centres, radii) == -1)
