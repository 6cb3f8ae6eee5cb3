"""Where a tool path leaves the free space that a planner is given: which spheres, in words, with the remedy."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from workcell.geometry.free_space.cuboids import holds_spheres
from workcell.ik.judge.verify import sphere_name
from workcell.ik.problem import IKProblem
from workcell.pose import Array, Pose

REMEDY = (
    "take a finer sphere cover, or leave what the hand has to come close to out of the obstacles (close_to)"
)
_NAMED = 2
"""Spheres of one configuration that are named."""


def outside_at_start(problem: IKProblem, q: Array) -> str:
    """Which moving spheres are in no region at a configuration (n,) from which a step begins; empty: none."""
    if problem.cover is None:
        return ""
    transforms = problem.robot.link_transforms(q)
    outside = np.flatnonzero(_outside(problem, transforms) & (problem.cover.link > 0))
    return _words(problem, outside, "where the step begins")


def outside_at_pose(problem: IKProblem, pose: Pose) -> str:
    """Which spheres of the last link, which the pose itself places, are in no region there; empty: none."""
    if problem.cover is None:
        return ""
    last = problem.robot.joint_count
    transforms = np.tile(np.eye(4), (last + 1, 1, 1))
    transforms[last] = (pose @ problem.robot.tool().T_link_tool.inverse()).matrix
    outside = np.flatnonzero(_outside(problem, transforms) & (problem.cover.link == last))
    return _words(problem, outside, "at this pose")


def _outside(problem: IKProblem, transforms: Array) -> NDArray[np.bool_]:
    """(m,) whether each sphere lies in neither a cuboid nor a polytope, its link as placed (links, 4, 4)."""
    cover = problem.cover
    space = problem.free_space if problem.grow is None else problem.grow(np.zeros((0, 3)))
    assert cover is not None
    if space is None or not problem.obstacles:
        return np.zeros(len(cover), dtype=np.bool_)
    centres = cover.centres_world(transforms)
    inside: NDArray[np.bool_] = np.asarray(holds_spheres(space, centres, cover.radius).any(axis=-1))
    for polytope in space.polytopes:
        inside = inside | polytope.holds_spheres(centres, cover.radius)
    return ~inside


def _words(problem: IKProblem, outside: NDArray[np.int64], where: str) -> str:
    if not len(outside):
        return ""
    names = " and ".join(sphere_name(problem, int(sphere)) for sphere in outside[:_NAMED])
    more = f" and {len(outside) - _NAMED} more" if len(outside) > _NAMED else ""
    lies = "lies" if len(outside) == 1 else "lie"
    return f"{names}{more} {lies} in no cuboid of the free space {where}: {REMEDY}"
