"""Follow a tool path with continuous joint motion, and check what lies between waypoints.

After section VIII of IKSPARK (see `workcell.ik.ikspark.solver`).

Pose by pose, the next configuration is an IK problem that carries a continuity constraint: each joint within
`max_step` of the previous configuration, each link's world rotation within `max_link_rotation` of the previous one
(Eq. 75, Frobenius norm). The section checks nothing between poses; here the tool's half-way deviation from the
straight path and the clearance along the whole joint-linear segment are checked, and the spacing refined where the
deviation is too large.

Who answers the steps is the choice of `workcell.motion.tool_paths.planners`, from which configuration to start that of
`workcell.motion.tool_paths.route`.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field, replace
from functools import partial
from itertools import starmap, zip_longest

import numpy as np
from numpy.typing import ArrayLike

from workcell.errors import InputError
from workcell.geometry.types import SphereCover
from workcell.ik.problem import Clearance, IKProblem
from workcell.ik.result import IKResult
from workcell.motion.path import Path
from workcell.motion.proofs.on_model import Proof, prove_segment
from workcell.motion.quality import measured, smallest
from workcell.motion.tool_paths.planners import local_solver, step_solver, steps_of
from workcell.motion.tool_paths.poses import PathTolerance, check_tool_path, line
from workcell.motion.tool_paths.result import (
    Answered,
    FollowFailure,
    FollowLimits,
    FollowResult,
    FollowStatus,
)
from workcell.motion.tool_paths.step_errors import StepError, diagnose
from workcell.motion.tool_paths.steps import TOO_FAR, LocalSolver, Solver, Steps, Tolerant
from workcell.pose import Array, Pose

__all__ = [
    "FollowFailure",
    "FollowLimits",
    "FollowResult",
    "FollowStatus",
    "PathTolerance",
    "Solver",
    "diagnose",
    "follow",
    "line",
    "local_solver",
    "step_solver",
    "steps_of",
]

DRIFT = 0.25
"""The share of the largest step by which a configuration is let drift beside what the poses ask for."""
SETTLED = 1e-4
"""Radians (or metres) from a known configuration at which the drift has come there."""
SETTLING = 0.98
"""The share of the distance to it that a step at the last pose leaves, at most, where another one follows."""
_FINAL = (FollowStatus.UNREACHABLE, FollowStatus.BLOCKED, FollowStatus.BLOCKED_IN_MODEL)
"""What is true of a pose however near the one before it is."""


def follow(
    template: IKProblem,
    tool_poses: Sequence[Pose],
    q_start: ArrayLike,
    *,
    tolerance: PathTolerance | None = None,
    limits: FollowLimits | None = None,
    extent: SphereCover | None = None,
    solver: Solver | None = None,
    proposed: Array | None = None,
    towards: Array | None = None,
) -> FollowResult:
    """Track the poses with the tool, from a configuration that already has it at the first of them.

    Args:
        template: robot, obstacles, cover, free space, checker and tolerances; target and reference are replaced.
        tool_poses: `T_world_tool`, two or more, the first being the tool's pose at `q_start` (to the tolerance).
        q_start: (n,).
        tolerance: how far the tool may be from the poses, axis by axis; None: they are asked for exactly.
        limits: continuity, deviation and clearance to keep.
        extent: spheres in link frames that contain the moving robot (for the proof between waypoints); None: the
            template's cover. Without either, or without a checker, no clearance is checked between waypoints.
        solver: answers one IK problem; None: IKSPARK through `workcell.ik.solve.solve`. See also `steps_of`.
        proposed: (k, n) configurations that may do for the first k poses; None: there are none.
        towards: (n,) what the configurations drift to, as far as the poses leave them free and `DRIFT` lets them, and
            go on drifting to at the last pose, when the steps are a convex solver's; None: they stay near to those
            before them.

    Raises:
        InputError: fewer than two poses, or a start that is not at the first pose.
    """
    allowed = tolerance or PathTolerance()
    answer = solver or step_solver()
    if not isinstance(answer, LocalSolver | Tolerant):
        answer = Tolerant(answer, allowed)
    poses = check_tool_path(tool_poses)
    waypoints = zip_longest(poses, () if proposed is None else proposed[: len(poses)])
    tracker = _Tracker(template, limits or FollowLimits(), extent or template.cover, answer, allowed, towards)
    return tracker.run(list(starmap(_Waypoint, waypoints)), np.asarray(q_start, dtype=float))


def check_start(template: IKProblem, tolerance: PathTolerance, pose: Pose, q: Array) -> None:
    """Raise InputError unless q (n,) is within the limits and has the tool at the path's first pose."""
    template.robot.check_limits(q, where="q_start")
    distance, angle = tolerance.excess(pose, template.robot.fk(q))
    if distance > 10 * template.tolerances.position or angle > 10 * template.tolerances.rotation:
        raise InputError(
            f"the tool is {1000 * distance:.2f} mm and {angle:.4f} rad away from the path's first pose",
            where="q_start",
            remedy="solve the inverse kinematics of the first pose and start there",
        )


@dataclass(frozen=True, slots=True)
class _Waypoint:
    """A pose of the path, and a configuration (n,) that may do for it."""

    pose: Pose
    proposed: Array | None = None


@dataclass(slots=True)
class _Tracker:
    template: IKProblem
    limits: FollowLimits
    extent: SphereCover | None
    solver: Steps
    tolerance: PathTolerance
    towards: Array | None = None
    configurations: list[Array] = field(default_factory=list)
    poses: list[Pose] = field(default_factory=list)
    reached: list[Pose] = field(default_factory=list)
    clearances: list[Clearance] = field(default_factory=list)
    proofs: list[Proof] = field(default_factory=list)
    answers: list[IKResult] = field(default_factory=list)
    solved: int = 0

    def run(self, waypoints: list[_Waypoint], q_start: Array) -> FollowResult:
        check_start(self.template, self.tolerance, waypoints[0].pose, q_start)
        checker = self.template.checker
        self._append(
            waypoints[0].pose, q_start, Clearance(float("nan")) if checker is None else checker(q_start)
        )
        status, failure = FollowStatus.FOLLOWED, None
        for i, waypoint in enumerate(waypoints[1:], start=1):
            try:
                self._advance(waypoint, self.limits.max_halvings)
                if i == len(waypoints) - 1:
                    self._settle(waypoint.pose)
            except StepError as error:
                status = error.status
                done = (i - 1) / (len(waypoints) - 1)
                failure = FollowFailure(i, done, error.pose, error.detail, error.ik)
                break
        if len(self.configurations) < 2:
            return FollowResult(status, None, failure, None, self.solved)
        path = Path(self.template.robot, np.stack(self.configurations), tuple(self.reached))
        between = min((proof.margin for proof in self.proofs), default=float("nan"))
        evaluations = sum(proof.evaluations for proof in self.proofs)
        metrics = measured(path, smallest(self.clearances), between, evaluations)
        return FollowResult(status, path, failure, metrics, self.solved, Answered.of(self.answers))

    def _append(self, pose: Pose, q: Array, clearance: Clearance) -> None:
        """A waypoint: the pose of the path, the allowed one where the tool is, and the clearance."""
        self.clearances.append(clearance)
        self.configurations.append(np.array(q))
        self.poses.append(pose)
        self.reached.append(self.tolerance.allowed(pose, self.template.robot, q))

    def _advance(self, waypoint: _Waypoint, halvings: int) -> None:
        """Go on from the last configuration, by way of poses between when the step or the deviation is too big."""
        pose, previous, q_previous = waypoint.pose, self.poses[-1], self.configurations[-1]
        result = self._solve(waypoint, q_previous)
        reason: StepError | None = None
        if result.q is None or not result.solved:
            reason = self._why_no_step(waypoint, q_previous, halvings, TOO_FAR in result.rejected)
            if reason.status in _FINAL:
                raise reason
        else:
            reason = self._check_between(previous, pose, q_previous, result.q)
        if reason is None and result.q is not None:
            self._append(pose, result.q, result.clearance)
            self.answers.append(result)
        elif halvings > 0:
            self._advance(_Waypoint(previous.interpolate(pose, 0.5)), halvings - 1)
            self._advance(waypoint, halvings - 1)
        elif reason is not None:
            raise reason

    def _settle(self, pose: Pose) -> None:
        """At the last pose, go on to the known configuration, for as long as that gets nearer by as much as it may."""
        if self.towards is None:
            return
        left = float(np.abs(self.configurations[-1] - self.towards).max())
        while left > SETTLED:
            self._advance(_Waypoint(pose), 0)
            before, left = left, float(np.abs(self.configurations[-1] - self.towards).max())
            if left > SETTLING * before:
                return

    def _why_no_step(self, waypoint: _Waypoint, q_previous: Array, halvings: int, too_far: bool) -> StepError:
        """Why a pose was not reached: asked once for a given pose, and where the distance can't be halved further."""
        pose = waypoint.pose
        if halvings > 0 and (too_far or halvings < self.limits.max_halvings):
            return StepError(FollowStatus.STEP_TOO_LARGE, pose, "no configuration within the largest step")
        self.solved += 2
        solver = partial(self.solver, proposed=waypoint.proposed)
        return diagnose(solver, self.template, pose, q_previous, self.limits.max_step)

    def _solve(self, waypoint: _Waypoint, q_previous: Array) -> IKResult:
        self.solved += 1
        step = replace(
            self.template,
            target=waypoint.pose,
            q_reference=q_previous,
            max_step=self.limits.max_step,
            max_link_rotation=self.limits.max_link_rotation,
        )
        if self.towards is not None:
            far = DRIFT * self.limits.max_step
            step = replace(step, q_towards=q_previous + np.clip(self.towards - q_previous, -far, far))
        result = self.solver(step, waypoint.proposed)
        if result.free_space is not None and step.grow is not None:
            # what this step had to add, the next ones begin with
            self.template = replace(self.template, free_space=result.free_space)
        return result

    def _check_between(self, previous: Pose, pose: Pose, q_previous: Array, q: Array) -> StepError | None:
        half = self.template.robot.fk(0.5 * (q_previous + q))
        metres, radians = self.tolerance.excess(previous.interpolate(pose, 0.5), half)
        if metres > self.limits.deviation_m or radians > self.limits.deviation_rad:
            detail = (
                f"half-way to this pose the tool is {1000 * metres:.2f} mm and {radians:.4f} rad off the path"
            )
            return StepError(FollowStatus.OFF_PATH, pose, detail)
        if self.template.checker is None or self.extent is None:
            return None
        proof = prove_segment(
            self.template.robot,
            q_previous,
            q,
            self.template.checker,
            self.extent,
            floor=self.limits.clearance,
        )
        if not proof.proved:
            return StepError(FollowStatus.COLLISION, pose, proof.reason)
        self.proofs.append(proof)
        return None
