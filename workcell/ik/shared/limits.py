"""Interval: where a joint of a problem may be."""

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
    def of(problem: IKProblem) -> Interval:
        """The intervals of a problem; they may be empty when the reference lies outside the limits."""
        robot, reference = problem.robot, problem.q_reference
        if problem.max_step is None or reference is None:
            return Interval(robot.lower, robot.upper)
        return Interval(
            np.maximum(robot.lower, reference - problem.max_step),
            np.minimum(robot.upper, reference + problem.max_step),
        )

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
