"""`GoalReader`: goals as people give them, checked and written down for the kernels; and the goals' own clock."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np

from workcell.errors import InputError, UnknownNameError
from workcell.motion.live.goals import LiveGoal
from workcell.pose import Array, Pose

Goals = Pose | LiveGoal | None | Mapping[str, Pose | LiveGoal | None]
NO_GOAL = "no goal was given"


class GoalReader:
    """Writes goals down.

    Args:
        names: of the robots.
        frame: for the kernels, whose wish's rows of goals are `rows`.
        set_goal: the kernel that writes a pose.
    """

    def __init__(self, names: Sequence[str], frame: Any, rows: Array, set_goal: Any) -> None:
        self._names, self._frame, self._rows, self._set = tuple(names), frame, rows, set_goal

    def read(self, goals: Goals) -> str:
        """Why there is no goal, or an empty text.

        Raises:
            InputError: goals that are none; UnknownNameError: a robot that is not there.
        """
        if isinstance(goals, (Pose, LiveGoal)):
            if len(self._names) > 1:
                raise InputError(
                    "one goal for several robots", where="goals", remedy="a goal by robot's name"
                )
            return "" if self._write(0, goals) else NO_GOAL
        if goals is None:
            self.forget()
            return NO_GOAL
        if not isinstance(goals, Mapping):
            raise InputError(f"{type(goals).__name__} is no goal", where="goals", remedy="a Pose or LiveGoal")
        self._check(goals)
        written = False
        for t, name in enumerate(self._names):
            written = self._write(t, goals.get(name)) or written
        return "" if written else NO_GOAL

    def forget(self) -> None:
        """There is no goal."""
        self._rows[:, 25] = 0.0

    def _check(self, goals: Mapping[str, Pose | LiveGoal | None]) -> None:
        for name, goal in goals.items():
            if name not in self._names:
                raise UnknownNameError("robot", name, self._names, where="goals")
            if goal is not None and not isinstance(goal, (Pose, LiveGoal)):
                raise InputError(
                    f"{type(goal).__name__} is no goal", where=f"goals[{name!r}]", remedy="a Pose or LiveGoal"
                )

    def _write(self, t: int, goal: Pose | LiveGoal | None) -> bool:
        if goal is None:
            self._rows[t, 25] = 0.0
            return False
        if isinstance(goal, Pose):
            self._set(self._frame, t, goal.position, goal.quat_wxyz, 1.0)
            return True
        self._set(self._frame, t, goal.pose.position, goal.pose.quat_wxyz, float(goal.weight))
        row = self._rows[t]
        row[13:16], row[19:22] = goal.position_band.T
        row[16:19], row[22:25] = goal.rotation_band.T
        return goal.weight > 0.0


class GoalClock:
    """The goals' own clock.

    Args:
        period: seconds of a tick; stale_s: seconds without news after which a goal no longer counts.
    """

    def __init__(self, period: float, stale_s: float) -> None:
        self._period, self._stale = period, stale_s
        self.reset()

    def reset(self) -> None:
        """Nothing was heard yet."""
        self._stamp: float | None = None
        self._unheard = 0.0

    @property
    def heard(self) -> bool:
        """Whether the last goal had a stamp."""
        return self._stamp is not None or self._unheard > 0.0

    def read(self, stamp: float | None) -> str:
        """Why a goal with this stamp, seconds, doesn't count, or an empty text; None: the goal has no clock."""
        if stamp is None:
            self.reset()
            return ""
        if not np.isfinite(stamp):
            self._unheard += self._period
            return f"the goal's clock says {stamp}"
        if self._stamp is None or stamp > self._stamp:
            self._stamp, self._unheard = float(stamp), 0.0
            return ""
        self._unheard += self._period
        if stamp < self._stamp:
            return f"the goal's clock runs backwards, from {self._stamp:.6g} to {stamp:.6g} s"
        return f"no new goal for {self._unheard:.3g} s" if self._unheard > self._stale else ""
