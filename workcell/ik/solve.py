"""The one entry to inverse kinematics: `solve`. Solvers propose; the judge and the re-checked certificate decide."""

from __future__ import annotations

import time
from dataclasses import replace

import numpy as np

from workcell.errors import InputError, UnknownNameError
from workcell.ik.elementary.bounds import prove_impossible
from workcell.ik.multistart.solver import solve_multistart
from workcell.ik.observing import report
from workcell.ik.portfolio import AUTO, Portfolio, Resumed, Solver, Turn
from workcell.ik.problem import Budget, IKProblem
from workcell.ik.result import Candidate, IKResult


def _elementary(problem: IKProblem, budget: Budget, seed: int) -> Candidate:
    from workcell.ik.elementary.screen import may_be_impossible

    return Candidate(certificate=prove_impossible(problem) if may_be_impossible(problem) else None)


def _hjcd(problem: IKProblem, budget: Budget, seed: int) -> Candidate:
    from workcell.ik.hjcd.solver import solve_hjcd

    return solve_hjcd(problem, budget, seed)


def _branch(problem: IKProblem, budget: Budget, seed: int) -> Candidate:
    from workcell.ik.branch.solver import solve_branch

    return solve_branch(problem, budget, seed)


def _ikspark(problem: IKProblem, budget: Budget, seed: int) -> Candidate:
    from workcell.ik.ikspark.solver import solve_ikspark

    return solve_ikspark(problem, budget, seed)


def _ikspark_local(problem: IKProblem, budget: Budget, seed: int) -> Candidate:
    from workcell.ik.ikspark.solver import solve_ikspark

    return solve_ikspark(problem, budget, seed, local=True)


def _cidgik(problem: IKProblem, budget: Budget, seed: int) -> Candidate:
    from workcell.ik.cidgik.solver import solve_cidgik

    return solve_cidgik(problem, budget, seed)


def _cidgik_local(problem: IKProblem, budget: Budget, seed: int) -> Candidate:
    from workcell.ik.cidgik.solver import solve_cidgik

    return solve_cidgik(problem, budget, seed, local=True)


_SOLVERS: dict[str, Solver] = {
    "hjcd": _hjcd,
    "branch": _branch,
    "multistart": solve_multistart,
    "ikspark": _ikspark,
    "ikspark+lm": _ikspark_local,
    "cidgik": _cidgik,
    "cidgik+lm": _cidgik_local,
}


class _Inside:
    """The question of the model inside the real geometry: what is impossible there is impossible."""

    def __init__(self) -> None:
        self._branch = Resumed()
        self._model: IKProblem | None = None

    def __call__(self, problem: IKProblem, budget: Budget, seed: int) -> Candidate:
        deadline = time.process_time() + budget.cpu_s
        if self._model is None:
            self._model = problem.inside()
            if self._model is None:
                return Candidate()
            proved = _elementary(self._model, budget, seed)
            if proved.certificate is not None:
                return proved
        left = replace(budget, cpu_s=max(deadline - time.process_time(), 0.0))
        return self._branch(self._model, left, seed)


def _portfolio(dof: int) -> tuple[Turn, ...]:
    """Turns of `auto`. Nearly all problems that have a solution fall to the first samples, nearly all others to branch and
    bound, which ends in a proof; what resists both gets longer turns of either, so that neither waits for the other."""
    branch, inside = Resumed(), _Inside()
    return (
        Turn("elementary", _elementary, seconds=0.0),
        # Six joints have few configurations: one millisecond tells, and branch and bound needs but a few more.
        Turn("hjcd", _hjcd, seconds=0.001 if dof <= 6 else 0.002),
        Turn("branch", branch, seconds=0.01),
        Turn("hjcd", _hjcd, seconds=0.004),
        Turn("branch", branch, seconds=0.06),
        Turn("hjcd", _hjcd, seconds=0.02),
        Turn("inside", inside, seconds=1.0),
        Turn("branch", branch, share=0.6),
        Turn("inside", inside, share=0.75),
        Turn("ikspark", _ikspark, share=0.85),
        Turn("hjcd", _hjcd),
    )


def solver_names() -> tuple[str, ...]:
    """Names that `solve` takes."""
    return (AUTO, *_SOLVERS)


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
        UnknownNameError: no such solver. InputError: a seed that is no whole number >= 0, or a problem of a kind that the
            named solver doesn't take (`auto` passes such a solver over).
    """
    check_solver_name(solver)
    if isinstance(seed, bool) or not isinstance(seed, int | np.integer) or seed < 0:
        raise InputError(f"the seed is {seed!r}", where="seed", remedy="a whole number >= 0")
    if problem.goal != "pose" and solver not in (AUTO, "branch", "cidgik", "cidgik+lm"):
        raise InputError(
            f"{solver} takes whole poses, not goals of kind {problem.goal!r}",
            where="solver",
            remedy="auto, branch or cidgik",
        )
    turns = _portfolio(problem.robot.dof) if solver == AUTO else (Turn(solver, _SOLVERS[solver]),)
    if problem.goal != "pose" and solver == AUTO:
        turns = (Turn("branch", _branch),)
    result = Portfolio(problem, solver, budget or Budget(), int(seed)).run(turns)
    report(problem, result)
    return result
