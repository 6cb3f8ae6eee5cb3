"""What free-space cuboids add to a proof: places of spheres, and how far the best cuboid lets each of them go."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from workcell.ik.ikspark.obstacles.pairs import reachable_pairs
from workcell.ik.problem import IKProblem
from workcell.pose import Array


def moving_spheres(problem: IKProblem) -> NDArray[np.int64]:
    """Indices into the cover of the spheres that joints move."""
    assert problem.cover is not None
    return np.flatnonzero(problem.cover.link > 0)


def held_back(problem: IKProblem, places: Array, covered: Array) -> float | None:
    """Largest `- sum places_j . p_j` for p_j in the cuboids of sphere j; None where a sphere reaches no cuboid.

    At a configuration with every sphere in a cuboid, `sum places_j . (centre_j - p_j)` is zero for some such p.

    Args:
        problem: with cover and free space.
        places: (m, 3) multipliers of the moving spheres' centres in the world.
        covered: (2,) tolerances in metres and radians.
    """
    assert problem.free_space is not None
    tolerances = replace(problem.tolerances, position=float(covered[0]), rotation=float(covered[1]))
    pairs = reachable_pairs(replace(problem, tolerances=tolerances), problem.free_space)
    if not pairs.allowed.any(axis=1).all():
        return None
    worst = -np.where(places[:, None, :] > 0, pairs.lower, pairs.upper) * places[:, None, :]
    reach = np.where(pairs.allowed, worst.sum(axis=-1), -np.inf).max(axis=1, initial=-np.inf)
    return float(reach.sum())
