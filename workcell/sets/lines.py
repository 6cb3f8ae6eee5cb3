"""JSON lines about the problems of a set: read with what is wrong with each, and re-checked one by one."""

from __future__ import annotations

import json
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Protocol, TypeVar

from workcell.errors import InputError
from workcell.files import parse_json, regular_text
from workcell.sets.problems import NamedProblem, ProblemSet


@dataclass(frozen=True, slots=True)
class Line:
    """A line of a file: its number, and the JSON value that stands there, or why there is none."""

    number: int
    value: Any = None
    fault: str | None = None


class Claim(Protocol):
    """What a line says of a problem."""

    @property
    def id(self) -> str:
        """Which problem it is about."""
        ...


class Report(Protocol):
    """What a re-check writes into, whatever is claimed."""

    unanswered: int
    refused: list[str]


ClaimT = TypeVar("ClaimT", bound=Claim)


def read_lines(file: Path) -> Iterator[Line]:
    """The lines of a file that are not blank, in order.

    Raises:
        InputError: the file can't be read, or is not text. A line that is no JSON comes with its fault.
    """
    try:
        texts = regular_text(file).split("\n")
    except OSError as error:
        raise InputError(f"can't be read: {error.strerror}", where=file) from None
    except UnicodeDecodeError:
        raise InputError("is not a text file", where=file, remedy="a file of JSON lines") from None
    for number, text in enumerate(texts, start=1):
        if text.strip():
            yield _line(number, text)


def _line(number: int, text: str) -> Line:
    try:
        return Line(number, parse_json(text))
    except json.JSONDecodeError as error:
        return Line(number, fault=f"is not JSON ({error.msg}, column {error.colno})")
    except ValueError as error:
        return Line(number, fault=str(error))


def recheck(
    problem_set: ProblemSet,
    file: Path,
    report: Report,
    parse: Callable[[Any], ClaimT],
    judge: Callable[[NamedProblem, ClaimT], str | None],
) -> None:
    """Judge every line of a file, each problem once; what is refused goes into `report`, by the line's number.

    Args:
        problem_set: the problems that the lines are about.
        file: of JSON lines.
        report: gets the refusals; a problem whose line is refused stays unanswered.
        parse: what a line's JSON value claims, or InputError where it claims nothing that can be judged.
        judge: why a claim about a problem is refused; None where it holds, and is counted by the judge.

    Raises:
        InputError: the file can't be read, or is not text.
    """
    problems = {named.id: named for named in problem_set.problems}
    seen: set[str] = set()

    def refusal(line: Line) -> str | None:
        if line.fault is not None:
            return line.fault
        try:
            claim = parse(line.value)
        except InputError as error:
            return str(error)
        if claim.id not in problems:
            return f"the set has no problem {claim.id!r}"
        if claim.id in seen:
            return f"a second answer to {claim.id!r}"
        seen.add(claim.id)
        reason = judge(problems[claim.id], claim)
        if reason is None:
            return None
        report.unanswered += 1
        return f"{claim.id}: {reason}"

    for line in read_lines(file):
        reason = refusal(line)
        if reason is not None:
            report.refused.append(f"line {line.number}: {reason}")
