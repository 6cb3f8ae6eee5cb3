"""A quick, compiled look at whether an elementary proof of impossibility may exist: most targets have none."""

from __future__ import annotations

import functools
import importlib
from typing import Any

import numpy as np

from workcell.ik.elementary.bounds import JointAxes, PlacedSpheres
from workcell.ik.problem import IKProblem
from workcell.ik.shared.packing import empty_world, pack_world
from workcell.pose import Array

ITERATIONS = 8
"""Steps towards a tight bound on the reach."""
ROUNDING = 1e-9
"""Metres by which these numbers may differ from those of a proof."""


@functools.cache
def _kernels() -> Any:
    """The compiled kernels, imported on first use: numba takes half a second."""
    return importlib.import_module("workcell.ik.elementary.kernels")


@functools.cache
def prepare() -> None:
    """Compile what is called here, or load it from the cache."""
    kernels, world = _kernels(), empty_world(1)
    points = np.zeros((2, 3))
    kernels.stretch_chain(np.zeros(7), np.zeros((1, 3)), np.zeros((3, 2)), points, points, 0.0, 0)
    kernels.deepest_at(np.zeros(7), np.zeros((0, 3)), np.zeros(0), world.obstacles, world.faces, 0.0)


def may_be_impossible(problem: IKProblem) -> bool:
    """Whether `prove_impossible` may find a certificate; where this is False, it finds none."""
    axes, target = JointAxes.of(problem.robot), problem.target
    pose = np.concatenate([target.position, target.quat_wxyz])
    out_of_reach = _kernels().stretch_chain(
        pose, axes.offset, axes.slope, axes.first, axes.in_tool, axes.travel, ITERATIONS
    )
    return bool(out_of_reach > -ROUNDING) or _may_be_blocked(problem, pose)


def _may_be_blocked(problem: IKProblem, pose: Array) -> bool:
    if problem.cover is None or not problem.obstacles:
        return False
    placed, world = PlacedSpheres.of(problem.robot, problem.cover), pack_world(problem)
    deepest: float = _kernels().deepest_at(
        pose, placed.in_tool, placed.radius - placed.stray, world.obstacles, world.faces, world.required
    )
    return deepest > -ROUNDING
