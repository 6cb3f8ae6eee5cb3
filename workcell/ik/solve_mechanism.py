"""`solve_mechanism` and `closest_configuration`: answers about a mechanism, judged and with proofs re-checked."""

from __future__ import annotations

import time
from collections.abc import Mapping
from dataclasses import dataclass, replace
from types import MappingProxyType
from typing import Any

import numpy as np

from workcell import clock
from workcell.errors import UnknownNameError, WorkcellError
from workcell.ik.ikspark.mechanisms.forms import FormName
from workcell.ik.ikspark.mechanisms.solver import user_judge
from workcell.ik.mechanisms.check import check_cost, check_mechanism
from workcell.ik.mechanisms.hygiene import check_problem
from workcell.ik.mechanisms.judge import judge_mechanism
from workcell.ik.mechanisms.nearest import pose_cost, without_poses
from workcell.ik.mechanisms.problem import MechanismProblem
from workcell.ik.mechanisms.result import MechanismCandidate, MechanismResult
from workcell.ik.observing import report
from workcell.ik.problem import Budget
from workcell.ik.registry import AUTO, load
from workcell.ik.result import Status
from workcell.ik.stages import SolverStage, StageLog

MECHANISM_SOLVERS: Mapping[str, str] = MappingProxyType(
    {
        "ikspark": "workcell.ik.ikspark.mechanisms.solver:solve_mechanism_ikspark",
        "chains": "workcell.ik.branch.mechanisms:solve_mechanism_chains",
        "multistart": "workcell.ik.multistart.mechanisms:solve_mechanism_multistart",
    }
)
"""Solvers of mechanisms by name."""
CLOSEST_SOLVERS: Mapping[str, str] = MappingProxyType(
    {
        "ikspark": "workcell.ik.ikspark.mechanisms.minimising.closest:closest_mechanism",
        "multistart": "workcell.ik.multistart.closest:closest_multistart",
    }
)
"""Solvers by name that look for the configuration closest to goals."""
_ROUNDS = 12
_TURNS = (
    ("multistart", 0.05),
    ("ikspark", 0.3),
    ("chains", 0.3),
    *((name, 0.5 * 2**k) for k in range(_ROUNDS) for name in ("multistart", "ikspark", "chains")),
)
"""Turns of `auto`: whose, and how long in seconds of work on a quiet core."""


def mechanism_solver_names() -> tuple[str, ...]:
    """Names that `solve_mechanism` takes."""
    return AUTO, *MECHANISM_SOLVERS


def solve_mechanism(
    problem: MechanismProblem,
    *,
    solver: str = "ikspark",
    budget: Budget | None = None,
    seed: int = 0,
    form: FormName = "quaternion",
) -> MechanismResult:
    """Answer a question about a mechanism.

    Args:
        problem: the question.
        solver: `ikspark` (convex, with proofs), `chains` (branch and bound on serial chains between the world and the
            goals, with proofs), `multistart` (local search from random starts), or `auto`: in turns.
        budget: CPU seconds and work; default `Budget()`. Zero: NOT_FOUND at once.
        seed: same problem, solver and seed, same answer, as far as the budget reaches.
        form: of ikspark's lift of rotations: `quaternion` (4x4) or `rotation` (7x7).

    Returns:
        `SOLVED` only with a configuration that the judge accepted, on the compiled model where there is one;
        `UNREACHABLE` only with a re-checked certificate; else `NOT_FOUND` or `SOLVER_ERROR`.

    Raises:
        UnknownNameError: no such solver. InputError: goals, regions or users' constraints that make no sense, by name.
        ModelError: ties that contradict each other, or a model that can't be measured.
    """
    if solver not in mechanism_solver_names():
        raise UnknownNameError("solver", solver, mechanism_solver_names(), where="solver")
    notes = check_problem(problem)
    budget = budget or Budget()
    turns = _TURNS if solver == AUTO else ((solver, float("inf")),)
    result = _Turns(problem, solver, budget, seed, form, notes).run(turns)
    report(problem, result)
    return result


def closest_configuration(
    problem: MechanismProblem,
    *,
    solver: str = "ikspark",
    budget: Budget | None = None,
    seed: int = 0,
    form: FormName = "quaternion",
) -> MechanismResult:
    """The configuration whose poses are closest to goals that need not be within reach, by Eq. 36's cost.

    Positions and rotations of the goals are the cost: the sum of their squared errors, metres and entries of rotations.
    All else has to hold: ties, limits, directions, regions, users' constraints, clearances.

    Args:
        problem: the question.
        solver: `ikspark` (convex, with a bound), `multistart` (local search from random starts), or `auto`: both.
        budget, seed, form: as of `solve_mechanism`.

    Returns:
        `SOLVED` with a configuration of which the judge accepted all but its poses; `measured` has their errors, `cost`
        the cost, and `bound` what a re-checked proof says that no configuration is below (zero without one).
        `UNREACHABLE` only where a re-checked certificate says that nothing keeps all the rest.

    Raises:
        As `solve_mechanism`.
    """
    names = tuple(CLOSEST_SOLVERS) if solver == AUTO else (solver,)
    if not set(names) <= set(CLOSEST_SOLVERS):
        raise UnknownNameError("solver", solver, (AUTO, *CLOSEST_SOLVERS), where="solver")
    notes = check_problem(without_poses(problem))
    result = _Closest(problem, budget or Budget(), seed, form).run(solver, names, notes)
    report(problem, result)
    return result


@dataclass(slots=True)
class _Closest:
    """Asks solvers one after the other for the closest configuration, and keeps the best that holds."""

    problem: MechanismProblem
    budget: Budget
    seed: int
    form: FormName

    def run(self, solver: str, names: tuple[str, ...], notes: tuple[str, ...]) -> MechanismResult:
        """The best of all candidates that the judge accepts but for their poses."""
        cpu, wall = clock.cpu_seconds(), time.perf_counter()
        kept, stages, rejected, stats = (
            without_poses(self.problem),
            StageLog(),
            list(notes),
            dict[str, float](),
        )
        best: tuple[float, Any, str] | None = None
        bound, certificate, errors = 0.0, None, 0
        for left, name in zip(range(len(names), 0, -1), names, strict=True):
            spent = clock.cpu_seconds() - cpu
            budget = replace(self.budget, cpu_s=max(self.budget.cpu_s - spent, 0.0)).shared(left)
            budget = replace(budget, effort=self.budget.shared(len(names)).effort)
            before = clock.cpu_seconds()
            candidate = _guarded(
                CLOSEST_SOLVERS[name], self.problem, budget, self.seed, **self._options(name)
            )
            stages.extend(candidate.stages, name, clock.cpu_seconds() - before)
            stats |= {f"{name}.{key}": float(value) for key, value in candidate.stats.items()}
            rejected += candidate.rejected
            if candidate.error is not None:
                errors += 1
                rejected.append(f"{name} failed: {candidate.error}")
            if candidate.bound_certificate is not None:
                bound = max(bound, check_cost(self.problem, candidate.bound_certificate) or 0.0)
            if candidate.certificate is not None and check_mechanism(kept, candidate.certificate) is None:
                certificate = candidate.certificate
                break
            if candidate.q is not None:
                cost = pose_cost(self.problem, candidate.q)
                measured = judge_mechanism(kept, candidate.q, user_judge(self.problem))
                stages.add("verify", note="; ".join(measured.reasons) or "accepted", solver=name)
                rejected += measured.reasons
                if measured.accepted and (best is None or cost < best[0]):
                    best = cost, candidate.q, name
        status = Status.NOT_FOUND if errors < len(names) else Status.SOLVER_ERROR
        stats |= {"cpu_s": clock.cpu_seconds() - cpu, "time_s": time.perf_counter() - wall}
        common: dict[str, Any] = {
            "bound": bound,
            "stats": stats,
            "rejected": tuple(dict.fromkeys(rejected)),
            "stages": stages.stages,
        }
        if best is None:
            status = status if certificate is None else Status.UNREACHABLE
            return MechanismResult(status, solver, certificate=certificate, **common)
        cost, q, by = best
        measured = judge_mechanism(self.problem, q, user_judge(self.problem))
        held = judge_mechanism(kept, q, user_judge(self.problem))
        measured = replace(measured, reasons=held.reasons)
        return MechanismResult(Status.SOLVED, by, q=q, measured=measured, cost=cost, **common)

    def _options(self, name: str) -> dict[str, Any]:
        return {"form": self.form} if name == "ikspark" else {"user": user_judge(self.problem)}


def _guarded(
    where: str, problem: MechanismProblem, budget: Budget, seed: int, **options: Any
) -> MechanismCandidate:
    """A solver's candidate; whatever numerical failure happens inside becomes its `error`."""
    try:
        with np.errstate(all="ignore"):
            found: MechanismCandidate = load(where)(problem, budget, seed, **options)
            return found
    except WorkcellError:
        raise
    except Exception as error:
        return MechanismCandidate(error=f"{type(error).__name__}: {error}")
    except BaseException as error:
        # a panic in Clarabel's Rust code arrives outside the Exception hierarchy
        if type(error).__name__ != "PanicException":
            raise
        return MechanismCandidate(error=f"the conic solver panicked: {error}")


@dataclass(slots=True)
class _Turns:
    """Runs solvers until one gives an answer that holds; remembers what the others said."""

    problem: MechanismProblem
    name: str
    budget: Budget
    seed: int
    form: FormName
    notes: tuple[str, ...]

    def run(self, turns: tuple[tuple[str, float], ...]) -> MechanismResult:
        """The first answer that holds."""
        cpu, wall = clock.cpu_seconds(), time.perf_counter()
        stages, rejected, stats = StageLog(), list[str](self.notes), dict[str, float]()
        errors, completed = 0, 0
        effort = np.inf if self.budget.effort is None else self.budget.effort

        def answer(status: Status, solver: str, **more: Any) -> MechanismResult:
            spent = {"cpu_s": clock.cpu_seconds() - cpu, "time_s": time.perf_counter() - wall}
            return MechanismResult(
                status,
                solver,
                stats={**stats, **spent},
                rejected=tuple(dict.fromkeys(rejected)),
                stages=stages.stages,
                **more,
            )

        for order, (name, share) in enumerate(turns):
            left = self.budget.cpu_s - (clock.cpu_seconds() - cpu)
            work = min(share, effort)
            if left <= 0 or work <= 0:
                break
            effort -= work
            budget = replace(self.budget, cpu_s=left, effort=work if np.isfinite(work) else None)
            before = clock.cpu_seconds()
            candidate = self._call(name, budget, self.seed + 7919 * order)
            spent = clock.cpu_seconds() - before
            stages.extend(
                candidate.stages or (SolverStage(name, spent, numbers=candidate.stats),), name, spent
            )
            for key, value in {**candidate.stats, "cpu_s": spent}.items():
                stats[f"{name}.{key}"] = stats.get(f"{name}.{key}", 0.0) + float(value)
            rejected += candidate.rejected
            errors += candidate.error is not None
            completed += candidate.error is None
            if candidate.error is not None:
                rejected.append(f"{name} failed: {candidate.error}")
            if candidate.q is not None:
                measured = judge_mechanism(self.problem, candidate.q, user_judge(self.problem))
                stages.add("verify", note="; ".join(measured.reasons) or "accepted", solver=name)
                if measured.accepted:
                    return answer(Status.SOLVED, candidate.by or name, q=candidate.q, measured=measured)
                rejected.append(f"{name}'s configuration was refused: {'; '.join(measured.reasons)}")
            if candidate.certificate is not None:
                refusal = check_mechanism(self.problem, candidate.certificate)
                stages.add("check of the proof", note=refusal or "it holds", solver=name)
                if refusal is None:
                    return answer(Status.UNREACHABLE, name, certificate=candidate.certificate)
                rejected.append(f"{name}'s certificate was refused: {refusal}")
        failed = errors and not completed
        return answer(Status.SOLVER_ERROR if failed else Status.NOT_FOUND, self.name)

    def _call(self, name: str, budget: Budget, seed: int) -> MechanismCandidate:
        options: dict[str, Any] = {}
        if name == "ikspark":
            options = {"form": self.form}
        elif name == "multistart":
            options = {"user": user_judge(self.problem)}
        return _guarded(MECHANISM_SOLVERS[name], self.problem, budget, seed, **options)
