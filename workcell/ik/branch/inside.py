"""The question of the model inside the real geometry: what is impossible there is impossible for that geometry."""

from __future__ import annotations

from workcell import clock
from workcell.ik.branch.solver import BranchSearch
from workcell.ik.elementary.solver import solve_elementary
from workcell.ik.problem import Budget, IKProblem
from workcell.ik.result import Candidate


def prepare(problem: IKProblem) -> None:
    """Make the inner model, which is made once for a scene."""
    problem.inside()


def solve_inside(problem: IKProblem, budget: Budget, seed: int = 0) -> Candidate:
    """Look for a proof that holds of the real geometry; nothing where the problem has no inner model."""
    del seed
    return InsideSearch(problem).run(clock.cpu_seconds() + budget.cpu_s, budget)


class InsideSearch:
    """Elementary bounds, then branch and bound, on the inner model; `run` can be called again to go on."""

    def __init__(self, problem: IKProblem) -> None:
        self._model = problem.inside()
        self._search: BranchSearch | None = None

    def run(self, deadline: float, budget: Budget) -> Candidate:
        """Search on: as `BranchSearch.run`."""
        if self._model is None:
            return Candidate()
        if self._search is None:
            proved = solve_elementary(self._model, Budget(0.0))
            if proved.certificate is not None:
                return proved
            self._search = BranchSearch(self._model)
        return self._search.run(max(deadline, clock.cpu_seconds()), budget)
