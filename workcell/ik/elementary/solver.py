"""Elementary bounds as a solver: a proof where one exists, looked for in compiled code before it is made."""

from __future__ import annotations

from workcell.ik.elementary import screen
from workcell.ik.elementary.bounds import prove_impossible
from workcell.ik.problem import Budget, IKProblem
from workcell.ik.result import Candidate


def prepare(problem: IKProblem) -> None:
    """Compile the quick look, or load it from the cache."""
    del problem
    screen.prepare()


def solve_elementary(problem: IKProblem, budget: Budget, seed: int = 0) -> Candidate:
    """A certificate of kind `reach` or `last_link`, or nothing; well below a millisecond, whatever the budget."""
    del budget, seed
    return Candidate(certificate=prove_impossible(problem) if screen.may_be_impossible(problem) else None)
