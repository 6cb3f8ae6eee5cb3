"""`Reporter`: what a frame's arrays say, as a `Step`."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from workcell.geometry.types import obstacle_name
from workcell.motion.live.limits import LiveLimits
from workcell.motion.live.step import Guard, GuardKind, LiveStatus, Step
from workcell.motion.live.surroundings import Arms, Obstacles
from workcell.pose import Array, read_only

if TYPE_CHECKING:
    from workcell.motion.live.kernels.limbs import Limbs
    from workcell.motion.live.kernels.motion import Motion
    from workcell.motion.live.kernels.relax import Desk

ON_GOAL_M, ON_GOAL_RAD = 1e-3, 5e-3
"""Errors within which a tool is on its goal."""
_AT_LIMIT = 1e-3
"""Radians or metres from a limit at which a joint stands at it."""
_FULL = 0.999
"""Share of a limit that is all of it."""
_REST = 1e-3
"""Share of its fastest at which a joint rests."""


class Reporter:
    """Makes `Step`s.

    Args:
        arms: the robots; limbs: the same for the kernels.
        obstacles: what they may hit.
        order: (k,) place of each packed shape among the standing obstacles.
        row_of: (s,) the packed row of each sphere.
    """

    def __init__(
        self,
        arms: Arms,
        limbs: Limbs,
        obstacles: Obstacles,
        order: NDArray[np.int64],
        row_of: NDArray[np.int64],
    ) -> None:
        self._names = arms.robot.joint_names
        self._lower, self._upper = arms.robot.lower, arms.robot.upper
        source = arms.cover.source or ("",) * len(arms.cover)
        self._spheres = [""] * len(source)
        for k, name in enumerate(source):
            self._spheres[row_of[k]] = name or f"link {arms.cover.link[k]}"
        self._shapes = [obstacle_name(obstacles.standing[k]) for k in order]
        self._movers = [name for name, part in obstacles.moving.items() for _ in part]
        self._tools = arms.tools

    def step(
        self,
        motion: Motion,
        desk: Desk,
        limits: LiveLimits,
        least: Array,
        reason: str,
        refused: str,
        timed_out: bool,
        seconds: float,
    ) -> Step:
        """The step that was just taken; arguments as `LiveIK` has them."""
        q, qd, qdd = motion.now
        guards = self._joint_guards(q, qd, qdd, motion.wanted[0], limits)
        guards += self._near_guards(motion, refused)
        ratio = desk.ratio.copy()
        for t in np.flatnonzero((least > 0.0) & (ratio < 1.2 * least)):
            guards.append(Guard(GuardKind.SINGULARITY, self._tools[t], float(ratio[t])))
        errors = desk.total.errors
        braked = bool(motion.report[0] == 0.0 or refused)
        shown, gap = motion.report[1] != 0.0, float(motion.report[2])
        if not shown and gap <= 0.0:
            status, reason = LiveStatus.IN_CONTACT, reason or "; ".join(str(g) for g in guards)
        elif reason:
            status = LiveStatus.NO_GOAL
        elif np.all(errors[:, 0] <= ON_GOAL_M) and np.all(errors[:, 1] <= ON_GOAL_RAD):
            status = LiveStatus.ON_GOAL
        else:
            holding = any(g.kind not in (GuardKind.VELOCITY, GuardKind.ACCELERATION) for g in guards)
            rests = bool(np.all(np.abs(qd) <= _REST * limits.velocity))
            status = LiveStatus.HELD if holding and rests else LiveStatus.MOVING
        return Step(
            read_only(q), read_only(qd), status, reason, read_only(errors[:, 0]), read_only(errors[:, 1]),
            read_only(desk.total.terms), tuple(guards), gap, read_only(ratio), braked, timed_out, seconds,
        )  # fmt: skip

    def _joint_guards(
        self, q: Array, qd: Array, qdd: Array, wanted: Array, limits: LiveLimits
    ) -> list[Guard]:
        found = []
        room = np.minimum(q - self._lower, self._upper - q)
        for k in np.flatnonzero(room < _AT_LIMIT):
            found.append(Guard(GuardKind.POSITION, self._names[k], float(room[k])))
        for k in np.flatnonzero(np.abs(qd) >= _FULL * limits.velocity):
            found.append(Guard(GuardKind.VELOCITY, self._names[k], float(abs(qd[k]) / limits.velocity[k])))
        return found

    def _near_guards(self, motion: Motion, refused: str) -> list[Guard]:
        found, seen = [], set()
        for sphere, kind, other, gap in motion.guards[: motion.used[0]].tolist():
            first = self._spheres[sphere]
            second = (self._shapes, self._movers, self._spheres)[kind][other]
            if (first, second) not in seen:
                seen.add((first, second))
                what = GuardKind.SELF if kind == 2 else GuardKind.OBSTACLE
                found.append(Guard(what, f"{first} and {second}", 1e-6 * gap))
        if refused:
            found.append(Guard(GuardKind.OBSTACLE, refused, 0.0))
        elif motion.report[0] < 1.0:
            found.append(
                Guard(GuardKind.BRAKING, "the step could not be shown to be clear", motion.report[0])
            )
        return found
