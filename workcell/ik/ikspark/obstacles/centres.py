"""Where spheres' centres are, as affine functions of the lifted variables."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from workcell.identity_cache import ByIdentity
from workcell.ik.ikspark.lift import Lift
from workcell.ik.problem import IKProblem
from workcell.pose import Array

_maps = ByIdentity()
_all = ByIdentity()


def sphere_maps(lift: Lift, problem: IKProblem, spheres: NDArray[np.int64]) -> Array:
    """(m, 3, N + 1, 13) world centres of spheres."""
    cover, base = problem.cover, problem.robot.T_world_base
    assert cover is not None
    points = np.stack([lift.point(int(cover.link[j]), cover.centre[j]) for j in spheres])
    maps: Array = np.einsum("ab,mbxg->maxg", base.rotation, points)
    maps[:, :, -1, 0] += base.position
    return maps


def moving_maps(lift: Lift, problem: IKProblem) -> Array:
    """`sphere_maps` of all spheres that joints move, made once for a chain and a cover."""
    cover, base = problem.cover, problem.robot.T_world_base
    assert cover is not None
    moving = np.flatnonzero(cover.link > 0)
    return _maps.get((lift, cover, base), lambda: sphere_maps(lift, problem, moving))


def all_maps(lift: Lift, problem: IKProblem) -> Array:
    """`sphere_maps` of all spheres, those of the base included, made once for a chain and a cover."""
    cover, base = problem.cover, problem.robot.T_world_base
    assert cover is not None
    every = np.arange(len(cover))
    return _all.get((lift, cover, base), lambda: sphere_maps(lift, problem, every))
