"""What following a tool path takes and gives: limits on the motion, and how, where and why it ended."""

from __future__ import annotations

import enum
from collections import Counter
from collections.abc import Iterable, Mapping
from dataclasses import dataclass, field
from types import MappingProxyType

import numpy as np

from workcell.errors import InputError
from workcell.ik.registry import is_planned_by
from workcell.ik.result import IKResult, Status
from workcell.motion.path import Path, PathMetrics
from workcell.pose import Pose


class FollowStatus(enum.Enum):
    """How following a tool path ended."""

    FOLLOWED = "FOLLOWED"
    UNREACHABLE = "UNREACHABLE"
    BLOCKED = "BLOCKED"
    BLOCKED_IN_MODEL = "BLOCKED_IN_MODEL"
    STEP_TOO_LARGE = "STEP_TOO_LARGE"
    COLLISION = "COLLISION"
    OFF_PATH = "OFF_PATH"
    NO_CONTINUOUS_MOTION = "NO_CONTINUOUS_MOTION"
    NOT_FOUND = "NOT_FOUND"

    @property
    def sentence(self) -> str:
        """The status in words, with its remedy."""
        return _SENTENCES[self]


_SENTENCES = {
    FollowStatus.FOLLOWED: "A continuous motion along the whole tool path was found; "
    "what its configurations were checked for holds between them too.",
    FollowStatus.UNREACHABLE: "Kinematics alone forbids a pose of the path. Move the path or the robot's base.",
    FollowStatus.BLOCKED: "Obstacles forbid a pose of the path. Move the path or the obstacle.",
    FollowStatus.BLOCKED_IN_MODEL: "No configuration of a pose of the path exists in the conservative model; "
    "the real geometry may still allow one. Use a finer sphere cover or more free-space cuboids.",
    FollowStatus.STEP_TOO_LARGE: "The poses can be reached, but not by a continuous motion from this start. "
    "Start from another configuration of the first pose, or allow larger steps.",
    FollowStatus.COLLISION: "The robot would collide between two waypoints. Start from another configuration.",
    FollowStatus.OFF_PATH: "The tool would leave the straight path between two waypoints however close they are. "
    "The arm passes a singularity: start from another configuration.",
    FollowStatus.NO_CONTINUOUS_MOTION: "Every pose looked at can be reached, but no continuous motion through all of "
    "them exists in the graph of sampled configurations. Move the path, widen its tolerance, or sample more.",
    FollowStatus.NOT_FOUND: "No configuration was found for a pose of the path, and none was proved absent. "
    "Raise the solver's budget.",
}


@dataclass(frozen=True, slots=True)
class FollowLimits:
    """What the motion must keep between waypoints.

    Attributes:
        max_step: largest joint step between waypoints (radians).
        max_link_rotation: r_b in Eq. 75 of IKSPARK, a bound on the change of each link's world rotation
            (Frobenius); None leaves it out.
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
        if not np.isfinite(self.clearance):
            raise InputError(f"a clearance of {self.clearance} m can't be kept", where="clearance")
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

    @property
    def words(self) -> str:
        """Where and why, for a message."""
        x, y, z = self.pose.position
        return f"at pose {self.waypoint} ({x:.3f}, {y:.3f}, {z:.3f}), {self.fraction:.0%} of the way: {self.detail}"


@dataclass(frozen=True, slots=True)
class Answered:
    """Whose answers a path is made of, and how they were found.

    Attributes:
        by: how many configurations are each solver's (`IKResult.solver`); local steps are "local"'s.
        in_cuboids: how many of them were found among free-space cuboids.
    """

    by: Mapping[str, int] = field(default_factory=dict)
    in_cuboids: int = 0

    def __post_init__(self) -> None:
        object.__setattr__(self, "by", MappingProxyType(dict(self.by)))

    @staticmethod
    def of(results: Iterable[IKResult]) -> Answered:
        """Of some answers with a configuration."""
        kept = tuple(results)
        by = Counter(result.solver for result in kept)
        return Answered(dict(sorted(by.items())), sum(result.cuboids is not None for result in kept))

    def __add__(self, other: Answered) -> Answered:
        both = Counter(self.by) + Counter(other.by)
        return Answered(dict(sorted(both.items())), self.in_cuboids + other.in_cuboids)

    @property
    def count(self) -> int:
        """How many configurations."""
        return sum(self.by.values())

    def by_planner(self, planner: str) -> int:
        """How many of them are a planner's own."""
        return sum(count for solver, count in self.by.items() if is_planned_by(planner, solver))

    @property
    def words(self) -> str:
        """Who, and how many."""
        local = {1: "1 local step"}
        who = ", ".join(
            local.get(count, f"{count} local steps") if solver == "local" else f"{count} by {solver}"
            for solver, count in self.by.items()
        )
        return f"{who} ({self.in_cuboids} in cuboids)" if self.in_cuboids else who


@dataclass(frozen=True, slots=True)
class FollowResult:
    """What became of a tool path.

    Attributes:
        status: see `FollowStatus`.
        path: the motion, or as far as it got; None when not even the second pose was reached.
        failure: where and why it ended early; None when followed.
        metrics: of `path`.
        solved: IK problems solved on the way.
        answered: who answered the configurations of `path` behind its first.
        tried: where the choice among starts led, in words: one line for each that was not taken.
    """

    status: FollowStatus
    path: Path | None
    failure: FollowFailure | None
    metrics: PathMetrics | None
    solved: int
    answered: Answered = field(default_factory=Answered)
    tried: tuple[str, ...] = ()

    @property
    def fraction(self) -> float:
        """The share of the path's given poses that was followed."""
        return 1.0 if self.failure is None else self.failure.fraction

    @property
    def followed(self) -> bool:
        """Whether the whole path was followed."""
        return self.status is FollowStatus.FOLLOWED


def without_start(pose: Pose, answer: IKResult) -> FollowResult:
    """No configuration of the path's first pose is known: the solver's last answer about it says why."""
    status = {
        Status.UNREACHABLE: FollowStatus.UNREACHABLE,
        Status.BLOCKED: FollowStatus.BLOCKED,
        Status.BLOCKED_IN_MODEL: FollowStatus.BLOCKED_IN_MODEL,
    }.get(answer.status, FollowStatus.NOT_FOUND)
    return FollowResult(status, None, FollowFailure(0, 0.0, pose, answer.status.sentence, answer), None, 1)


def not_begun(pose: Pose) -> FollowResult:
    """Motions along the path are known, and the robot gets to the start of none of them; `pose` is the first."""
    detail = (
        "no way was found from where the robot stands to a configuration from which the path can be followed"
    )
    return FollowResult(FollowStatus.NOT_FOUND, None, FollowFailure(0, 0.0, pose, detail), None, 0)
