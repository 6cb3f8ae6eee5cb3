"""The free space of a cell: seeds where the robot is and will be, the best cuboids, and some polytopes.

Polytopes stand where cuboids fit badly.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import ArrayLike, NDArray

from workcell.geometry.engine import ClearanceEngine
from workcell.geometry.free_space.cuboids import (
    biased_seeds,
    holds_spheres,
    inflate_cuboids,
    random_seeds,
    select_cuboids,
)
from workcell.geometry.free_space.polytopes import inflate_polytope
from workcell.geometry.obstacle_arrays import ObstacleArrays
from workcell.geometry.types import FreePolytope, FreeSpace, Piece, SphereCover
from workcell.model.robot import Robot
from workcell.pose import Array

_BIASED_CONFIGURATIONS, _RANDOM_SEEDS, _SAMPLES = 8, 60, 200
_SPACING = 0.1
"""Metres: of the seeds in one cell of this size the first is used; neighbours grow into the same cuboid."""


@dataclass(frozen=True, slots=True)
class Held:
    """Share of the reachable free workspace inside one cuboid, and inside one cuboid or polytope; nan: none is free."""

    in_cuboids: float
    in_any: float


def fill_free_space(
    robot: Robot,
    cover: SphereCover,
    obstacles: Sequence[Piece],
    configurations: Sequence[Array],
    *,
    points: ArrayLike = (),
    seed: int = 0,
    most: int = 12,
) -> FreeSpace:
    """Cuboids from seeds at given configurations and points, at random free ones, and anywhere; the best of them.

    Args:
        robot, cover, obstacles: what moves among what.
        configurations: (n,) each, that the free space must serve.
        points: (k, 3) where free space is wanted, such as goals; the largest cuboid at each is kept.
        seed: of the random configurations and seeds.
        most: number of other cuboids to keep, those that hold the most of the robot's spheres.
    """
    rng = np.random.default_rng(seed)
    moving = cover.link > 0
    part = SphereCover(cover.link[moving], cover.centre[moving], cover.radius[moving], cover.kind)
    packed = ObstacleArrays(obstacles)
    drawn = robot.random_configuration(rng, 10 * _BIASED_CONFIGURATIONS)
    clear = _are_clear(robot, part, packed, drawn)
    free = drawn[clear][:_BIASED_CONFIGURATIONS]
    bounds = workspace_box(robot)
    spots = np.asarray(points, dtype=float).reshape(-1, 3)
    near = biased_seeds(robot, part, np.vstack([*(q[None] for q in configurations), free]), seed=seed)
    seeds = [spots, thinned(near, _SPACING), random_seeds(bounds, _RANDOM_SEEDS, seed=seed)]
    cuboids = inflate_cuboids(np.vstack(seeds), obstacles, bounds)
    centres, radii = free_spheres(robot, part, packed, samples=_SAMPLES, seed=seed)
    wanted = part.centres_world(robot.link_transforms(np.array(configurations)))
    around = holds_spheres(cuboids, spots, np.zeros(len(spots)))
    needed = sorted({int(np.argmax(row)) for row in around if row.any()})
    return select_cuboids(cuboids, np.concatenate([wanted, centres]), radii, most=most, needed=needed)


def thinned(points: Array, spacing: float) -> Array:
    """The first of the points (k, 3) in every cell of a grid, in their order."""
    cells = np.floor(points / spacing).astype(np.int64)
    kept: Array = points[np.sort(np.unique(cells, axis=0, return_index=True)[1])]
    return kept


def with_polytopes(
    free_space: FreeSpace,
    robot: Robot,
    cover: SphereCover,
    obstacles: Sequence[Piece],
    *,
    seed: int = 0,
    most: int = 8,
) -> FreeSpace:
    """The same, with polytopes around spheres that no cuboid holds, until no sampled one is left or `most`.

    Each grows from the centre of a sphere, drawn from random free configurations, that is still left, and is kept if it
    holds some.
    """
    rng = np.random.default_rng(seed)
    centres, radii = free_spheres(robot, cover, obstacles, samples=_SAMPLES, seed=seed)
    left = ~holds_spheres(free_space, centres, radii).any(axis=-1)
    centres, radii = centres[left], np.tile(radii, (len(centres), 1))[left]
    found: list[FreePolytope] = []
    for _ in range(3 * most):
        if len(found) == most or not len(centres):
            break
        pick = int(rng.integers(len(centres)))
        held = np.arange(len(centres)) == pick
        polytope = inflate_polytope(centres[pick], obstacles, workspace_box(robot))
        if polytope is not None:
            inside = polytope.holds_spheres(centres[:, None], radii[:, None])[:, 0]
            found += [polytope] if inside.any() else []
            held |= inside
        centres, radii = centres[~held], radii[~held]
    return replace(free_space, polytopes=tuple(found))


def workspace_box(robot: Robot, slack: float = 0.2) -> Array:
    """(2, 3) corners of a box around all that the robot can reach, with `slack` metres to spare."""
    origin = robot.T_world_base.apply(robot.joint_xyz[0])
    radius = robot.reach() + slack
    return np.array([origin - radius, origin + radius])


def spheres_held(
    free_space: FreeSpace,
    robot: Robot,
    cover: SphereCover,
    obstacles: ObstacleArrays | Sequence[Piece],
    *,
    samples: int = 200,
    seed: int = 0,
) -> Held:
    """Share of the reachable free workspace inside the cuboids, and the polytopes.

    Measured on the moving spheres of random collision-free configurations: the share that lies, with its radius,
    inside one cuboid, or inside one cuboid or polytope.
    """
    centres, radii = free_spheres(robot, cover, obstacles, samples=samples, seed=seed)
    if len(centres) == 0:
        return Held(float("nan"), float("nan"))
    held = holds_spheres(free_space, centres, radii).any(axis=-1)
    either = held.copy()
    for polytope in free_space.polytopes:
        either |= polytope.holds_spheres(centres, radii)
    return Held(float(held.mean()), float(either.mean()))


def free_spheres(
    robot: Robot,
    cover: SphereCover,
    obstacles: ObstacleArrays | Sequence[Piece],
    *,
    samples: int = 200,
    seed: int = 0,
) -> tuple[Array, Array]:
    """World centres (k, m, 3) of the moving spheres in those of `samples` random configurations that are free, and
    their radii (m,).
    """
    moving = cover.link > 0
    part = SphereCover(cover.link[moving], cover.centre[moving], cover.radius[moving], cover.kind)
    q = robot.random_configuration(np.random.default_rng(seed), samples)
    packed = obstacles if isinstance(obstacles, ObstacleArrays) else ObstacleArrays(obstacles)
    free = _are_clear(robot, part, packed, q)
    return part.centres_world(robot.link_transforms(q[free])), np.array(part.radius)


def _are_clear(robot: Robot, cover: SphereCover, obstacles: ObstacleArrays, q: Array) -> NDArray[np.bool_]:
    """(k,) whether no sphere touches an obstacle at configurations q (k, n)."""
    clearance = ClearanceEngine(robot, cover, obstacles).sphere_clearances(q)
    clear: NDArray[np.bool_] = np.all(clearance >= 0, axis=1)
    return clear
