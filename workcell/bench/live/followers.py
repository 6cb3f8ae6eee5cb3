"""Who follows traces in the live benches, and how a run of one is made."""

from __future__ import annotations

import time
from collections.abc import Mapping, Sequence
from typing import Any, Protocol

import numpy as np

from workcell.bench.live.arms import Arms
from workcell.bench.live.measures import Run
from workcell.bench.live.traces import PERIOD, Trace
from workcell.pose import Array, Pose


class Follower(Protocol):
    """Answers a frame's goals with a configuration."""

    def reset(self, q: Array) -> None:
        """Stand still at q (n,)."""

    def step(self, goals: Sequence[Pose]) -> Array | None:
        """The configuration (n,) of a frame, for each arm's goal; None: it has none, and the arms stay."""


class PointIK:
    """Damped least squares to every pose, from the last answer and then from random configurations.

    What TRAC-IK does in the paper: nothing ties an answer to the last one but where the search begins.

    Args:
        arms: who follows.
        tries: random starts of a frame whose pose the first descent misses.
    """

    def __init__(self, arms: Arms, tries: int = 0) -> None:
        from workcell.bench.live.descent import reach

        self._reach, self._tries = reach, tries
        self._parts = list(zip(arms.packed(), arms.columns, strict=True))
        self._q = np.zeros(arms.dof)
        self.reset(self._q)

    def reset(self, q: Array) -> None:
        """Stand at q (n,); random starts begin anew."""
        self._q = np.array(q)
        self._random = np.zeros(1, dtype=np.uint64)

    def step(self, goals: Sequence[Pose]) -> Array:
        """The nearest configuration that was found."""
        q = np.empty_like(self._q)
        for (arm, columns), goal in zip(self._parts, goals, strict=True):
            pose = np.concatenate([goal.position, goal.quat_wxyz])
            self._reach(arm, pose, self._q[columns], self._tries, self._random, q[columns])
        self._q = q
        return q


class Live:
    """`LiveIK`, as `settings` make it."""

    def __init__(self, arms: Arms, settings: Mapping[str, Any]) -> None:
        from workcell.motion.live.live_ik import LiveIK

        self._names = arms.names
        self._live = LiveIK(arms.worlds(), **{"period": PERIOD, **settings})

    def reset(self, q: Array) -> None:
        """Stand still at q (n,)."""
        self._live.reset(q)

    def step(self, goals: Sequence[Pose]) -> Array:
        """Its step."""
        return self._live.step(dict(zip(self._names, goals, strict=True))).q


def drive(follower: Follower, trace: Trace, start: Array) -> Run:
    """A run along a trace from q (n,), with the CPU time of every frame."""
    frames = [trace.goals(k) for k in range(len(trace))]
    way, seconds, unanswered = np.empty((len(frames) + 1, len(start))), np.empty(len(frames)), 0
    way[0] = start
    follower.reset(start)
    for k, goals in enumerate(frames):
        begun = time.process_time()
        q = follower.step(goals)
        seconds[k] = time.process_time() - begun
        answered = q is not None and bool(np.all(np.isfinite(q)))
        unanswered += not answered
        way[k + 1] = q if answered else way[k]
    return Run(way, seconds, unanswered)
