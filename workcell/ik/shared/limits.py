"""Interval: where a joint of a problem may be.

Every solver asks here; judges and the checker of proofs say it for themselves.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from workcell.ik.problem import IKProblem
from workcell.model.robot import LIMIT_SLACK
from workcell.pose import Array


@dataclass(frozen=True, slots=True)
class Interval:
    """Where each joint may be: limits, intersected with `q_reference` +- `max_step`. Radians, (n,) each."""

    lower: Array
    upper: Array

    @staticmethod
    def of(problem: IKProblem, slack: float = 0.0) -> Interval:
        """The intervals of a problem; they may be empty when the reference lies outside the limits.

        Args:
            problem: whose limits, reference and largest step count.
            slack: radians (metres for a prismatic joint) by which limits and step are widened before they are
                intersected.
        """
        robot, reference = problem.robot, problem.q_reference
        lower, upper = robot.lower, robot.upper
        if slack:
            lower, upper = lower - slack, upper + slack
        if problem.max_step is None or reference is None:
            return Interval(lower, upper)
        step = np.asarray(problem.max_step) + slack
        return Interval(np.maximum(lower, reference - step), np.minimum(upper, reference + step))

    @property
    def closed(self) -> Interval:
        """The same where there is a value, else the lower end alone: something to clip to and draw from."""
        return Interval(self.lower, np.maximum(self.lower, self.upper))

    @property
    def middle(self) -> Array:
        """Centre of each interval."""
        return 0.5 * (self.lower + self.upper)

    @property
    def half(self) -> Array:
        """Half width, widened by the slack within which limits count as kept."""
        return 0.5 * (self.upper - self.lower) + LIMIT_SLACK

    @property
    def empty(self) -> bool:
        """Whether some joint has no admissible value."""
        return bool(np.any(self.half < 0))
