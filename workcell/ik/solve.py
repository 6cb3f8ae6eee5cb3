"""The one entry to inverse kinematics, `solve`: solvers propose, the judge and re-checked certificates decide."""

from __future__ import annotations

import numpy as np

from workcell.errors import InputError, UnknownNameError
from workcell.ik.observing import report
from workcell.ik.portfolio import Portfolio
from workcell.ik.problem import Budget, IKProblem
from workcell.ik.registry import AUTO, SOLVERS, Turn, auto_turns, solver_names, takers
from workcell.ik.result import IKResult


def check_solver_name(name: str) -> None:
    """Raise UnknownNameError, with close matches, unless `solve` knows the solver."""
    if name not in solver_names():
        raise UnknownNameError("solver", name, solver_names(), where="solver")


def solve(problem: IKProblem, solver: str = AUTO, budget: Budget | None = None, seed: int = 0) -> IKResult:
    """Answer an inverse-kinematics problem.

    Args:
        problem: the question.
        solver: `auto` (elementary proofs, sampling, branch and bound, the convex method), or one solver by name.
        budget: CPU seconds of this process; default `Budget()`. Zero: NOT_FOUND at once.
        seed: same problem, solver and seed, same answer, as far as the budget reaches (see `Budget.iterations`).

    Returns:
        `SOLVED` only with a configuration that `verify` accepted, a "no" only with a certificate that
        `check_certificate` accepted, otherwise `NOT_FOUND` or `SOLVER_ERROR`.

    Raises:
        UnknownNameError: no such solver. InputError: a seed that is no whole number >= 0, or a problem of a kind that
            the named solver doesn't take (`auto` passes such a solver over).
    """
    check_solver_name(solver)
    if isinstance(seed, bool) or not isinstance(seed, int | np.integer) or seed < 0:
        raise InputError(f"the seed is {seed!r}", where="seed", remedy="a whole number >= 0")
    if solver != AUTO and problem.goal not in SOLVERS[solver].goals:
        raise InputError(
            f"{solver} takes whole poses, not goals of kind {problem.goal!r}",
            where="solver",
            remedy=takers(goal=problem.goal, word="or"),
        )
    if solver != AUTO and problem.robot.coupling is not None and not SOLVERS[solver].couples:
        raise InputError(
            f"{solver} does not know joints that follow others, as in {problem.robot.name}",
            where="solver",
            remedy=takers(goal=problem.goal, couples=True, word="or"),
        )
    turns = auto_turns(problem.robot.dof, problem.goal) if solver == AUTO else (Turn(solver),)
    result = Portfolio(problem, solver, budget or Budget(), int(seed)).run(turns)
    report(problem, result)
    return result
