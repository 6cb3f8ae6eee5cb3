"""Free space measured: build times, coverage, and how many random cells can be decomposed (IKSPARK, Table VII).

A cell counts as built when every moving sphere has a cuboid or polytope that it can be in while the tool is at the
target: pairs are pruned by distances along the chain and, one by one, by the relaxation of IKSPARK's Problem 7
(Remark 8).
"""

from __future__ import annotations

import time
from dataclasses import replace
from pathlib import Path

import numpy as np

from workcell.bench.reference.generate import generate
from workcell.bench.rows import Bench, Row
from workcell.geometry.decompose import decompose
from workcell.geometry.free_space.cuboids import biased_seeds, inflate_cuboids, random_seeds
from workcell.geometry.free_space.fill import thinned, workspace_box
from workcell.geometry.free_space.polytopes import inflate_polytope
from workcell.geometry.types import FreeSpace, SphereCover
from workcell.ik.diverse.solutions import solutions
from workcell.ik.ikspark.cuboids import sphere_maps
from workcell.ik.ikspark.instance import Instance, instance_of
from workcell.ik.problem import Budget, IKProblem
from workcell.model.loading.load import load_robot
from workcell.model.scene import Scene
from workcell.pose import Array
from workcell.sets.problems import ProblemSet, load_problem_set

SPHERES = 10
"""Of the robot in the random cells: the paper's middle density."""
_SET = "sawyer_random.json"
_SOLUTIONS, _UNBIASED, _SPACING = 8, 20, 0.05
_PAPER = {"biased/cuboids": 0.98, "biased/iris": 0.854, "unbiased/iris": 0.56}
_IRIS = 10
"""Polytopes a cell, as in the paper."""
_AXES = np.vstack([np.eye(3), -np.eye(3)])
_MOST_PLANES = 24
"""Of a region that the relaxation is asked about; more would be left out, which can only make it look roomier."""


def free_space(n: int, seed: int, sets: Path | None) -> list[Row]:
    """The shelf cell once, then n random cells for each way of building."""
    return [_shelf_row(seed), *_random_rows(random_cells(n, seed, sets))]


def _shelf_row(seed: int) -> Row:
    metrics = decompose(Scene.load("shelf_grasp"), seed=seed).metrics
    names = (
        "cuboids",
        "polytopes",
        "cuboid_fraction",
        "covered_fraction",
        "cuboid_build_s",
        "polytope_build_s",
    )
    return {"row": "sawyer/shelf/cuboids", "n": 1, "paper": None, **{name: metrics[name] for name in names}}


def random_cells(n: int, seed: int, sets: Path | None) -> list[IKProblem]:
    """The public set's problems where its folder is given, else as many of our own; spheres thinned out."""
    if sets is not None and (sets / _SET).is_file():
        cells: ProblemSet = load_problem_set(sets / _SET)
    else:
        robot = load_robot("sawyer")
        cells = generate(robot, _beads(load_robot("sawyer").joint_xyz), "random", n, seed)
    return [replace(named.problem, cover=_spread(named.problem.cover)) for named in cells.problems[:n]]


def _beads(origins: Array) -> SphereCover:
    """Spheres strung along a chain: two a link, where no sphere model is given."""
    link = np.repeat(np.arange(len(origins)), 2)[2:]
    ends = np.vstack([origins[1:], np.zeros((1, 3))])
    centre = np.concatenate([[0.0 * end, 0.5 * end] for end in ends[1:]])
    return SphereCover(link, centre, np.full(len(link), 0.07))


def _spread(cover: SphereCover | None) -> SphereCover:
    """`SPHERES` moving spheres, evenly picked along the chain."""
    assert cover is not None
    moving = np.flatnonzero(cover.link > 0)
    picked = moving[np.round(np.linspace(0, len(moving) - 1, min(SPHERES, len(moving)))).astype(int)]
    return SphereCover(cover.link[picked], cover.centre[picked], cover.radius[picked])


def _random_rows(problems: list[IKProblem]) -> list[Row]:
    rows = []
    is_built(
        problems[0], _build(problems[0], "biased/cuboids", 0)
    )  # compiles what is compiled, outside the times
    for way in _PAPER:
        built, counts, times, pruned = 0, [], [], []
        for number, problem in enumerate(problems):
            begun = [time.process_time()]
            space = _build(problem, way, number)
            begun.append(time.process_time())
            built += is_built(problem, space)
            times.append(1e3 * (begun[1] - begun[0]))
            pruned.append(1e3 * (time.process_time() - begun[1]))
            counts.append(len(space) + len(space.polytopes))
        rows.append(
            {
                "row": f"sawyer/random/{way}",
                "n": len(problems),
                "built": built / len(problems),
                "regions_mean": float(np.mean(counts)),
                "build_ms_mean": float(np.mean(times)),
                "build_ms_p95": float(np.percentile(times, 95)),
                "prune_ms_mean": float(np.mean(pruned)),
                "paper": _PAPER[way],
            }
        )
    return rows


def _build(problem: IKProblem, way: str, seed: int) -> FreeSpace:
    """Regions from seeds around solutions of the problem without its obstacles, or from seeds drawn anywhere."""
    bounds, cover = workspace_box(problem.robot), problem.cover
    assert cover is not None
    anywhere = random_seeds(bounds, _UNBIASED, seed=seed)
    seeds = anywhere
    if way.startswith("biased"):
        free = replace(problem, obstacles=(), cover=None)
        found = solutions(free, _SOLUTIONS, Budget(0.2), seed)
        configurations = np.array([result.unwrap() for result in found]).reshape(-1, problem.robot.dof)
        near = biased_seeds(problem.robot, cover, configurations, seed=seed)
        seeds = np.vstack([thinned(near, _SPACING), anywhere])
    if way.endswith("cuboids"):
        return inflate_cuboids(seeds, problem.obstacles, bounds)
    order = np.random.default_rng(seed).permutation(len(seeds))
    grown = [inflate_polytope(seeds[k], problem.obstacles, bounds) for k in order[:_IRIS]]
    kept = tuple(polytope for polytope in grown if polytope is not None)
    return FreeSpace(np.zeros((0, 3)), np.zeros((0, 3)), polytopes=kept)


def is_built(problem: IKProblem, space: FreeSpace) -> bool:
    """Whether every sphere has a region that it may be in while the tool is at the target (Problem 7, Remark 8)."""
    cover = problem.cover
    assert cover is not None
    regions = [(polytope.A, polytope.b) for polytope in space.polytopes]
    regions += [(_AXES, np.concatenate([up, -low])) for low, up in zip(space.lower, space.upper, strict=True)]
    spheres = np.flatnonzero(cover.link > 0)
    with instance_of(problem, halfspaces=_MOST_PLANES) as instance:
        maps = sphere_maps(instance.lift, problem, spheres) @ instance.goal
        return all(
            any(_may_be_in(instance, centre, float(cover.radius[j]), A, b) for A, b in regions)
            for j, centre in zip(spheres, maps, strict=True)
        )


def _may_be_in(instance: Instance, centre: Array, radius: float, A: Array, b: Array) -> bool:
    """Whether the relaxation lets a sphere, its centre (3, N + 1) linear in the lift, be inside {x: A x <= b}."""
    rows = -A @ centre
    rows[:, -1] += b - radius
    instance.set_halfspaces(rows[np.argsort(b)[:_MOST_PLANES]])
    return instance.solve(np.zeros(instance.lift.size)).status != "infeasible"


BENCHES = (
    Bench(
        "free-space",
        100,
        "free space: coverage of the shelf cell, random cells built (IKSPARK, Table VII)",
        free_space,
    ),
)
