"""Path files: one JSON line a problem; written by `workcell plan`, re-checked by `workcell verify`."""

from __future__ import annotations

import functools
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np

from workcell.errors import InputError
from workcell.ik.result import Status
from workcell.motion.plans.to_pose import PosePlan
from workcell.motion.proofs.judge import judge_path
from workcell.sets.lines import read_lines, recheck
from workcell.sets.problems import NamedProblem, ProblemSet


@dataclass(slots=True)
class PathReport:
    """What a re-check of paths came to: how many hold, and which were refused, why."""

    problems: int
    solved: int = 0
    unanswered: int = 0
    refused: list[str] = field(default_factory=list)
    clearance: float = float("inf")
    bound: float = float("inf")
    length: float = 0.0
    looks: int = 0

    @property
    def missing(self) -> int:
        """Problems without a line."""
        return self.problems - self.solved - self.unanswered

    def to_json(self) -> dict[str, Any]:
        """A plain dictionary; clearances are the worst of the accepted paths, the length is their mean."""
        return {
            "problems": self.problems,
            "paths": self.solved,
            "unanswered": self.unanswered,
            "missing": self.missing,
            "refused": list(self.refused),
            "min_clearance_m": self.clearance if np.isfinite(self.clearance) else None,
            "proved_clearance_m": self.bound if np.isfinite(self.bound) else None,
            "mean_length_rad": self.length / self.solved if self.solved else None,
            "configurations": self.looks,
        }

    def rows(self) -> list[tuple[str, object]]:
        """(label, value) for a table."""
        figures = self.to_json()
        figures["refused"] = len(self.refused)
        return [(name.replace("_", " "), value) for name, value in figures.items()]


def path_line(identity: str, plan: PosePlan, duration_s: float | None) -> dict[str, Any]:
    """The JSON object of one path; lengths in radians, those of optimising only where it was asked for."""
    stats = plan.stats if plan.path is not None else {}
    return {
        "id": identity,
        "status": plan.status.value,
        "path": None if plan.path is None else [[float(value) for value in q] for q in plan.path],
        "proved": plan.proved,
        "time_s": round(plan.stats["time_s"], 6),
        "cpu_s": round(plan.stats["cpu_s"], 6),
        "duration_s": duration_s,
        "length_rad": stats.get("length"),
        "first_length_rad": stats.get("first_length"),
        "lower_bound_rad": stats.get("lower_bound"),
        "margin_m": plan.margin if plan.proved else None,
        "reason": plan.reason,
    }


def holds_paths(file: Path) -> bool:
    """Whether a file of JSON lines is one of paths: its first line that is an object has the key "path".

    Raises:
        InputError: the file can't be read, or is not text.
    """
    for line in read_lines(file):
        if isinstance(line.value, dict):
            return "path" in line.value
    return False


def verify_paths(problem_set: ProblemSet, file: Path) -> PathReport:
    """Re-check the paths of a file: start, goal, limits, and a proof that they are clear, all without any planner.

    Raises:
        InputError: the file can't be read. Lines that are no paths are refused in the report, by number.
    """
    report = PathReport(len(problem_set.problems))
    recheck(problem_set, file, report, _parse, functools.partial(_judge, report))
    return report


@dataclass(frozen=True, slots=True)
class _Claim:
    """A line that names a problem; all else that it says is looked at when it is judged."""

    id: str
    document: dict[str, Any]


def _parse(document: Any) -> _Claim:
    identity = document.get("id") if isinstance(document, dict) else None
    if not isinstance(identity, str):
        raise InputError('is not a JSON object with the key "id"')
    return _Claim(identity, document)


def _judge(report: PathReport, named: NamedProblem, claim: _Claim) -> str | None:
    """Why a path is refused; None: counted in the report."""
    document = claim.document
    path, status = document.get("path"), document.get("status")
    known = [item.value for item in Status]
    if status is None:
        status = Status.NOT_FOUND.value if path is None else Status.SOLVED.value
    if status not in known:
        return f"unknown status {status!r} ({', '.join(known)})"
    if status != Status.SOLVED.value:
        if document.get("proved"):
            return f"claims a proof of a path, with status {status}"
        report.unanswered += 1
        return None
    if path is None:
        return "claims SOLVED without a path"
    if named.start is None:
        return "the problem has no start, so no path can be right"
    verdict = judge_path(named.problem, named.start, path)
    if not verdict.accepted:
        return verdict.reason
    report.solved += 1
    report.clearance = min(report.clearance, verdict.clearance.distance)
    report.bound = min(report.bound, verdict.bound)
    report.length += verdict.length
    report.looks += verdict.looks
    return None
