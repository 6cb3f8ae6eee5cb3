"""`verify`: whether answers hold, and what their proofs say."""

from __future__ import annotations

import argparse
import textwrap
from collections.abc import Iterator
from pathlib import Path
from typing import TYPE_CHECKING

from workcell.cli import exit_codes
from workcell.cli.output import print_json, print_table, progress_bar, tell
from workcell.errors import InputError

if TYPE_CHECKING:
    from workcell.ik.certificate import Certificate
    from workcell.ik.explain.proof import ProofInWords
    from workcell.sets.problems import ProblemSet

_MOST_SHOWN = 20
_WIDTH = 100


def verify(options: argparse.Namespace) -> int:
    """Re-check answers or paths, or show proofs in words; exit 1 when one was refused."""
    if options.explain is not None:
        return _explain(options)
    if options.set is None or options.answers is None:
        raise InputError(
            "verify takes a problem set and its answers", where="verify", remedy="SET.json ANSWERS.jsonl"
        )
    from workcell.sets.paths import PathReport, holds_paths, verify_paths
    from workcell.sets.problems import load_problem_set
    from workcell.sets.reports import VerifyReport
    from workcell.sets.second_opinion import second_opinions
    from workcell.sets.solving import verify_answers

    problem_set, answers = load_problem_set(Path(options.set)), Path(options.answers)
    report: PathReport | VerifyReport
    if holds_paths(answers):
        report = verify_paths(problem_set, answers)
    else:
        with progress_bar(f"verify {answers.name}", len(problem_set)) as bar:
            second = second_opinions(Path(options.set), answers, trees=options.exact, progress=bar.step)
        report = verify_answers(problem_set, answers, second)
    if options.json:
        print_json(report.to_json())
    else:
        print_table(f"{Path(options.answers).name}", ["", "value"], report.rows())
        for line in report.refused[:20]:
            tell(f"refused: {line}")
        if len(report.refused) > 20:
            tell(f"... and {len(report.refused) - 20} more (all of them with --json)")
    return exit_codes.NOT_ACHIEVED if report.refused else exit_codes.DONE


def _explain(options: argparse.Namespace) -> int:
    from workcell.ik.explain.proof import in_words
    from workcell.sets.problems import load_problem_set

    if options.answers is not None:
        raise InputError(
            "--explain takes its file instead of ANSWERS.jsonl", where="verify", remedy="one of the two"
        )
    problem_set = None if options.set is None else load_problem_set(Path(options.set))
    told: list[tuple[str, ProofInWords]] = []
    for label, certificate in _certificates(Path(options.explain)):
        name = _owner(problem_set, label, certificate)
        problem = None
        if problem_set is not None:
            if name is None:
                raise InputError(
                    "the certificate belongs to no problem of the set",
                    where=options.explain,
                    remedy="its own set",
                )
            problem = next(item.problem for item in problem_set.problems if item.id == name)
        told.append((label or name or "", in_words(certificate, problem, name or "")))
    if not told:
        raise InputError("there is no certificate", where=options.explain)
    if options.json:
        print_json([{"id": label, **words.to_json()} for label, words in told])
    else:
        for label, words in told[:_MOST_SHOWN]:
            _show(label, words)
        if len(told) > _MOST_SHOWN:
            tell(f"... and {len(told) - _MOST_SHOWN} more (all of them with --json)")
    refused = any(words.refusal is not None for _, words in told)
    return exit_codes.NOT_ACHIEVED if refused else exit_codes.DONE


def _certificates(path: Path) -> Iterator[tuple[str, Certificate]]:
    """The certificates of a file, with the ids of the problems where it is one of answers.

    Raises:
        InputError: the file can't be read, or holds neither.
    """
    from workcell.ik.certificate import FORMAT, Certificate
    from workcell.sets.answers import parse_answer, read_certificate
    from workcell.sets.lines import read_lines

    lines = list(read_lines(path)) if path.is_file() else []
    if not (lines and isinstance(lines[0].value, dict) and "id" in lines[0].value):
        yield "", read_certificate(path)
        return
    for line in lines:
        if line.fault is not None:
            raise InputError(
                line.fault, where=f"{path}, line {line.number}", remedy=f"answers, or one {FORMAT}"
            )
        answer = parse_answer(line.value, path.parent)
        if isinstance(answer.certificate, Certificate):
            yield answer.id, answer.certificate


def _owner(problem_set: ProblemSet | None, label: str, certificate: Certificate) -> str | None:
    """The id of the problem that a certificate is about."""
    from workcell.ik.certificate import problem_hash

    if problem_set is None:
        return label or None
    for item in problem_set.problems:
        if item.id == label or (not label and problem_hash(item.problem) == certificate.problem_hash):
            return item.id
    return None


def _show(label: str, words: ProofInWords) -> None:
    tell(f"{label + ': ' if label else ''}a proof of kind {ascii(words.kind)[1:-1]}, for {words.status}")
    for what, text in words.lines:
        tell(textwrap.fill(text, _WIDTH, initial_indent=f"  {what:<12}", subsequent_indent=" " * 14))
