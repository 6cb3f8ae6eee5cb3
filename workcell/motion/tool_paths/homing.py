"""Follow a tool path to a configuration that is known: what the poses leave free drifts there."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from workcell.ik.problem import IKProblem
from workcell.motion.path import Path
from workcell.motion.proofs.on_model import prove_segment
from workcell.motion.tool_paths.follow import follow
from workcell.motion.tool_paths.result import FollowFailure, FollowLimits, FollowResult, FollowStatus
from workcell.motion.tool_paths.steps import Steps
from workcell.pose import Array, Pose

_THERE = 1e-3
"""Radians (or metres) from which on the known configuration takes the last one's place."""


def follow_to(
    template: IKProblem,
    tool_poses: Sequence[Pose],
    q_from: Array,
    q_to: Array,
    limits: FollowLimits,
    steps: Steps,
) -> FollowResult:
    """Track the poses by a convex planner's steps and end in `q_to` (n,), which has the tool at the last of them.

    Args:
        template, tool_poses, limits: as of `follow`.
        q_from: (n,) where the tool is at the first pose.
        q_to: (n,) where to end.
        steps: of a convex planner: they head for `q_to` as far as the poses leave them free.

    Returns:
        as `follow`; the status is STEP_TOO_LARGE where the motion comes out in another posture.
    """
    result = follow(template, tool_poses, q_from, limits=limits, solver=steps, towards=q_to)
    if result.path is None or not result.followed:
        return result
    gap = float(np.abs(result.path.end - q_to).max())
    if gap <= _THERE and _closes(template, result.path, q_to, limits):
        configurations = np.vstack([result.path.configurations[:-1], q_to])
        return replace(result, path=Path(template.robot, configurations, result.path.tool_poses))
    detail = f"the motion comes out {gap:.2g} rad away from the configuration that it was to end in"
    failure = FollowFailure(len(tool_poses) - 1, 1.0, tool_poses[-1], detail)
    return replace(result, status=FollowStatus.STEP_TOO_LARGE, failure=failure)


def _closes(template: IKProblem, path: Path, q_to: Array, limits: FollowLimits) -> bool:
    """Whether the last segment keeps all limits when it ends in `q_to`."""
    robot, before = template.robot, path.configurations[-2]
    last = Path(robot, np.stack([before, q_to]))
    middle = path.tool_poses[-2].interpolate(path.tool_poses[-1], 0.5)
    metres, radians = middle.error_to(robot.fk(0.5 * (before + q_to)))
    turned = limits.max_link_rotation is None or last.largest_link_rotation <= limits.max_link_rotation
    if last.largest_step > limits.max_step or not turned:
        return False
    if metres > limits.deviation_m or radians > limits.deviation_rad:
        return False
    if template.checker is None or template.cover is None:
        return True
    return prove_segment(robot, before, q_to, template.checker, template.cover, floor=limits.clearance).proved
