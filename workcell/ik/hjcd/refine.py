"""Local constrained refinement of near misses: small motions that keep the pose and push every pair apart."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import ArrayLike

from workcell.ik.hjcd.memory import kernels
from workcell.ik.problem import IKProblem
from workcell.ik.shared.packing import narrowed_arm, pack_world
from workcell.pose import Array

if TYPE_CHECKING:
    from workcell.kernels.chain import Arm
    from workcell.kernels.structures import World

ITERATIONS = 40
"""Quadratic programs from one start."""
DEEPEST = 0.05
"""Metres of penetration of a near miss that is worth refining."""


def refine(problem: IKProblem, starts: ArrayLike, accuracy: float = 1e-8) -> Array | None:
    """A configuration near one of `starts` that reaches the target with the wanted clearance, or None.

    Sequential quadratic programming within a trust region: the smallest joint motion onto the pose, subject to every
    pair nearer than 3 cm keeping, or regaining, its clearance (to first order) and to the joint limits. Each program is
    solved on the dual by Hildreth's method, in the null space of the pose.

    Args:
        problem: its cover and obstacles are the collision model; a `checker` is not asked.
        starts: (s, n) configurations, or one (n,); tried in order.
        accuracy: metres of residual (a radian weighs 0.3 m) of the pose.
    """
    rows = np.array(np.atleast_2d(np.asarray(starts, dtype=float)))
    for row in rows:
        problem.robot.configuration(row, where="starts")
    out = np.empty(problem.robot.dof)
    arm, world, target = narrowed_arm(problem), pack_world(problem), problem.target
    rows = np.clip(rows, arm.bounds[0], arm.bounds[1])
    pose = np.concatenate([target.position, target.quat_wxyz])
    return out if refine_packed(arm, world, pose, rows, accuracy, out) else None


def refine_packed(arm: Arm, world: World, pose: Array, starts: Array, accuracy: float, out: Array) -> bool:
    """The same for a packed problem, into out (n,); whether it was found."""
    return bool(kernels().refine(arm, world, pose, ITERATIONS, accuracy, starts, out) >= 0)
