"""A quick look, in compiled code, at whether an elementary proof of impossibility may exist: most targets have none."""

from __future__ import annotations

import functools

import numpy as np

from workcell.ik.elementary import JointAxes, PlacedSpheres
from workcell.ik.packing import empty_world, kernels, pack_world
from workcell.ik.problem import IKProblem
from workcell.pose import Array

ITERATIONS = 8
"""Steps towards a tight bound on the reach."""
ROUNDING = 1e-9
"""Metres by which these numbers may differ from those of a proof."""


@functools.cache
def prepare() -> None:
    """Compile what is called here, or load it from the cache."""
    entries, world = kernels(), empty_world(1)
    points = np.zeros((2, 3))
    entries.stretch_chain(np.zeros(7), np.zeros((1, 3)), np.zeros((3, 2)), points, points, 0.0, 0)
    entries.deepest_at(np.zeros(7), np.zeros((0, 3)), np.zeros(0), world.obstacles, world.faces, 0.0)


def may_be_impossible(problem: IKProblem) -> bool:
    """Whether `prove_impossible` may find a certificate; where this is False, it finds none."""
    axes, target = JointAxes.of(problem.robot), problem.target
    pose = np.concatenate([target.position, target.quat_wxyz])
    out_of_reach = kernels().stretch_chain(
        pose, axes.offset, axes.slope, axes.first, axes.in_tool, axes.travel, ITERATIONS
    )
    return bool(out_of_reach > -ROUNDING) or _may_be_blocked(problem, pose)


def _may_be_blocked(problem: IKProblem, pose: Array) -> bool:
    if problem.cover is None or not problem.obstacles:
        return False
    placed, world = PlacedSpheres.of(problem.robot, problem.cover), pack_world(problem)
    deepest: float = kernels().deepest_at(
        pose, placed.in_tool, placed.radius - placed.stray, world.obstacles, world.faces, world.required
    )
    return deepest > -ROUNDING
