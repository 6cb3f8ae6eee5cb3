"""Local constrained refinement of near misses: small motions that keep the pose and push every pair apart."""

from __future__ import annotations

from typing import TYPE_CHECKING

from workcell.ik.hjcd.memory import kernels
from workcell.pose import Array

if TYPE_CHECKING:
    from workcell.kernels.chain import Arm
    from workcell.kernels.structures import World

ITERATIONS = 40
"""Quadratic programs from one start."""
DEEPEST = 0.05
"""Metres of penetration of a near miss that is worth refining."""


def refine(arm: Arm, world: World, pose: Array, starts: Array, accuracy: float, out: Array) -> bool:
    """Look near one of `starts` for a configuration that reaches the target with the wanted clearance.

    Sequential quadratic programming within a trust region: the smallest joint motion onto the pose, subject to every
    pair nearer than 3 cm keeping, or regaining, its clearance (to first order) and to the joint limits. Each program is
    solved on the dual by Hildreth's method, in the null space of the pose.

    Args:
        arm, world: the problem, packed.
        pose: (7,) target: position and quaternion wxyz.
        starts: (s, n) configurations, tried in order.
        accuracy: metres of residual (a radian weighs 0.3 m) of the pose.
        out: (n,) where the configuration goes.

    Returns:
        whether one was found.
    """
    return bool(kernels().refine(arm, world, pose, ITERATIONS, accuracy, starts, out) >= 0)
