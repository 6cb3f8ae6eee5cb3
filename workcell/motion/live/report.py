"""`Reporter`: what a frame's arrays say, as a `Step`."""

from __future__ import annotations

from itertools import pairwise
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from workcell.geometry.types import obstacle_name
from workcell.motion.live.step import Guard, GuardKind, LiveStatus, Step
from workcell.motion.live.surroundings import Arms, Obstacles

if TYPE_CHECKING:
    from workcell.motion.live.kernels.motion import Motion

_KINDS = (GuardKind.POSITION, GuardKind.VELOCITY, GuardKind.ACCELERATION, GuardKind.SINGULARITY)
"""In the order of the kernels' numbers; pairs that are near come after them."""
SINGULARITY, NEAR = 3, 4
_RATES = (GuardKind.VELOCITY, GuardKind.ACCELERATION)
"""Guards that slow an arm down but don't hold it."""
_PAIRS = (GuardKind.SELF, GuardKind.OBSTACLE)
"""Guards between two things."""


class Reporter:
    """Makes `Step`s.

    Args:
        arms: the robots.
        obstacles: what they may hit.
        order: (k,) place of each packed shape among the standing obstacles.
        row_of: (s,) the packed row of each sphere.
    """

    def __init__(
        self,
        arms: Arms,
        obstacles: Obstacles,
        order: NDArray[np.int64],
        row_of: NDArray[np.int64],
    ) -> None:
        self._names = arms.robot.joint_names
        source = arms.cover.source or ("",) * len(arms.cover)
        self._spheres = [""] * len(source)
        for k, name in enumerate(source):
            self._spheres[row_of[k]] = name or f"link {arms.cover.link[k]}"
        self._shapes = [obstacle_name(obstacles.standing[k]) for k in order]
        self._movers = [name for name, part in obstacles.moving.items() for _ in part]
        self._tools = arms.tools
        n, k = arms.robot.dof, len(arms.tools)
        ends = (0, n, 2 * n, 2 * n + k, 2 * n + 2 * k, 2 * n + 2 * k + 7, 2 * n + 3 * k + 7)
        self._parts = [slice(a, b) for a, b in pairwise(ends)]

    def step(self, motion: Motion, reason: str, refused: str, timed_out: bool, seconds: float) -> Step:
        """A frame's step, after the guard; arguments as `LiveIK` has them."""
        told = motion.out.copy()
        told.flags.writeable = False
        q, qd, position, rotation, terms, conditioning = [told[part] for part in self._parts]
        braked, shown, on_goal, rests = motion.flags.tolist()
        guards = self._guards(motion, refused)
        gap = float(told[-1])
        if not shown and gap <= 0.0:
            touching = [str(guard) for guard in guards if guard.kind in _PAIRS]
            status, reason = LiveStatus.IN_CONTACT, reason or "; ".join(touching)
        elif reason:
            status = LiveStatus.NO_GOAL
        elif on_goal:
            status = LiveStatus.ON_GOAL
        else:
            holding = any(guard.kind not in _RATES for guard in guards)
            status = LiveStatus.HELD if holding and rests else LiveStatus.MOVING
        return Step(
            q, qd, status, reason, position, rotation, terms, guards, gap, conditioning, bool(braked), timed_out,
            seconds,
        )  # fmt: skip

    def _guards(self, motion: Motion, refused: str) -> tuple[Guard, ...]:
        found, seen = [], set[tuple[str, str]]()
        for row in range(motion.used[0]):
            kind, first, pair, other = motion.guards[row].tolist()
            value = float(motion.values[row])
            if kind != NEAR:
                names = self._tools if kind == SINGULARITY else self._names
                found.append(Guard(_KINDS[kind], names[first], value))
                continue
            names = self._spheres[first], (self._shapes, self._movers, self._spheres)[pair][other]
            if names not in seen:
                seen.add(names)
                what = GuardKind.SELF if pair == 2 else GuardKind.OBSTACLE
                found.append(Guard(what, " and ".join(names), value))
        if refused:
            found.append(Guard(GuardKind.OBSTACLE, refused, 0.0))
        elif motion.flags[0]:
            share = float(motion.report[0])
            found.append(Guard(GuardKind.BRAKING, "the step could not be shown to be clear", share))
        return tuple(found)
