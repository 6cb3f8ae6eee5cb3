"""How `solve` runs solvers in turns, each for a counted amount of work, until one gives an answer that holds."""

from __future__ import annotations

import time
from collections.abc import Callable
from dataclasses import dataclass, field, replace
from typing import TYPE_CHECKING, Any

import numpy as np

from workcell import clock
from workcell.errors import WorkcellError
from workcell.ik.certificate import Certificate
from workcell.ik.check import STATUS_OF_SCOPE, check_certificate
from workcell.ik.judge.verify import Verification, verify
from workcell.ik.problem import Budget, Clearance, IKProblem
from workcell.ik.registry import AUTO, SOLVERS, Progress, Turn, load
from workcell.ik.result import Candidate, IKResult, Status
from workcell.ik.stages import SolverStage, StageLog
from workcell.model.robot import LIMIT_SLACK
from workcell.pose import Array

if TYPE_CHECKING:
    from workcell.ik.registry import Solver


class Resumed:
    """A search that goes on where its last turn ended."""

    def __init__(self, search: Callable[[IKProblem], Any]) -> None:
        self._begin = search
        self._search: Any = None

    def __call__(self, problem: IKProblem, budget: Budget, seed: int) -> Candidate:
        """Search on for as long as the budget says."""
        del seed
        deadline = clock.cpu_seconds() + budget.cpu_s
        self._search = self._search or self._begin(problem)
        candidate: Candidate = self._search.run(deadline, budget)
        return candidate


@dataclass(slots=True)
class Portfolio:
    """Runs solvers until one gives an answer that holds; remembers what the others said."""

    problem: IKProblem
    name: str
    budget: Budget
    seed: int
    started_cpu: float = field(default_factory=clock.cpu_seconds)
    started: float = field(default_factory=time.perf_counter)
    stats: dict[str, float] = field(default_factory=dict)
    rejected: list[str] = field(default_factory=list)
    errors: list[str] = field(default_factory=list)
    in_model: tuple[str, Certificate] | None = None
    resumed: dict[str, Resumed] = field(default_factory=dict)
    log: StageLog = field(default_factory=StageLog)

    def run(self, turns: tuple[Turn, ...]) -> IKResult:
        """The first answer that holds."""
        if self.budget.cpu_s == 0:
            return self._result(Status.NOT_FOUND, self.name)
        completed, effort = 0, np.inf if self.budget.effort is None else self.budget.effort
        for order, turn in enumerate(turns):
            entry, left = SOLVERS[turn.solver], self.budget.cpu_s - self._spent()
            if self.problem.robot.coupling is not None and not entry.couples:
                continue
            work = min(turn.effort, effort)
            if (turn.effort > 0 and (left <= 0 or work <= 0)) or entry.is_futile(turn, self._progress()):
                continue
            effort -= work
            budget = replace(self.budget, cpu_s=max(left, 0.0), effort=work if np.isfinite(work) else None)
            candidate = self._call(turn.solver, budget, self.seed + 7919 * order)
            completed += candidate.error is None
            result = self._answer(turn.solver, candidate)
            if result is not None:
                return result
        self.stats["timed_out"] = float(self._spent() >= self.budget.cpu_s)
        if self.in_model is not None:
            solver_name, certificate = self.in_model
            return self._result(Status.BLOCKED_IN_MODEL, solver_name, certificate=certificate)
        # the elementary turn alone finds nothing out about solutions
        failed = self.errors and completed <= (1 if self.name == AUTO else 0)
        return self._result(Status.SOLVER_ERROR if failed else Status.NOT_FOUND, self.name)

    def _progress(self) -> Progress:
        return Progress(self.problem, self.stats, None if self.in_model is None else self.in_model[0])

    def _spent(self) -> float:
        return clock.cpu_seconds() - self.started_cpu

    def _prepare(self, name: str) -> Solver:
        """A turn's solver, ready to go; the clocks are set on by what importing and compiling takes."""
        entry, cpu, wall = SOLVERS[name], clock.cpu_seconds(), time.perf_counter()
        goes_on = self.name == AUTO and entry.resumes
        solver: Solver = self._resumed(name, entry.resumes) if goes_on else entry.solver()
        if entry.prepare:
            load(entry.prepare)(self.problem)
        self.started_cpu += clock.cpu_seconds() - cpu
        self.started += time.perf_counter() - wall
        return solver

    def _resumed(self, name: str, search: str) -> Resumed:
        return self.resumed.setdefault(name, Resumed(load(search)))

    def _call(self, name: str, budget: Budget, seed: int) -> Candidate:
        """A turn's candidate; whatever numerical failure happens inside becomes its `error`."""
        solver = self._prepare(name)
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
        spent = self._spent() - before
        alone = SolverStage(SOLVERS[name].work or name, spent, numbers=candidate.stats)
        self.log.extend(candidate.stages or (alone,), name, spent)
        for key, value in {**candidate.stats, "cpu_s": spent}.items():
            label = f"{name}.{key}"
            # what goes on where it stopped counts from its beginning
            known = 0.0 if isinstance(solver, Resumed) and key != "cpu_s" else self.stats.get(label, 0.0)
            self.stats[label] = known + float(value)
        return candidate

    def _answer(self, name: str, candidate: Candidate) -> IKResult | None:
        """A result if the candidate holds; else its failures are noted."""
        self.rejected += [reason for reason in candidate.rejected if reason not in self.rejected]
        if candidate.error is not None:
            self.errors.append(candidate.error)
            self.rejected.append(f"{name} failed: {candidate.error}")
        if candidate.q is not None:
            q, verdict = self._judged(candidate.q)
            words = "accepted" if verdict.accepted else "; ".join(verdict.reasons)
            self.log.add("verify", note=words, solver=name)
            if verdict.accepted:
                return self._result(
                    Status.SOLVED, candidate.by or name, q=q, verdict=verdict, found=candidate
                )
            self.rejected.append(f"{name}'s configuration was refused: {'; '.join(verdict.reasons)}")
        if candidate.certificate is not None:
            return self._proof(name, candidate.certificate)
        return None

    def _judged(self, proposed: Array) -> tuple[Array, Verification]:
        """A proposed configuration, in whole turns near to where the robot stands if the judge accepts it so."""
        q = self._into_limits(proposed)
        if q.shape == (self.problem.robot.dof,) and np.isfinite(q).all():
            turned = self._into_limits(self.problem.unwrapped(q))
            if not np.array_equal(turned, q) and (verdict := verify(self.problem, turned)).accepted:
                return turned, verdict
        return q, verify(self.problem, q)

    def _proof(self, name: str, certificate: Certificate) -> IKResult | None:
        # a solver's yes is a configuration, which the judge looks at
        refusal = (
            "it proves no impossibility"
            if STATUS_OF_SCOPE.get(certificate.scope) is Status.SOLVED
            else check_certificate(self.problem, certificate)
        )
        self.log.add("check of the proof", note=refusal or "it holds", solver=name)
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
        found: Candidate | None = None,
    ) -> IKResult:
        stats = {**self.stats, "cpu_s": self._spent(), "time_s": time.perf_counter() - self.started}
        measured: dict[str, Any] = {}
        if verdict is not None:
            checks = self.problem.checks
            measured = {
                "position_error": verdict.position_error,
                "rotation_error": verdict.rotation_error,
                "clearance": Clearance(float("inf")) if checks.nothing else verdict.clearance,
                "checks": checks,
            }
        return IKResult(
            status,
            solver,
            q=q,
            certificate=certificate,
            stats=stats,
            rejected=tuple(self.rejected),
            stages=self.log.stages,
            cuboids=None if found is None else found.cuboids,
            free_space=None if found is None else found.free_space,
            **measured,
        )
