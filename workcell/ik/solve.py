"""The one entry to inverse kinematics: `solve`. Solvers propose; the judge and the re-checked certificate decide."""

from __future__ import annotations

import time
from collections.abc import Callable
from dataclasses import dataclass, field, replace
from typing import Any

import numpy as np

from workcell.errors import InputError, UnknownNameError, WorkcellError
from workcell.ik.certificate import Certificate
from workcell.ik.check import STATUS_OF_SCOPE, check_certificate
from workcell.ik.elementary import prove_impossible
from workcell.ik.multistart import solve_multistart
from workcell.ik.problem import Budget, IKProblem
from workcell.ik.result import Candidate, IKResult, Status
from workcell.ik.verify import Verification, verify
from workcell.model.robot import LIMIT_SLACK
from workcell.pose import Array

Solver = Callable[[IKProblem, Budget, int], Candidate]


def _elementary(problem: IKProblem, budget: Budget, seed: int) -> Candidate:
    from workcell.ik.screen import may_be_impossible

    return Candidate(certificate=prove_impossible(problem) if may_be_impossible(problem) else None)


def _hjcd(problem: IKProblem, budget: Budget, seed: int) -> Candidate:
    from workcell.ik.hjcdik import solve_hjcd

    return solve_hjcd(problem, budget, seed)


def _branch(problem: IKProblem, budget: Budget, seed: int) -> Candidate:
    from workcell.ik.branch import solve_branch

    return solve_branch(problem, budget, seed)


def _prepare_hjcd(problem: IKProblem) -> None:
    from workcell.ik import hjcdik

    hjcdik.prepare(problem)


def _prepare_elementary(problem: IKProblem) -> None:
    from workcell.ik import screen

    screen.prepare()


def _prepare_branch(problem: IKProblem) -> None:
    from workcell.ik import branch

    branch.prepare()


def _ikspark(problem: IKProblem, budget: Budget, seed: int) -> Candidate:
    from workcell.ik.ikspark import solve_ikspark

    return solve_ikspark(problem, budget, seed)


def _ikspark_local(problem: IKProblem, budget: Budget, seed: int) -> Candidate:
    from workcell.ik.ikspark import solve_ikspark

    return solve_ikspark(problem, budget, seed, local=True)


def _cidgik(problem: IKProblem, budget: Budget, seed: int) -> Candidate:
    from workcell.ik.cidgik import solve_cidgik

    return solve_cidgik(problem, budget, seed)


def _cidgik_local(problem: IKProblem, budget: Budget, seed: int) -> Candidate:
    from workcell.ik.cidgik import solve_cidgik

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

AUTO = "auto"


@dataclass(frozen=True, slots=True)
class Stage:
    """A turn of a solver in the portfolio: it ends `seconds` (CPU) after it began, and when `share` of the budget is spent."""

    name: str
    solver: Solver
    share: float = 1.0
    seconds: float = np.inf


class _Resumed:
    """Branch and bound that goes on where its last turn ended."""

    def __init__(self) -> None:
        self._search: Any = None

    def __call__(self, problem: IKProblem, budget: Budget, seed: int) -> Candidate:
        from workcell.ik.branch import BranchSearch

        deadline = time.process_time() + budget.cpu_s
        self._search = self._search or BranchSearch(problem)
        candidate: Candidate = self._search.run(deadline, budget.threads)
        return candidate


class _Inside:
    """The question of the model inside the real geometry: what is impossible there is impossible."""

    def __init__(self) -> None:
        self._branch = _Resumed()
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


def _portfolio(dof: int) -> tuple[Stage, ...]:
    """Stages of `auto`. Nearly all problems that have a solution fall to the first samples, nearly all others to branch and
    bound, which ends in a proof; what resists both gets longer turns of either, so that neither waits for the other."""
    branch, inside = _Resumed(), _Inside()
    return (
        Stage("elementary", _elementary, seconds=0.0),
        # Six joints have few configurations: one millisecond tells, and branch and bound needs but a few more.
        Stage("hjcd", _hjcd, seconds=0.001 if dof <= 6 else 0.002),
        Stage("branch", branch, seconds=0.01),
        Stage("hjcd", _hjcd, seconds=0.004),
        Stage("branch", branch, seconds=0.06),
        Stage("hjcd", _hjcd, seconds=0.02),
        Stage("inside", inside, seconds=1.0),
        Stage("branch", branch, share=0.6),
        Stage("inside", inside, share=0.75),
        Stage("ikspark", _ikspark, share=0.85),
        Stage("hjcd", _hjcd),
    )


_PREPARE: dict[str, Callable[[IKProblem], None]] = {
    "elementary": _prepare_elementary,
    "hjcd": _prepare_hjcd,
    "branch": _prepare_branch,
}
"""What compiles a solver on first use, or loads it from the cache: no query's budget pays for that."""


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
    stages = _portfolio(problem.robot.dof) if solver == AUTO else (Stage(solver, _SOLVERS[solver]),)
    if problem.goal != "pose" and solver == AUTO:
        stages = (Stage("branch", _branch),)
    return _Portfolio(problem, solver, budget or Budget(), int(seed)).run(stages)


@dataclass(slots=True)
class _Portfolio:
    """Runs stages until one gives an answer that holds; remembers what the others said."""

    problem: IKProblem
    name: str
    budget: Budget
    seed: int
    started_cpu: float = field(default_factory=time.process_time)
    started: float = field(default_factory=time.perf_counter)
    stats: dict[str, float] = field(default_factory=dict)
    rejected: list[str] = field(default_factory=list)
    errors: list[str] = field(default_factory=list)
    in_model: tuple[str, Certificate] | None = None

    def run(self, stages: tuple[Stage, ...]) -> IKResult:
        """The first answer that holds."""
        if self.budget.cpu_s == 0:
            return self._result(Status.NOT_FOUND, self.name)
        completed = 0
        for order, stage in enumerate(stages):
            left = stage.share * self.budget.cpu_s - self._spent()
            if self.budget.iterations is None or stage.name != "hjcd":
                left = min(left, stage.seconds)
            if (stage.seconds > 0 and left <= 0) or self._is_futile(stage):
                continue
            budget = replace(self.budget, cpu_s=max(left, 0.0))
            candidate = self._call(stage.name, stage.solver, budget, self.seed + 7919 * order)
            completed += candidate.error is None
            result = self._answer(stage.name, candidate)
            if result is not None:
                return result
        if self.in_model is not None:
            solver_name, certificate = self.in_model
            return self._result(Status.BLOCKED_IN_MODEL, solver_name, certificate=certificate)
        # the elementary stage alone finds nothing out about solutions
        failed = self.errors and completed <= (1 if self.name == AUTO else 0)
        return self._result(Status.SOLVER_ERROR if failed else Status.NOT_FOUND, self.name)

    def _is_futile(self, stage: Stage) -> bool:
        """Whether a stage can't find out more: branch and bound is through, or a short search has seen all it can."""
        if stage.name == "branch":
            return self.in_model is not None and self.in_model[0] == "branch"
        if stage.name == "inside":
            # only where the model around the real geometry is known to be too large, or time gets short
            return self.problem.inner is None or (self.in_model is None and stage.seconds < np.inf)
        return stage.name == "hjcd" and stage.seconds < np.inf and self.stats.get("hjcd.exhausted", 0.0) > 0.0

    def _spent(self) -> float:
        return time.process_time() - self.started_cpu

    def _prepare(self, name: str) -> None:
        """Set the clocks on by what compiling takes, and what is made once for a scene."""
        make = IKProblem.inside if name == "inside" else _PREPARE.get(name)
        if make is None:
            return
        cpu, wall = time.process_time(), time.perf_counter()
        make(self.problem)
        self.started_cpu += time.process_time() - cpu
        self.started += time.perf_counter() - wall

    def _call(self, name: str, solver: Solver, budget: Budget, seed: int) -> Candidate:
        """A stage's candidate; whatever numerical failure happens inside becomes its `error`."""
        self._prepare(name)
        before = self._spent()
        try:
            with np.errstate(all="ignore"):
                candidate = solver(self.problem, budget, seed)
        except WorkcellError as error:
            if self.name != AUTO:
                raise
            candidate = Candidate(rejected=(f"{name} does not apply: {error}",))
        except Exception as error:
            candidate = Candidate(error=f"{type(error).__name__}: {error}")
        except BaseException as error:
            # a panic in Clarabel's Rust code arrives outside the Exception hierarchy
            if type(error).__name__ != "PanicException":
                raise
            candidate = Candidate(error=f"the conic solver panicked: {error}")
        for key, value in {**candidate.stats, "cpu_s": self._spent() - before}.items():
            label = f"{name}.{key}"
            # what goes on where it stopped counts from its beginning
            known = 0.0 if isinstance(solver, _Resumed) and key != "cpu_s" else self.stats.get(label, 0.0)
            self.stats[label] = known + float(value)
        return candidate

    def _answer(self, name: str, candidate: Candidate) -> IKResult | None:
        """A result if the candidate holds; else its failures are noted."""
        self.rejected += [reason for reason in candidate.rejected if reason not in self.rejected]
        if candidate.error is not None:
            self.errors.append(candidate.error)
            self.rejected.append(f"{name} failed: {candidate.error}")
        if candidate.q is not None:
            q = self._into_limits(candidate.q)
            verdict = verify(self.problem, q)
            if verdict.accepted:
                return self._result(Status.SOLVED, name, q=q, verdict=verdict)
            self.rejected.append(f"{name}'s configuration was refused: {'; '.join(verdict.reasons)}")
        if candidate.certificate is not None:
            return self._proof(name, candidate.certificate)
        return None

    def _proof(self, name: str, certificate: Certificate) -> IKResult | None:
        refusal = check_certificate(self.problem, certificate)
        if refusal is not None:
            self.rejected.append(f"{name}'s certificate was refused: {refusal}")
            return None
        status = STATUS_OF_SCOPE[certificate.scope]
        if status is Status.BLOCKED_IN_MODEL and self.name == AUTO:
            # the true geometry may still allow a solution: let the other solvers look for it
            self.in_model = self.in_model or (name, certificate)
            return None
        return self._result(status, name, certificate=certificate)

    def _into_limits(self, q: Array) -> Array:
        """Clamp what exceeds the limits by rounding only; the rest is the judge's business."""
        robot = self.problem.robot
        values = np.array(q, dtype=float)
        if values.shape != (robot.dof,):
            return values
        clamped: Array = np.clip(values, robot.lower, robot.upper)
        excess = float(np.abs(clamped - values).max())
        if not 0 < excess <= LIMIT_SLACK:
            return values
        self.stats["clamped_to_limits"] = excess
        return clamped

    def _result(
        self,
        status: Status,
        solver: str,
        *,
        q: Array | None = None,
        verdict: Verification | None = None,
        certificate: Certificate | None = None,
    ) -> IKResult:
        stats = {**self.stats, "cpu_s": self._spent(), "time_s": time.perf_counter() - self.started}
        measured: dict[str, Any] = {}
        if verdict is not None:
            measured = {
                "position_error": verdict.position_error,
                "rotation_error": verdict.rotation_error,
                "clearance": verdict.clearance,
            }
        return IKResult(
            status,
            solver,
            q=q,
            certificate=certificate,
            stats=stats,
            rejected=tuple(self.rejected),
            **measured,
        )
