"""Problems as arrays for the compiled kernels."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from workcell.geometry.packing import joint_bounds, pack_arm, pack_cover, pack_obstacles
from workcell.identity_cache import ByIdentity
from workcell.ik.problem import IKProblem
from workcell.ik.shared.limits import Interval
from workcell.pose import Array

if TYPE_CHECKING:
    from workcell.kernels.chain import Arm
    from workcell.kernels.structures import World


def one_joint() -> Arm:
    """An arm of one joint, for calls that only compile."""
    from workcell.kernels.chain import Arm

    return Arm(np.zeros((3, 13)), np.zeros((3, 1)))


def narrowed_arm(problem: IKProblem) -> Arm:
    """The chain of a problem, its limits (of its variables) narrowed by `max_step` around `q_reference`."""
    arm = pack_arm(problem.robot)
    if (problem.max_step is None or problem.q_reference is None) and problem.robot.coupling is None:
        return arm
    interval = Interval.of(problem).closed
    return arm._replace(bounds=joint_bounds(problem.robot, interval.lower, interval.upper))


_worlds = ByIdentity()


def pack_world(problem: IKProblem) -> World:
    """The problem's spheres and obstacles, remembered; without either, a world in which nothing collides."""
    return _worlds.get((problem,), lambda: _world(problem))


def _world(problem: IKProblem) -> World:
    from workcell.kernels.structures import World

    if problem.cover is None or not has_collisions(problem):
        return empty_world(problem.robot.joint_count)
    spheres, balls = pack_cover(problem.robot, problem.cover)
    obstacles, faces = pack_obstacles(problem.obstacles)
    margin = float(problem.tolerances.safety_margin)
    return World(spheres, balls, obstacles, faces, _pairs(problem, spheres), margin)


def empty_world(dof: int) -> World:
    """No spheres, no obstacles."""
    from workcell.kernels.structures import World

    pairs = np.zeros((0, 2), dtype=np.int64)
    return World(np.zeros((0, 6)), np.zeros((dof + 1, 6)), np.zeros((0, 19)), np.zeros((0, 13)), pairs, 0.0)


def _pairs(problem: IKProblem, spheres: Array) -> NDArray[np.int64]:
    """The problem's pairs of spheres as rows of `spheres`, which are sorted by link."""
    if problem.self_collision is None:
        return np.zeros((0, 2), dtype=np.int64)
    row = np.empty(len(spheres), dtype=np.int64)
    row[spheres[:, 4].astype(np.int64)] = np.arange(len(spheres))
    return row[problem.self_collision]


def shrunk_world(problem: IKProblem, world: World) -> World:
    """The same with the spheres of an outer cover shrunk by their overshoot: for problems with another judge."""
    if problem.cover is None or not has_collisions(problem):
        return world
    spheres, balls = pack_cover(problem.robot, problem.cover, shrunk=True)
    return world._replace(spheres=spheres, balls=balls)


def has_collisions(problem: IKProblem) -> bool:
    """Whether there are spheres in the solvers' model, and obstacles or pairs that they must keep clear of."""
    pairs = 0 if problem.self_collision is None else len(problem.self_collision)
    return problem.cover is not None and len(problem.cover) > 0 and len(problem.obstacles) + pairs > 0
