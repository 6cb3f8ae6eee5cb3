"""Why a step of a tool path can't be made: the pose itself, the obstacles, or continuity alone."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from workcell.ik.problem import IKProblem
from workcell.ik.result import IKResult, Status
from workcell.motion.tool_paths.free_space_words import outside_at_pose, outside_at_start
from workcell.motion.tool_paths.result import FollowStatus
from workcell.motion.tool_paths.steps import Solver
from workcell.pose import Array, Pose


class StepError(Exception):
    """A step that can't be made; caught where a path is followed."""

    def __init__(self, status: FollowStatus, pose: Pose, detail: str, ik: IKResult | None = None) -> None:
        self.status, self.pose, self.detail, self.ik = status, pose, detail, ik
        super().__init__(detail)


def diagnose(solver: Solver, template: IKProblem, pose: Pose, q_before: Array, max_step: float) -> StepError:
    """Which constraint forbids to reach a pose from a configuration: the pose itself, the obstacles, or continuity.

    Where nothing is proved, spheres that lie in no cuboid of the free space are named too: at the pose, or where the
    step begins.
    """
    free = replace(template, target=pose, q_reference=None, max_step=None, max_link_rotation=None)
    alone = solver(
        replace(free, cover=None, checker=None, obstacles=(), free_space=None, grow=None, self_collision=None)
    )
    if alone.status is Status.UNREACHABLE:
        detail = f"no configuration reaches this pose (certified){_proof_of(alone)}"
        return StepError(FollowStatus.UNREACHABLE, pose, detail, alone)
    if not alone.solved:
        return StepError(
            FollowStatus.NOT_FOUND, pose, f"{alone.status.value}: {alone.status.sentence}", alone
        )
    anywhere = solver(free)
    outside = outside_at_pose(template, pose) or outside_at_start(template, q_before)
    besides = f"; {outside}" if outside else ""
    if anywhere.solved and anywhere.q is not None:
        gap = float(np.abs(anywhere.q - q_before).max())
        detail = (
            f"no configuration within {max_step:.3g} rad of the previous one; "
            f"another that reaches the pose is {gap:.3g} rad away{besides}"
        )
        return StepError(FollowStatus.STEP_TOO_LARGE, pose, detail, anywhere)
    if anywhere.status in (Status.BLOCKED, Status.BLOCKED_IN_MODEL):
        in_model = besides if anywhere.status is Status.BLOCKED_IN_MODEL else ""
        detail = f"{anywhere.status.sentence}{_proof_of(anywhere)}{in_model}"
        return StepError(FollowStatus(anywhere.status.value), pose, detail, anywhere)
    detail = f"no collision-free configuration was found ({anywhere.status.value}){besides}"
    return StepError(FollowStatus.NOT_FOUND, pose, detail, anywhere)


def _proof_of(answer: IKResult) -> str:
    """What was proved, to go behind a sentence; nothing where no certificate is at hand."""
    return "" if answer.certificate is None else f" Proved: {answer.certificate.statement}"
