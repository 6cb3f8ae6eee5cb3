"""Who answers the questions of a mechanism's way: the planner that is named, or downhill steps and it."""

from __future__ import annotations

from workcell.clock import cpu_seconds
from workcell.errors import InputError
from workcell.ik.mechanisms.judge import judge_mechanism
from workcell.ik.mechanisms.polish import polish_mechanism
from workcell.ik.mechanisms.problem import MechanismProblem
from workcell.ik.mechanisms.result import MechanismResult
from workcell.ik.observing import report
from workcell.ik.problem import POSE_BUDGET, Budget
from workcell.ik.registry import AUTO
from workcell.ik.result import Status
from workcell.ik.stages import SolverStage
from workcell.motion.mechanisms.follow import MechanismSolver

LOCAL = "local"
MECHANISM_PLANNERS = ("ikspark", AUTO)
"""Planners that know mechanisms."""


def mechanism_solver(planner: str, budget: Budget | None = None, seed: int = 0) -> MechanismSolver:
    """The answers of a planner.

    With `ikspark` all of them are its own; with `auto` a step is looked for downhill from the configuration before it
    first, and all solvers are asked in turns where that fails.

    Raises:
        InputError: a planner that knows no mechanisms.
    """
    if planner not in MECHANISM_PLANNERS:
        raise InputError(
            f"{planner} plans arms, not mechanisms", where="planner", remedy=" or ".join(MECHANISM_PLANNERS)
        )

    def answer(problem: MechanismProblem) -> MechanismResult:
        from workcell.ik.solve_mechanism import solve_mechanism

        return solve_mechanism(problem, solver=planner, budget=budget or POSE_BUDGET, seed=seed)

    def either(problem: MechanismProblem) -> MechanismResult:
        found = downhill(problem)
        if found is None:
            return answer(problem)
        report(problem, found)
        return found

    return either if planner == AUTO else answer


def downhill(problem: MechanismProblem) -> MechanismResult | None:
    """The answer that is reached downhill from the problem's reference, if the judge takes it.

    None: there is no reference, the problem has constraints of its own, or that leads nowhere.
    """
    if problem.q_reference is None or problem.constraints:
        return None
    began = cpu_seconds()
    found = polish_mechanism(problem, problem.q_reference)
    measured = judge_mechanism(problem, found.q)
    if not measured.accepted:
        return None
    spent = cpu_seconds() - began
    stage = SolverStage("downhill", spent, numbers={"steps": found.steps}, solver=LOCAL)
    return MechanismResult(Status.SOLVED, LOCAL, found.q, measured, stats={"cpu_s": spent}, stages=(stage,))
