"""Steps of a tool path: local ones first, the convex solver where they fail.

Beside them solvers of poses for paths with a tolerance (`Tolerant`).
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace

import numpy as np

from workcell import clock
from workcell.ik.judge.verify import Verifier
from workcell.ik.observing import report
from workcell.ik.problem import IKProblem
from workcell.ik.result import IKResult, Status
from workcell.ik.stages import SolverStage
from workcell.motion.tool_paths.poses import PathTolerance
from workcell.motion.tool_paths.tracker import Aside, LocalTracker
from workcell.pose import Array, Pose

Solver = Callable[[IKProblem], IKResult]
TOO_FAR = "a link would turn further than it may in one step"
"""Why a local step is not taken although it reaches its pose: half of it will do."""


class LocalSolver:
    """Answers a step of a tool path: local tracking from `q_reference`, and `rescue` where that leads nowhere.

    Args:
        template: as of `LocalTracker`.
        tolerance: of the tool; its solutions count for the nearest pose that it allows.
        rescue: another solver, or None.
        clearance, aside: as of `LocalTracker`.

    Attributes:
        local, rescued: steps answered by each.
    """

    def __init__(
        self,
        template: IKProblem,
        tolerance: PathTolerance | None = None,
        *,
        max_step: Array | float = 0.2,
        rescue: Solver | None = None,
        clearance: float = 0.0,
        aside: Aside | None = None,
    ) -> None:
        self.tolerance = tolerance or PathTolerance()
        self.tracker = LocalTracker(
            template, self.tolerance, max_step=max_step, clearance=clearance, aside=aside
        )
        self._rescue = None if rescue is None else Tolerant(rescue, self.tolerance)
        self.local, self.rescued = 0, 0

    def __call__(self, problem: IKProblem, proposed: Array | None = None) -> IKResult:
        """A verified configuration within `max_step` of the reference, or what the rescue says.

        Args:
            problem: the step.
            proposed: (n,) a configuration for it that is looked at before anything is solved; None: there is none.
        """
        from workcell.jit import compile_seconds

        begun, compiled = clock.cpu_seconds(), compile_seconds()
        reference = problem.q_reference
        name = "proposed step"
        result = None if proposed is None else accepted(problem, proposed, self.tolerance)
        if result is None and reference is not None and problem.cover is self.tracker.template.cover:
            name = "local step"
            tracked = self.tracker.track_anyhow([problem.target], reference)
            if tracked.complete:
                result = accepted(problem, tracked.configurations[0], self.tolerance)
                if result is None and turns_too_far(problem, tracked.configurations[0]):
                    return IKResult(Status.NOT_FOUND, "local", rejected=(TOO_FAR,))
        if result is not None:
            self.local += 1
            spent = clock.cpu_seconds() - begun
            if compile_seconds() > compiled:
                name = f"{name}, with compiling"
            stage = SolverStage(name, spent, note="accepted", solver="local")
            result = replace(result, stats={"cpu_s": spent}, stages=(stage,))
            report(problem, result)
            return result
        if self._rescue is None:
            return IKResult(Status.NOT_FOUND, "local")
        self.rescued += 1
        return self._rescue(problem)


def accepted(problem: IKProblem, q: Array, tolerance: PathTolerance) -> IKResult | None:
    """The result for `q` (n,), judged at the nearest pose that the tolerance allows; None where it is refused."""
    pose = tolerance.allowed(problem.target, problem.robot, q)
    verdict = Verifier(problem if pose is problem.target else replace(problem, target=pose))(q)
    if not verdict.accepted:
        return None
    return IKResult(
        Status.SOLVED,
        "local",
        q=q,
        position_error=verdict.position_error,
        rotation_error=verdict.rotation_error,
        clearance=verdict.clearance,
    )


def turns_too_far(problem: IKProblem, q: Array) -> bool:
    """Whether a link turns further from the reference to q (n,) than `max_link_rotation` (Eq. 75)."""
    if problem.max_link_rotation is None or problem.q_reference is None:
        return False
    before, after = problem.robot.link_transforms(np.stack([problem.q_reference, q]))[..., :3, :3]
    return bool(np.linalg.norm(after - before, axis=(-2, -1)).max() > problem.max_link_rotation)


class Tolerant:
    """A solver of whole poses, for paths with a tolerance: it is asked for allowed poses, the likeliest first.

    These are that of a proposed configuration, the pose as far from the path as the tool was before, the path's own,
    and some more in the box.
    """

    def __init__(self, solver: Solver, tolerance: PathTolerance) -> None:
        self._solver, self._tolerance = solver, tolerance

    def __call__(self, problem: IKProblem, proposed: Array | None = None) -> IKResult:
        """The first answer with a configuration; NOT_FOUND where none of the poses asked for has one.

        Args:
            problem: its target is the pose of the path.
            proposed: (n,) a configuration whose own allowed pose is the likeliest; None: there is none.
        """
        if self._tolerance.exact:
            return self._solver(problem)
        likely = [q for q in (proposed, problem.q_reference) if q is not None]
        poses = [self._tolerance.allowed(problem.target, problem.robot, q) for q in likely]
        poses.append(problem.target)
        poses += nearby_poses(poses[0], self._tolerance, angle=0.6, distance=0.05)
        result = None
        for pose in poses:
            answer = self._solver(replace(problem, target=pose))
            if answer.solved:
                return answer
            # that one pose of the box is impossible proves nothing about the others
            result = (
                replace(answer, status=Status.NOT_FOUND, certificate=None)
                if answer.status.is_proof
                else answer
            )
        assert result is not None
        return result


Steps = LocalSolver | Tolerant
"""What answers the steps of a tool path, and knows the path's tolerance."""


def nearby_poses(pose: Pose, tolerance: PathTolerance, angle: float, distance: float) -> list[Pose]:
    """Poses turned and moved from `pose` along each axis with a tolerance, by half and all of it.

    Args:
        angle, distance: the most that one is turned (radians) and moved (metres).
    """
    poses = []
    for axis, bound in enumerate(tolerance.box):
        if bound > 0:
            for share in (0.5, -0.5, 1.0, -1.0):
                x = np.zeros(6)
                x[axis] = share * min(float(bound), angle if axis >= 3 else distance)
                poses.append(tolerance.moved(pose, x))
    return poses


def starting_poses(pose: Pose, tolerance: PathTolerance) -> list[Pose]:
    """The pose itself and, where the tool may turn far about an axis, quarter and half turns about it."""
    poses = [pose]
    for axis, bound in enumerate(tolerance.box[3:], start=3):
        for turn in (0.5 * np.pi, -0.5 * np.pi, np.pi):
            if bound >= abs(turn):
                x = np.zeros(6)
                x[axis] = turn
                poses.append(tolerance.moved(pose, x))
    return poses
