"""How near to its target any configuration of a robot can come at best: proved, obstacles aside."""

from __future__ import annotations

import math
from dataclasses import dataclass, replace

from workcell.ik.ikspark.mechanisms.minimising.bound import lower_bound
from workcell.ik.mechanisms.check import check_cost
from workcell.ik.mechanisms.goals import FrameGoal
from workcell.ik.mechanisms.of_problem import mechanism_problem
from workcell.ik.problem import IKProblem, Tolerances

SHORTEST = 1e-4
"""Metres, or radians, below which a bound is not worth telling."""


@dataclass(frozen=True, slots=True)
class Nearness:
    """Lower bounds, each from a certificate that was checked again; zero where nothing is proved.

    Attributes:
        position: metres that every configuration's tool is away from the target's position, at least.
        cost: of every configuration, the least sum of the squared distance (metres) and of the squared errors of the
            rotation's nine entries (Eq. 36); without a wanted rotation the squared distance alone.
    """

    position: float = 0.0
    cost: float = 0.0

    @property
    def rotation(self) -> float:
        """Radians that every configuration is turned from the target, at least, whose tool is at its position.

        Rotations an angle t apart differ by `8 sin(t / 2)^2` in squares of their entries.
        """
        return 2.0 * math.asin(math.sqrt(min(self.cost / 8.0, 1.0)))

    def words(self, tolerances: Tolerances) -> str:
        """What is proved, as far as it is worth telling; empty: nothing is."""
        if self.position > max(tolerances.position, SHORTEST):
            return f"none is closer than {math.floor(1e4 * self.position) / 10.0:.1f} mm (proved)"
        turned = math.floor(10.0 * math.degrees(self.rotation)) / 10.0
        if self.cost > self.position**2 and turned > math.degrees(max(tolerances.rotation, SHORTEST)):
            return f"at the target's position none is turned by less than {turned:.1f} degrees (proved)"
        return ""


def nearness(problem: IKProblem) -> Nearness:
    """Lower bounds for a query; those on the cost only where the whole rotation is asked for."""
    position = _bound(problem, turned=False)
    cost = _bound(problem, turned=True) if problem.goal == "pose" else position
    return Nearness(math.sqrt(position), max(cost, position))


def _bound(problem: IKProblem, *, turned: bool) -> float:
    """What the cost is proved to be at least, the wanted rotation in it or not."""
    question, target = mechanism_problem(problem), problem.target
    frame = question.goals[0].frame
    goal = FrameGoal.posed(frame, target) if turned else FrameGoal.at(frame, target.position)
    question = replace(question, goals=(goal,))
    found = lower_bound(question)
    checked = None if found is None else check_cost(question, found[1])
    return 0.0 if checked is None else checked
