"""The paper's own recipe, step by step (section X-C.2): what the solver's rows of Table VI stand beside.

Random cells: seeds around the spheres of one solution without obstacles, Algorithm 3, Problem 7 for every pair; the
workcell: its four cuboids, and Problem 7. Then Algorithm 1 with Problem 3 and all of (71), one start and three
restarts, each from a random direction and of 50 iterations at most.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from workcell import clock
from workcell.bench.ik.ikspark_tables.algorithm1 import Ascent, ascend_to_rank_one, judged
from workcell.bench.ik.ikspark_tables.building import SEEDS, Building, build, every_pair, prune
from workcell.bench.ik.ikspark_tables.perspective import PerspectiveSet
from workcell.geometry.free_space.cuboids import holds_spheres
from workcell.geometry.types import FreeSpace
from workcell.ik.ikspark.instance import instance_of
from workcell.ik.problem import IKProblem
from workcell.ik.result import IKResult

STARTS, ITERATIONS = 4, 50
_ROUNDING = 1e-5
"""Metres by which cone programs may miss a cuboid."""


def solve_by_recipe(problem: IKProblem, seed: int, *, pruned: bool = True) -> IKResult:
    """Build and solve one cell; `pruned`: leave out what Problem 7 rules out, else keep every pair ("skip VR")."""
    began = clock.cpu_seconds()
    built = _built(problem, seed, pruned)
    stats = {
        **({"ikspark.built": float(built.built)} if pruned else {}),  # without Problem 7 nobody has asked
        "ikspark.build_cpu_s": clock.cpu_seconds() - began,
    }
    programs, starts, rng = 0, 0, np.random.default_rng(seed)
    with instance_of(problem) as instance:
        result = judged(problem, instance, Ascent(None, 1.0, 0), {})
        if built.built:
            convex = PerspectiveSet(problem, instance, built.free_space, built.allowed)
            while starts < STARTS and not result.solved:
                ascent = ascend_to_rank_one(convex, rng.standard_normal(instance.lift.size), ITERATIONS)
                starts, programs = starts + 1, programs + ascent.programs
                result = judged(problem, instance, ascent, {})
    stats |= {"ikspark.sdps": float(programs), "ikspark.restarts": float(starts)}
    stats["cpu_s"] = clock.cpu_seconds() - began
    held = _cuboids_of(problem, result, built.free_space)
    stats["ikspark.in_given"] = float(held is not None and problem.free_space is not None)
    return replace(result, stats=stats, free_space=built.free_space, cuboids=held)


def _built(problem: IKProblem, seed: int, pruned: bool) -> Building:
    assert problem.cover is not None
    seeds = max(SEEDS, len(problem.cover))
    if problem.free_space is None:
        return build(problem, biased=True, polytopes=False, seed=seed, seeds=seeds, pruned=pruned)
    allowed = prune(problem, problem.free_space) if pruned else every_pair(problem, problem.free_space)
    return Building(problem.free_space, allowed, 0.0, 0.0)


def _cuboids_of(problem: IKProblem, result: IKResult, space: FreeSpace) -> NDArray[np.int64] | None:
    """(m,) a cuboid of each sphere; None where a sphere is in none: in their hull, and clear, but between them."""
    if result.q is None or problem.cover is None:
        return None
    centres = problem.cover.centres_world(problem.robot.link_transforms(result.q))
    slack = problem.cover.radius - _ROUNDING
    inside = holds_spheres(space, centres, slack)
    return np.argmax(inside, axis=1) if inside.any(axis=1).all() else None
