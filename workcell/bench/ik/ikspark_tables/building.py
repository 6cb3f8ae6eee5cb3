"""Building a cell as IKSPARK does (section X-C.2): seeds, regions around them, and Problem 7 for every pair.

The seeds, how many and how far from the spheres, are ours: the paper leaves r_s and the workspace open. Polytopes are
grown by `inflate_polytope`, which follows the paper on IRIS and stands for the authors' program of that name.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from workcell import clock
from workcell.bench.ik.ikspark_tables.perspective import sphere_centres
from workcell.geometry.free_space.cuboids import inflate_cuboids
from workcell.geometry.free_space.polytopes import inflate_polytope
from workcell.geometry.obstacle_arrays import ObstacleArrays
from workcell.geometry.types import FreeSpace
from workcell.ik.ikspark.instance import Instance, instance_of
from workcell.ik.problem import Budget, IKProblem
from workcell.ik.solve import solve
from workcell.pose import Array

SEEDS = 10
"""Of a cell: one for each sphere of the middle density, and as many as the paper has polytopes."""
SCATTER = 0.1
"""r_s: metres around a sphere's centre that biased seeds are drawn from."""
WORKSPACE = 1.1
"""Metres from the shoulder to the workspace's faces: no sphere of the arm gets farther."""
_FREE_BUDGET = Budget(1.0)
_DRAWS = 400
_FACES, _PLANES = 6, 32
"""Rows that the relaxation has room for: of a cuboid, and of a polytope, whose planes beyond would be left out, which
can only make it look roomier."""
_NOWHERE = np.zeros((0, 3))
_AXES = np.vstack([np.eye(3), -np.eye(3)])


@dataclass(frozen=True, slots=True)
class Building:
    """A cell built.

    Attributes:
        free_space: its regions, duplicates removed.
        allowed: (m, k) which of the k regions, cuboids and then polytopes, each moving sphere may be in.
        inflate_s, prune_s: CPU seconds of seeds and regions, and of Problem 7.
    """

    free_space: FreeSpace
    allowed: NDArray[np.bool_]
    inflate_s: float
    prune_s: float

    @property
    def built(self) -> bool:
        """Whether every sphere may be in some region (Remark 8)."""
        return bool(self.allowed.any(axis=1).all())


def build(
    problem: IKProblem,
    *,
    biased: bool,
    polytopes: bool,
    seed: int,
    seeds: int = SEEDS,
    pruned: bool = True,
) -> Building:
    """Regions of free space, and which of them each sphere may be in.

    Args:
        problem: a target among obstacles.
        biased: seeds around the spheres at a solution of the problem without its obstacles; else from anywhere.
        polytopes: grow those, else cuboids by Algorithm 3.
        seed: of that solution and of the seeds.
        seeds: how many.
        pruned: ask Problem 7 about every pair; else all are kept.
    """
    began, bounds = clock.cpu_seconds(), workspace(problem)
    points = (biased_seeds if biased else anywhere)(problem, np.random.default_rng(seed), seeds)
    if polytopes:
        grown = [inflate_polytope(point, problem.obstacles, bounds) for point in points]
        space = FreeSpace(_NOWHERE, _NOWHERE, polytopes=tuple(p for p in grown if p is not None))
    else:
        space = inflate_cuboids(points, problem.obstacles, bounds)
    inflated = clock.cpu_seconds()
    allowed = (prune if pruned else every_pair)(problem, space)
    return Building(space, allowed, inflated - began, clock.cpu_seconds() - inflated)


def workspace(problem: IKProblem) -> Array:
    """(2, 3) corners of a cube around the shoulder."""
    robot = problem.robot
    shoulder = robot.T_world_base.apply(robot.joint_xyz[0] + robot.joint_xyz[1])
    return np.array([shoulder - WORKSPACE, shoulder + WORKSPACE])


def anywhere(problem: IKProblem, rng: np.random.Generator, count: int) -> Array:
    """Points (count, 3) of the workspace that lie in no obstacle."""
    low, high = workspace(problem)
    points = rng.uniform(low, high, size=(_DRAWS, 3))
    return _free(problem, points)[:count]


def biased_seeds(problem: IKProblem, rng: np.random.Generator, count: int) -> Array:
    """Points (count, 3) that lie in no obstacle, drawn from balls around the spheres, one after the other.

    The spheres are those of a configuration that solves the problem without its obstacles. There may be fewer points,
    where most of the spheres lie deep inside obstacles.
    """
    free = solve(replace(problem, obstacles=(), cover=None, free_space=None), "ikspark", _FREE_BUDGET, seed=0)
    assert problem.cover is not None
    moving = problem.cover.link > 0
    centres = problem.cover.centres_world(problem.robot.link_transforms(free.unwrap()))[moving]
    centres = np.tile(centres, (-(-_DRAWS // len(centres)), 1))
    direction = rng.normal(size=centres.shape)
    direction /= np.linalg.norm(direction, axis=1, keepdims=True)
    points = centres + SCATTER * np.cbrt(rng.uniform(size=(len(centres), 1))) * direction
    return _free(problem, points)[:count]


def _free(problem: IKProblem, points: Array) -> Array:
    clear: Array = points[ObstacleArrays(problem.obstacles).nearest(points)[0] > 0.0]
    return clear


def prune(problem: IKProblem, space: FreeSpace) -> NDArray[np.bool_]:
    """(m, k) Problem 7, pair by pair: False where no point of the relaxation has the sphere in the region."""
    regions = [(_AXES, np.concatenate([up, -low])) for low, up in zip(space.lower, space.upper, strict=True)]
    regions += [(polytope.A, polytope.b) for polytope in space.polytopes]
    planes = _PLANES if space.polytopes else _FACES
    with instance_of(problem, halfspaces=planes) as instance:
        centres, radii = sphere_centres(problem, instance)
        pairs = [
            _may_be_in(instance, centre, float(radius), region, planes)
            for centre, radius in zip(centres, radii, strict=True)
            for region in regions
        ]
        return np.array(pairs, dtype=bool).reshape(len(radii), len(regions))


def every_pair(problem: IKProblem, space: FreeSpace) -> NDArray[np.bool_]:
    """(m, k) True: nothing is pruned."""
    assert problem.cover is not None
    moving = np.count_nonzero(problem.cover.link > 0)
    return np.ones((moving, len(space) + len(space.polytopes)), dtype=bool)


def _may_be_in(
    instance: Instance, centre: Array, radius: float, region: tuple[Array, Array], planes: int
) -> bool:
    """Whether the relaxation lets a sphere, its centre (3, N + 1) linear in the lift, be inside {x: A x <= b}."""
    A, b = region
    rows = -A @ centre
    rows[:, -1] += b - radius
    instance.set_halfspaces(rows[np.argsort(b)[:planes]])
    return instance.solve(np.zeros(instance.lift.size)).status != "infeasible"
