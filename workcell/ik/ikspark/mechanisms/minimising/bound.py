"""What the squared pose errors are never below: the minimum of Problem 2b, as a proof that is checked."""

from __future__ import annotations

from workcell.ik.certificate import Certificate
from workcell.ik.ikspark.mechanisms.claim import certify_cost
from workcell.ik.ikspark.mechanisms.minimising.cost import CostProgram
from workcell.ik.ikspark.mechanisms.relaxation import Relaxation
from workcell.ik.mechanisms.problem import MechanismProblem
from workcell.ik.shared.conic import ConicSolution

TIGHT = 1e-9
"""Clarabel's tolerance for a minimum that a bound is of."""


def lower_bound(problem: MechanismProblem) -> tuple[float, Certificate] | None:
    """A lower bound on the cost (Eq. 36) with its certificate; None: nothing is proved.

    It holds with obstacles and users' constraints aside, and so with them.

    Args:
        problem: positions and rotations of its goals are the cost, all else has to hold.

    Raises:
        ModelError: ties that contradict each other.
    """
    program = CostProgram(Relaxation.of(problem, poses=False))
    if program.contradiction is not None or not len(program.cost.rows):
        return None
    return bound_of(problem, program, program.closest(tolerance=TIGHT))


def bound_of(
    problem: MechanismProblem, program: CostProgram, solution: ConicSolution
) -> tuple[float, Certificate] | None:
    """The same from a minimum that is known; None also where rows that no proof rests on have a share in it."""
    multipliers = program.multipliers(solution.z) if solution.usable else None
    if multipliers is None:
        return None
    return certify_cost(problem, program.cost.errors(solution.x), multipliers)
