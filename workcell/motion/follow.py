"""Follow a tool path with continuous joint motion (arXiv IKSPARK, section VIII), and check what lies between waypoints.

Pose by pose, the next configuration is an IK problem that carries a continuity constraint: each joint within
`max_step` of the previous configuration, each link's world rotation within `max_link_rotation` of the previous one
(Eq. 75, Frobenius norm). The section checks nothing between poses; here the tool's half-way deviation from the
straight path and the clearance along the whole joint-linear segment are checked, and the spacing refined where the
deviation is too large.
"""

from __future__ import annotations

import enum
from collections.abc import Callable, Sequence
from dataclasses import dataclass, field, replace

import numpy as np
from numpy.typing import ArrayLike

from workcell.errors import InputError
from workcell.geometry.types import SphereCover
from workcell.ik.problem import Budget, Clearance, IKProblem
from workcell.ik.result import IKResult, Status
from workcell.motion.path import Path, PathMetrics
from workcell.motion.proof import Checker, Proof, prove_path, prove_segment
from workcell.pose import Array, Pose

Solver = Callable[[IKProblem], IKResult]


class FollowStatus(enum.Enum):
    """How following a tool path ended."""

    FOLLOWED = "FOLLOWED"
    UNREACHABLE = "UNREACHABLE"
    BLOCKED = "BLOCKED"
    BLOCKED_IN_MODEL = "BLOCKED_IN_MODEL"
    STEP_TOO_LARGE = "STEP_TOO_LARGE"
    COLLISION = "COLLISION"
    OFF_PATH = "OFF_PATH"
    NOT_FOUND = "NOT_FOUND"

    @property
    def sentence(self) -> str:
        """The status in words, with its remedy."""
        return _SENTENCES[self]


_SENTENCES = {
    FollowStatus.FOLLOWED: "A continuous motion along the whole tool path was found, and is clear between waypoints too.",
    FollowStatus.UNREACHABLE: "Kinematics alone forbids a pose of the path. Move the path or the robot's base.",
    FollowStatus.BLOCKED: "Obstacles forbid a pose of the path. Move the path or the obstacle.",
    FollowStatus.BLOCKED_IN_MODEL: "No configuration of a pose of the path exists in the conservative model; "
    "the real geometry may still allow one. Use a finer sphere cover or more free-space cuboids.",
    FollowStatus.STEP_TOO_LARGE: "The poses can be reached, but not by a continuous motion from this start. "
    "Start from another configuration of the first pose, or allow larger steps.",
    FollowStatus.COLLISION: "The robot would collide between two waypoints. Start from another configuration.",
    FollowStatus.OFF_PATH: "The tool would leave the straight path between two waypoints however close they are. "
    "The arm passes a singularity: start from another configuration.",
    FollowStatus.NOT_FOUND: "No configuration was found for a pose of the path, and none was proved absent. "
    "Raise the solver's budget.",
}


_FINAL = (FollowStatus.UNREACHABLE, FollowStatus.BLOCKED, FollowStatus.BLOCKED_IN_MODEL)
"""What is true of a pose however near the one before it is."""


@dataclass(frozen=True, slots=True)
class FollowLimits:
    """What the motion must keep between waypoints.

    Attributes:
        max_step: largest joint step between waypoints (radians).
        max_link_rotation: Eq. 75's r_b on each link's world rotation (Frobenius); None leaves it out.
        deviation_m, deviation_rad: how far the tool may be from the straight path half-way between waypoints.
        clearance: metres to keep everywhere, between waypoints too.
        max_halvings: how often the distance between two given poses may be halved.
    """

    max_step: float = 0.2
    max_link_rotation: float | None = None
    deviation_m: float = 5e-4
    deviation_rad: float = np.deg2rad(0.5)
    clearance: float = 0.0
    max_halvings: int = 6

    def __post_init__(self) -> None:
        for name in ("max_step", "deviation_m", "deviation_rad"):
            if not getattr(self, name) > 0:
                raise InputError(f"{name} must be positive, not {getattr(self, name)}", where=name)
        if self.max_link_rotation is not None and not self.max_link_rotation > 0:
            raise InputError(f"max_link_rotation must be positive, not {self.max_link_rotation}")


@dataclass(frozen=True, slots=True)
class FollowFailure:
    """Where on the path, and why.

    Attributes:
        waypoint: index of the given pose that was not reached (or on the way to which the motion fails).
        fraction: share of the path's given poses that lies behind, in [0, 1].
        pose: the tool pose that failed.
        detail: what happened, in words.
        ik: the solver's last answer, if it was the solver that failed.
    """

    waypoint: int
    fraction: float
    pose: Pose
    detail: str
    ik: IKResult | None = None


@dataclass(frozen=True, slots=True)
class FollowResult:
    """What became of a tool path.

    Attributes:
        status: see `FollowStatus`.
        path: the motion, or as far as it got; None when not even the second pose was reached.
        failure: where and why it ended early; None when followed.
        metrics: of `path`.
        solved: IK problems solved on the way.
    """

    status: FollowStatus
    path: Path | None
    failure: FollowFailure | None
    metrics: PathMetrics | None
    solved: int

    @property
    def followed(self) -> bool:
        """Whether the whole path was followed."""
        return self.status is FollowStatus.FOLLOWED


def line(start: Pose, end: Pose, spacing: float = 0.02, spacing_rad: float = 0.1) -> tuple[Pose, ...]:
    """Poses on a straight line with the rotation on the shortest great arc, `start` and `end` included.

    Args:
        start, end: `T_world_tool`.
        spacing, spacing_rad: largest distance (metres) and angle (radians) between neighbours.
    """
    if not (spacing > 0 and spacing_rad > 0):
        raise InputError("the spacing of a tool path must be positive", where="spacing")
    distance, angle = start.error_to(end)
    pieces = max(int(np.ceil(distance / spacing - 1e-9)), int(np.ceil(angle / spacing_rad - 1e-9)), 1)
    inner = (start.interpolate(end, i / pieces) for i in range(1, pieces))
    return (start, *inner, end)


def follow(
    template: IKProblem,
    tool_poses: Sequence[Pose],
    q_start: ArrayLike,
    *,
    limits: FollowLimits | None = None,
    extent: SphereCover | None = None,
    solver: Solver | None = None,
) -> FollowResult:
    """Track the poses with the tool, from a configuration that already has it at the first of them.

    Args:
        template: robot, obstacles, cover, free space, checker and tolerances; target and reference are replaced.
        tool_poses: `T_world_tool`, two or more, the first being the tool's pose at `q_start`.
        q_start: (n,).
        limits: continuity, deviation and clearance to keep.
        extent: spheres in link frames that contain the moving robot (for the proof between waypoints); None: the
            template's cover. Without either, or without a checker, no clearance is checked between waypoints.
        solver: answers one IK problem; None: IKSPARK through `workcell.ik.solve.solve`.

    Raises:
        InputError: fewer than two poses, or a start that is not at the first pose.
    """
    tracker = _Tracker(template, limits or FollowLimits(), extent or template.cover, solver or step_solver())
    return tracker.run(tuple(tool_poses), np.asarray(q_start, dtype=float))


def step_solver(name: str = "ikspark", budget: Budget | None = None, seed: int = 0) -> Solver:
    """A solver of `workcell.ik.solve`, by name, for each step: its answers are verified."""
    from workcell.ik.solve import solve

    def answer(problem: IKProblem) -> IKResult:
        return solve(problem, solver=name, budget=budget or Budget(), seed=seed)

    return answer


class _StepError(Exception):
    """A step that can't be made; caught in `_Tracker.run`."""

    def __init__(self, status: FollowStatus, pose: Pose, detail: str, ik: IKResult | None = None) -> None:
        self.status, self.pose, self.detail, self.ik = status, pose, detail, ik
        super().__init__(detail)


@dataclass(slots=True)
class _Tracker:
    template: IKProblem
    limits: FollowLimits
    extent: SphereCover | None
    solver: Solver
    configurations: list[Array] = field(default_factory=list)
    poses: list[Pose] = field(default_factory=list)
    solved: int = 0

    def run(self, tool_poses: tuple[Pose, ...], q_start: Array) -> FollowResult:
        if len(tool_poses) < 2:
            raise InputError(
                f"a tool path takes two or more poses, not {len(tool_poses)}", where="tool_poses"
            )
        self._check_start(tool_poses[0], q_start)
        self.configurations, self.poses = [q_start], [tool_poses[0]]
        status, failure = FollowStatus.FOLLOWED, None
        for i, pose in enumerate(tool_poses[1:], start=1):
            try:
                self._advance(pose, self.limits.max_halvings)
            except _StepError as error:
                status = error.status
                done = (i - 1) / (len(tool_poses) - 1)
                failure = FollowFailure(i, done, error.pose, error.detail, error.ik)
                break
        path = None
        if len(self.configurations) > 1:
            path = Path(self.template.robot, np.stack(self.configurations), tuple(self.poses))
        metrics = None if path is None else path_metrics(path, self.template.checker, self.extent)
        return FollowResult(status, path, failure, metrics, self.solved)

    def _check_start(self, pose: Pose, q: Array) -> None:
        robot = self.template.robot
        robot.check_limits(q, where="q_start")
        distance, angle = robot.fk(q).error_to(pose)
        tolerances = self.template.tolerances
        if distance > 10 * tolerances.position or angle > 10 * tolerances.rotation:
            raise InputError(
                f"the tool is {1000 * distance:.2f} mm and {angle:.4f} rad away from the path's first pose",
                where="q_start",
                remedy="solve the inverse kinematics of the first pose and start there",
            )

    def _advance(self, pose: Pose, halvings: int) -> None:
        """Go to `pose` from the last configuration, by way of poses between when the step or the deviation is too big."""
        previous, q_previous = self.poses[-1], self.configurations[-1]
        result = self._solve(pose, q_previous)
        reason: _StepError | None = None
        if result.q is None or not result.solved:
            reason = self._why_no_step(pose, result)
            if reason.status in _FINAL:
                raise reason
        else:
            reason = self._check_between(previous, pose, q_previous, result.q)
        if reason is None and result.q is not None:
            self.configurations.append(np.array(result.q))
            self.poses.append(pose)
        elif halvings > 0:
            self._advance(previous.interpolate(pose, 0.5), halvings - 1)
            self._advance(pose, halvings - 1)
        elif reason is not None:
            raise reason

    def _solve(self, pose: Pose, q_previous: Array) -> IKResult:
        self.solved += 1
        step = replace(
            self.template,
            target=pose,
            q_reference=q_previous,
            max_step=self.limits.max_step,
            max_link_rotation=self.limits.max_link_rotation,
        )
        return self.solver(step)

    def _why_no_step(self, pose: Pose, result: IKResult) -> _StepError:
        """Which constraint forbids the step: the pose itself, the obstacles, or continuity."""
        free = replace(self.template, target=pose, q_reference=None, max_step=None, max_link_rotation=None)
        alone = self.solver(replace(free, cover=None, checker=None, obstacles=(), free_space=None))
        self.solved += 1
        if alone.status is Status.UNREACHABLE:
            return _StepError(
                FollowStatus.UNREACHABLE, pose, "no configuration reaches this pose (certified)", alone
            )
        if not alone.solved:
            return _StepError(
                FollowStatus.NOT_FOUND, pose, f"{alone.status.value}: {alone.status.sentence}", alone
            )
        anywhere = self.solver(free)
        self.solved += 1
        if anywhere.solved and anywhere.q is not None:
            gap = float(np.abs(anywhere.q - self.configurations[-1]).max())
            detail = (
                f"no configuration within {self.limits.max_step:.3g} rad of the previous one; "
                f"another that reaches the pose is {gap:.3g} rad away"
            )
            return _StepError(FollowStatus.STEP_TOO_LARGE, pose, detail, result)
        if anywhere.status in (Status.BLOCKED, Status.BLOCKED_IN_MODEL):
            status = FollowStatus(anywhere.status.value)
            return _StepError(status, pose, anywhere.status.sentence, anywhere)
        detail = f"no collision-free configuration was found ({anywhere.status.value})"
        return _StepError(FollowStatus.NOT_FOUND, pose, detail, anywhere)

    def _check_between(self, previous: Pose, pose: Pose, q_previous: Array, q: Array) -> _StepError | None:
        segment = Path(self.template.robot, np.stack([q_previous, q]), (previous, pose))
        metres, radians = (float(d[0]) for d in segment.tool_deviation())
        if metres > self.limits.deviation_m or radians > self.limits.deviation_rad:
            detail = (
                f"half-way to this pose the tool is {1000 * metres:.2f} mm and {radians:.4f} rad off the path"
            )
            return _StepError(FollowStatus.OFF_PATH, pose, detail)
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
        return None if proof.proved else _StepError(FollowStatus.COLLISION, pose, proof.reason)


def path_metrics(
    path: Path, checker: Checker | None, extent: SphereCover | None, floor: float = 0.0
) -> PathMetrics:
    """Measure a path: joint steps, half-way tool deviation, clearance at waypoints and (proved) between them."""
    metres, radians = path.tool_deviation()
    at_waypoints, between, spent = Clearance(float("nan")), float("nan"), 0
    if checker is not None:
        at_waypoints = min((checker(q) for q in path.configurations), key=lambda found: found.distance)
        if extent is not None:
            proof: Proof = prove_path(path, checker, extent, floor=floor)
            between, spent = proof.margin, proof.evaluations
    return PathMetrics(
        waypoints=len(path),
        largest_step=path.largest_step,
        deviation_m=float(metres.max()),
        deviation_rad=float(radians.max()),
        clearance_at_waypoints=at_waypoints,
        clearance_between=between,
        evaluations=spent,
    )
