"""What the checker says of one certificate, and of every line of a file of answers."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from workcell.proofs.exact.certificates import Certificate, Claim, compare, read_certificate
from workcell.proofs.exact.convex.cidgik import cidgik
from workcell.proofs.exact.convex.farkas import farkas
from workcell.proofs.exact.elementary import last_link, reach
from workcell.proofs.exact.kinematics import check_configuration
from workcell.proofs.exact.problems import Problem, read_problems
from workcell.proofs.exact.reading import MOST_BYTES, RefusedError, doubles, member, parse, read_text
from workcell.proofs.exact.solution import solution
from workcell.proofs.exact.tree.rules import branch

RULES: dict[str, Callable[[Problem, Certificate], Claim]] = {
    "reach": reach,
    "last_link": last_link,
    "branch": branch,
    "farkas/2": farkas,
    "cidgik/2": cidgik,
    "solution": solution,
}
RETIRED = ("farkas", "cidgik")
SCOPE_OF_STATUS = {"UNREACHABLE": "kinematics", "BLOCKED": "geometry", "SOLVED": "solution"}
UNDECIDED = ("NOT_FOUND", "SOLVER_ERROR")


@dataclass(frozen=True, slots=True)
class Verdict:
    """Of one line of an answer file.

    Attributes:
        line: its number, from 1.
        id: of the problem; empty where the line does not say.
        status: what it claims.
        refusal: why it is refused; None where it holds, or nothing was asked.
        asked: whether something was checked: not where nothing is claimed, or trees were left out.
    """

    line: int
    id: str
    status: str
    refusal: str | None
    asked: bool = True


def check(problem: Problem, document: object) -> Certificate:
    """A certificate that holds of a problem.

    Raises:
        RefusedError: it does not; the message says why.
    """
    certificate = read_certificate(document)
    if certificate.kind in RETIRED:
        raise RefusedError(f"the kind {certificate.kind!r} is no longer proof: ask the solver again")
    if certificate.kind not in RULES:
        raise RefusedError(f"there is no kind {certificate.kind!r}: {', '.join(RULES)}")
    compare(certificate, RULES[certificate.kind](problem, certificate))
    return certificate


def judge_answers(set_file: Path, answers: Path, *, trees: bool = True) -> Iterator[Verdict]:
    """What holds of a file of answers, line by line; without `trees`, proofs of the kind `branch` are left out.

    Raises:
        RefusedError: one of the files can't be read.
    """
    problems = read_problems(set_file)
    seen: set[str] = set()
    for number, text in enumerate(read_text(answers, MOST_BYTES).split("\n"), 1):
        if not text.strip():
            continue
        identity, status = "", ""
        try:
            line = parse(text)
            identity = member(line, "id", str, "the line")
            status = line.get("status", "NOT_FOUND" if line.get("q") is None else "SOLVED")
            if identity in seen:
                raise RefusedError("a second answer to one problem")
            seen.add(identity)
            if identity not in problems:
                raise RefusedError("the set has no such problem")
            asked = _judge(problems[identity], line, status, answers.parent, trees)
        except RefusedError as refusal:
            yield Verdict(number, identity, str(status), str(refusal))
        else:
            yield Verdict(number, identity, status, None, asked)


def _judge(problem: Problem, line: dict[str, Any], status: object, folder: Path, trees: bool) -> bool:
    """Whether something was checked; raises `RefusedError` where it does not hold."""
    if status in UNDECIDED:
        return False
    if not isinstance(status, str) or status not in SCOPE_OF_STATUS:
        raise RefusedError(f"the status {status!r} can't be proved: {', '.join(SCOPE_OF_STATUS)}")
    document = line.get("certificate")
    if status == "SOLVED":
        q = doubles(line.get("q"), len(problem.arm.joints), "q")
        check_configuration(problem, q)
        if document is None:
            return True
    elif document is None:
        raise RefusedError(f"{status} without a certificate")
    if isinstance(document, str):
        document = parse(read_text(folder / document, MOST_BYTES))
    if not trees and isinstance(document, dict) and document.get("kind") == "branch":
        return False
    certificate = check(problem, document)
    if certificate.scope != SCOPE_OF_STATUS[status]:
        raise RefusedError(f"{status}, and the certificate is about {certificate.scope!r}")
    if status == "SOLVED" and certificate.data["middle"].values != q:
        raise RefusedError("the certificate is about another configuration")
    return True
