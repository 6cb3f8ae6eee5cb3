"""Why no motion leads along a tool path: the pose where it ends, and whether that alone is why, with the proof."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import dataclass, field, replace

from workcell.ik.hjcd.solver import collect_solutions
from workcell.ik.problem import Budget, IKProblem
from workcell.motion.tool_paths.graph import DeadEnd
from workcell.motion.tool_paths.planners import step_solver
from workcell.motion.tool_paths.poses import PathTolerance
from workcell.motion.tool_paths.result import FollowFailure, FollowResult, FollowStatus
from workcell.motion.tool_paths.step_errors import diagnose
from workcell.motion.tool_paths.steps import Tolerant, nearby_poses
from workcell.pose import Array, Pose

GLANCE = Budget(60.0, effort=0.03)
"""For a configuration of a pose, before a proof that there is none."""
DIAGNOSIS = Budget(60.0, effort=2.0)
"""To find out why no motion reaches a pose."""
DIAGNOSES = 3
"""Poses of one path that so much is spent on."""
PROVED = (FollowStatus.UNREACHABLE, FollowStatus.BLOCKED)
"""What is true of the real geometry, whatever was sampled."""


@dataclass(slots=True)
class Coroner:
    """Finds out why a tool path can't be followed.

    Attributes:
        problem: robot, obstacles and the clearance to keep.
        poses: of the path; tolerance: of the tool along it.
        max_step: radians.
        solver, seed: of `workcell.ik.solve`.
        found: what was found out about poses, by their rows.
    """

    problem: IKProblem
    poses: Sequence[Pose]
    tolerance: PathTolerance
    max_step: float
    solver: str = "auto"
    seed: int = 0
    found: dict[int, FollowResult] = field(default_factory=dict)

    def impossible(self, rows: Iterable[int], q_before: Array) -> FollowResult | None:
        """The first pose, of those in rows, that is proved to have no configuration; None where none is.

        The proof is about the real geometry where there is one, else about the conservative model. Proofs are about
        single poses: of a pose with a tolerance nothing is proved.
        """
        in_model: FollowResult | None = None
        for row in rows if self.tolerance.exact else ():
            if row not in self.found:
                if len(self.found) == DIAGNOSES or self._has_configuration(row):
                    continue
                self.found[row] = self.at(row, q_before)
            result = self.found[row]
            if result.status in PROVED:
                return result
            if in_model is None and result.status is FollowStatus.BLOCKED_IN_MODEL:
                in_model = result
        return in_model

    def at(self, row: int, q_before: Array, detail: str = "") -> FollowResult:
        """The path ends before a pose, the arm at `q_before` (n,); `detail`: what is known if the pose is possible."""
        poses = 1 + len(nearby_poses(self.poses[row], self.tolerance, 1.0, 1.0))
        share = DIAGNOSIS.shared(poses)
        answer = Tolerant(step_solver(self.solver, share, self.seed), self.tolerance)
        reason = diagnose(answer, self.problem, self.poses[row], q_before, self.max_step)
        status, words = reason.status, reason.detail
        if status in (FollowStatus.STEP_TOO_LARGE, FollowStatus.NOT_FOUND):
            status, words = FollowStatus.NO_CONTINUOUS_MOTION, "; ".join(filter(None, [detail, words]))
        fraction = max(row - 1, 0) / (len(self.poses) - 1)
        return FollowResult(
            status, None, FollowFailure(row, fraction, self.poses[row], words, reason.ik), None, 1
        )

    def _has_configuration(self, row: int) -> bool:
        problem = replace(self.problem, target=self.poses[row])
        return bool(collect_solutions(problem, 1, self.seed, GLANCE))


def words_of(end: DeadEnd, poses: Sequence[Pose]) -> str:
    """Where a start led along the poses, and why no further."""
    x, y, z = poses[end.waypoint].position
    return f"start {end.start}: ends before pose {end.waypoint} ({x:.3f}, {y:.3f}, {z:.3f}): {end.why}"
