"""What a simulation asks of live inverse kinematics; `LiveIK` is one."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from typing import Protocol, TypeAlias

from workcell.motion.live.goals import LiveGoal
from workcell.motion.live.limits import LiveLimits
from workcell.motion.live.step import Step
from workcell.motion.live.stream import Stamped
from workcell.pose import Array, Pose

OneGoal: TypeAlias = Pose | LiveGoal | None
Goals: TypeAlias = OneGoal | Mapping[str, Pose | LiveGoal | None]
"""A goal of the only robot's tool, or one for each named robot's."""
GoalSource: TypeAlias = Callable[[float], Goals | Stamped]
"""What is to be gone to, seconds after the order was given."""


class LiveSolver(Protocol):
    """A step for every control tick."""

    @property
    def names(self) -> tuple[str, ...]:
        """The robots, in the order of joints and tools."""
        ...

    @property
    def moving(self) -> tuple[str, ...]:
        """Bodies and objects of the scene that move, and are told of by `place`."""
        ...

    @property
    def period(self) -> float:
        """Seconds of a tick."""
        ...

    @property
    def limits(self) -> LiveLimits:
        """Of all joints."""
        ...

    @property
    def qd(self) -> Array:
        """(n,) velocities at the end of the last tick."""
        ...

    @property
    def qdd(self) -> Array:
        """(n,) accelerations then."""
        ...

    def columns(self, robot_name: str) -> slice:
        """Where a robot's joints stand among all."""
        ...

    def reset(self, q: Array) -> None:
        """At rest at joints (n,)."""
        ...

    def place(
        self, name: str, pose: Pose, velocity: Array | None = None, angular_velocity: Array | None = None
    ) -> None:
        """Where something that moves is now, and how fast (world, metres and radians a second)."""
        ...

    def step(self, goals: Goals, *, stamp: float | None = None) -> Step:
        """One tick."""
        ...
