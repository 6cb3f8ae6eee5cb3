"""Path files: one JSON line a problem; written by `workcell plan`, re-checked by `workcell verify`."""

from __future__ import annotations

import json
from collections.abc import Iterator
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np

from workcell.errors import InputError
from workcell.ik.result import Status
from workcell.motion.plans.to_pose import PosePlan
from workcell.motion.proofs.judge import judge_path
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
    for _, document in _documents(file):
        if isinstance(document, dict):
            return "path" in document
    return False


def verify_paths(problem_set: ProblemSet, file: Path) -> PathReport:
    """Re-check the paths of a file: start, goal, limits, and a proof that they are clear, all without any planner.

    Raises:
        InputError: the file can't be read. Lines that are no paths are refused in the report, by number.
    """
    problems = {named.id: named for named in problem_set.problems}
    report = PathReport(len(problems))
    seen: set[str] = set()
    for number, document in _documents(file):
        identity = document.get("id") if isinstance(document, dict) else None
        if isinstance(document, str):
            reason: str | None = document
        elif not isinstance(identity, str):
            reason = 'is not a JSON object with the key "id"'
        elif identity not in problems:
            reason = f"the set has no problem {identity!r}"
        elif identity in seen:
            reason = f"a second answer to {identity!r}"
        else:
            seen.add(identity)
            reason = _judge(problems[identity], document, report)
            if reason is not None:
                report.unanswered += 1
                reason = f"{identity}: {reason}"
        if reason is not None:
            report.refused.append(f"line {number}: {reason}")
    return report


def _judge(named: NamedProblem, document: dict[str, Any], report: PathReport) -> str | None:
    """Why a line is refused; None: counted in the report."""
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


def _documents(file: Path) -> Iterator[tuple[int, Any]]:
    """Line numbers and what stands there; a line that is no JSON comes as the reason, a text."""
    try:
        lines = file.read_text(encoding="utf-8").splitlines()
    except OSError as error:
        raise InputError(f"can't be read: {error.strerror}", where=file) from None
    except UnicodeDecodeError:
        raise InputError("is not a text file", where=file, remedy="a file of JSON lines") from None
    for number, text in enumerate(lines, start=1):
        if not text.strip():
            continue
        try:
            document = json.loads(text)
        except json.JSONDecodeError as error:
            yield number, f"is not JSON ({error.msg}, column {error.colno})"
        except RecursionError:
            yield number, "is nested too deeply"
        else:
            yield number, {} if isinstance(document, str) else document
