"""Runs whole problem sets, and re-checks answers without any solver."""

from __future__ import annotations

import functools
import hashlib
import time
from collections import Counter
from collections.abc import Callable, Mapping
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np

from workcell.ik.certificate import Certificate
from workcell.ik.check import STATUS_OF_SCOPE, check_certificate
from workcell.ik.judge.verify import verify
from workcell.ik.problem import Budget
from workcell.ik.registry import AUTO
from workcell.ik.result import IKResult, Status
from workcell.ik.solution.issue import certify_solution
from workcell.ik.solve import check_solver_name, solve
from workcell.proofs.exact.verdicts import Verdict
from workcell.sets.answers import Answer, answer_line, certificate_folder, parse_answer
from workcell.sets.lines import recheck
from workcell.sets.problems import NamedProblem, ProblemSet
from workcell.sets.reports import SolveSummary, VerifyReport
from workcell.sets.workers import output_file, run_lines, write_line

Progress = Callable[[], object]


def problem_seed(seed: int, identity: str) -> int:
    """The seed of one problem: it depends on the run's seed and the problem's id alone, not on order or processes."""
    return int.from_bytes(hashlib.sha256(f"{seed}:{identity}".encode()).digest()[:4], "big")


def solve_set(
    problem_set: ProblemSet,
    *,
    solver: str = AUTO,
    budget: Budget | None = None,
    seed: int = 0,
    jobs: int = 1,
    out: Path | None = None,
    progress: Progress | None = None,
) -> SolveSummary:
    """Solve every problem of a set.

    Args:
        problem_set: as `load_problem_set` reads it.
        solver: a name that `workcell.ik.solve.solve` takes.
        budget: CPU seconds a problem.
        seed: of the run; each problem has its own, derived from it and the id.
        jobs: processes.
        out: JSON lines, one a problem in the set's order. They are written to `<out>.partial` as they are found
            and renamed at the end: an earlier file stays until then, and an interrupted run leaves the partial one.
        progress: called after every problem.

    Raises:
        UnknownNameError: no such solver. OutputError: `out` can't be written.
        KeyboardInterrupt: interrupted; its message says where the answers so far are.
    """
    check_solver_name(solver)
    started = time.perf_counter()
    task = _Task(
        problem_set.problems,
        solver,
        budget or Budget(),
        seed,
        None if out is None else certificate_folder(out),
    )
    statuses, solvers, cpu = Counter[str](), Counter[str](), []
    with output_file(out) as file:
        for line in run_lines(task, jobs):
            if file is not None:
                write_line(file, line)
            statuses[line["status"]] += 1
            if line["status"] not in (Status.NOT_FOUND.value, Status.SOLVER_ERROR.value):
                solvers[line["solver"]] += 1
            cpu.append(line["cpu_s"])
            if progress is not None:
                progress()
    return SolveSummary(
        problem_set.name,
        problem_set.robot.name,
        solver,
        seed,
        dict(statuses),
        dict(solvers),
        tuple(cpu),
        time.perf_counter() - started,
    )


def verify_answers(
    problem_set: ProblemSet, answers: Path, second: Mapping[str, Verdict] | None = None
) -> VerifyReport:
    """Re-check configurations and certificates of an answer file, without any solver.

    Args:
        problem_set: the problems.
        answers: JSON lines.
        second: what the exact checker says (`second_opinions`); where it was asked, both have to accept.

    Raises:
        InputError: the file can't be read. Lines that are no answers are refused in the report, by number.
    """
    report = VerifyReport(len(problem_set.problems))
    parse = functools.partial(parse_answer, folder=answers.parent)
    recheck(problem_set, answers, report, parse, functools.partial(_judge_twice, report, second or {}))
    return report


def _judge_twice(
    report: VerifyReport, second: Mapping[str, Verdict], named: NamedProblem, answer: Answer
) -> str | None:
    """Why one of the two checkers refuses an answer, and whether they agree."""
    other = second.get(named.id)
    if other is None or not other.asked:
        return _judge(report, named, answer)
    if other.refusal is None:
        reason = _judge(report, named, answer)
        report.twice += reason is None
        return None if reason is None else f"{reason} (the exact checker accepts it)"
    reason = _judge(VerifyReport(0), named, answer)
    if reason is None:
        return f"the exact checker refuses what the first accepts: {other.refusal}"
    return f"{reason} (the exact checker: {other.refusal})"


def _judge(report: VerifyReport, named: NamedProblem, answer: Answer) -> str | None:
    """Why an answer is refused; None: counted in the report."""
    if answer.status is Status.SOLVED:
        return _judge_configuration(named, answer, report)
    if not answer.status.is_proof:
        report.unanswered += 1
        return None
    reason = _judge_proof(named, answer)
    report.proved += reason is None
    return reason


def _judge_configuration(named: NamedProblem, answer: Answer, report: VerifyReport) -> str | None:
    if answer.q is None:
        return "claims SOLVED without a configuration"
    verdict = verify(named.problem, answer.q)
    if not verdict.accepted:
        return "; ".join(verdict.reasons)
    if answer.certificate is not None:
        refusal = _refused_box(named, answer, answer.certificate)
        if refusal is not None:
            return f"the certificate does not hold: {refusal}"
        report.certified += 1
    report.solved += 1
    report.position_error = max(report.position_error, verdict.position_error)
    report.rotation_error = max(report.rotation_error, verdict.rotation_error)
    report.clearance = min(report.clearance, verdict.clearance.distance)
    return None


def _refused_box(named: NamedProblem, answer: Answer, certificate: Certificate) -> str | None:
    """Why the certificate of a solution does not hold or is not about the answer's configuration, or None."""
    if STATUS_OF_SCOPE[certificate.scope] is not Status.SOLVED:
        return f"the answer is SOLVED, the certificate about {certificate.scope!r}"
    refusal = check_certificate(named.problem, certificate)
    if refusal is None and not np.array_equal(certificate.data["middle"], np.array(answer.q, dtype=float)):
        return "it is about another configuration"
    return refusal


def _judge_proof(named: NamedProblem, answer: Answer) -> str | None:
    if answer.certificate is None:
        return f"claims {answer.status.value} without a certificate"
    if STATUS_OF_SCOPE[answer.certificate.scope] is not answer.status:
        return f"claims {answer.status.value}, but the certificate is about {answer.certificate.scope!r}"
    refusal = check_certificate(named.problem, answer.certificate)
    return None if refusal is None else f"the certificate does not hold: {refusal}"


@dataclass(frozen=True, slots=True)
class _Task:
    """What a worker process needs."""

    problems: tuple[NamedProblem, ...]
    solver: str
    budget: Budget
    seed: int
    certificates: Path | None

    def __len__(self) -> int:
        return len(self.problems)

    def line(self, index: int) -> dict[str, Any]:
        named = self.problems[index]
        problem = named.problem if named.start is None else replace(named.problem, q_near=named.start)
        result: IKResult = solve(problem, self.solver, self.budget, problem_seed(self.seed, named.id))
        own = certify_solution(named.problem, result.q) if result.solved and result.q is not None else None
        return answer_line(named.id, result, self.certificates, own)
