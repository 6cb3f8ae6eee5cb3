"""`Telling`: what happens to tools that follow goals, as lines of the log, when it changes."""

from __future__ import annotations

import re
from collections.abc import Callable

from workcell.motion.live.step import Guard, LiveStatus, Step

_NUMBERS = re.compile(r"[-+.\d]*\d(?:e[-+]?\d+)?")
_SETTLED_S = 0.2
"""Seconds for which a status must last before it is told."""
_GONE_S = 0.5
"""Seconds after which a guard that was not seen again has let go."""
_AT_ONCE = (LiveStatus.IN_CONTACT, LiveStatus.NO_GOAL)
_LEVELS = {LiveStatus.HELD: "WARN", LiveStatus.NO_GOAL: "WARN", LiveStatus.IN_CONTACT: "WARN"}


class Telling:
    """The lines of one order.

    Args:
        log: takes a text and a level.
        period: seconds of a frame.
    """

    def __init__(self, log: Callable[[str, str], None], period: float) -> None:
        self._log, self._period = log, period
        self._told: tuple[LiveStatus, str] | None = None
        self._seen: tuple[LiveStatus, str] | None = None
        self._lasted = 0.0
        self._guards: dict[tuple[str, str], float] = {}

    def frame(self, step: Step, reason: str) -> None:
        """One frame; `reason` is why there is no goal, where the goals' source says so."""
        self._tell_status(step, reason or step.reason)
        self._tell_guards(step.guards)

    def jump(self, joint: str, moved: float, most: float) -> None:
        """A joint that went farther in a frame than its velocity limit lets it."""
        self._log(f"jump: {joint} moved by {moved:.4g} in a frame, {most:.4g} at most is allowed", "ERROR")

    def _tell_status(self, step: Step, reason: str) -> None:
        # numbers in a reason, such as for how long there was none, make no other reason of it
        now = (step.status, _NUMBERS.sub("", reason) if step.status is LiveStatus.NO_GOAL else "")
        self._lasted = self._lasted + self._period if now == self._seen else 0.0
        self._seen = now
        settled = step.status in _AT_ONCE or self._told is None or self._lasted >= _SETTLED_S
        if now == self._told or not settled:
            return
        self._told = now
        because = f" ({reason})" if reason else ""
        self._log(f"{step.status.value}{because}: {step.status.sentence}", _LEVELS.get(step.status, "INFO"))

    def _tell_guards(self, guards: tuple[Guard, ...]) -> None:
        for guard in guards:
            key = (guard.kind.value, guard.who)
            if key not in self._guards:
                self._log(f"guard on: {guard}", "INFO")
            self._guards[key] = 0.0
        active = {(guard.kind.value, guard.who) for guard in guards}
        for key in [key for key in self._guards if key not in active]:
            self._guards[key] += self._period
            if self._guards[key] >= _GONE_S:
                del self._guards[key]
                self._log(f"guard off: {key[0]}: {key[1]}", "INFO")
