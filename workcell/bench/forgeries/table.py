"""How many of thousands of forged certificates the checker accepts: none may be."""

from __future__ import annotations

import json
import tempfile
from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from workcell.bench.forgeries.honest import Case, cases
from workcell.bench.forgeries.mutants import CHANGES, Document, forged
from workcell.bench.forgeries.tally import Tally
from workcell.bench.rows import Bench, Row
from workcell.errors import WorkcellError
from workcell.ik.certificate import Certificate
from workcell.ik.check import check_certificate
from workcell.ik.problem import IKProblem
from workcell.proofs.exact.problems import Problem, read_problems
from workcell.proofs.exact.reading import RefusedError, parse
from workcell.proofs.exact.verdicts import check

CLAIMS = 0.15
"""Share of forgeries that are handed in for the problem that they hold of, and claim more than is proved of it."""


@dataclass(frozen=True, slots=True)
class Forgery:
    """A certificate that proves nothing, as text, and whose problem it is handed in for.

    Attributes:
        case: what it was made from.
        change: how.
        own: whether it is handed in for the problem that it was made for, claiming more than is proved of it; else for
            the twin, of which all of it is false.
        text: the certificate's file.
    """

    case: Case
    change: str
    own: bool
    text: str


def forgeries(n: int, seed: int) -> Iterator[Forgery]:
    """`n` of them, of every case and by every change in turn."""
    rng, every = np.random.default_rng(seed), cases()
    borrowed = [case.borrowed() for case in every]
    changes = list(CHANGES)
    for k in range(n):
        case, change = every[k % len(every)], changes[(k // len(every)) % len(changes)]
        if rng.random() < CLAIMS:
            yield Forgery(case, "a_claim", True, json.dumps(_claimed(case, rng)))
            continue
        others = [document for j, document in enumerate(borrowed) if j != k % len(every)]
        yield Forgery(case, change, False, forged(borrowed[k % len(every)], change, rng, others))


def _claimed(case: Case, rng: np.random.Generator) -> Document:
    """An honest certificate that says more, or less, than its numbers show."""
    document: Document = json.loads(json.dumps(case.certificate))
    choice = int(rng.integers(3))
    if choice == 0:
        document["margin"] = float(document["margin"]) * float(
            rng.choice([0.0, -1.0, 0.99, 1.01, 1e-9, 1e9, 1e300])
        )
    elif choice == 1:
        other = [scope for scope in ("kinematics", "geometry", "model") if scope != document["scope"]]
        document["scope"] = other[int(rng.integers(2))]
    else:
        words = document["statement"]
        at = int(rng.integers(len(words)))
        document["statement"] = words[:at] + "~" + words[at + 1 :]
    return document


def refusal(problem: IKProblem, text: str) -> str | None:
    """Why a certificate's text proves nothing of a problem, or None: then it is taken for a proof."""
    try:
        certificate = Certificate.from_json(text)
    except WorkcellError as error:
        return str(error)
    return check_certificate(problem, certificate)


def exact_refusal(problem: Problem, text: str) -> str | None:
    """The same by the second checker."""
    try:
        check(problem, parse(text))
    except RefusedError as error:
        return str(error)
    return None


def forgery_rows(n: int, seed: int, sets: Path | None) -> list[Row]:
    """One row a kind of proof, see `Tally`: what the first checker makes of `n` forgeries."""
    problems = {(case.name, own): case.problem(own=own) for case in cases() for own in (True, False)}
    return _rows(n, seed, "forgeries", refusal, problems)


def exact_rows(n: int, seed: int, sets: Path | None) -> list[Row]:
    """The same of the second checker."""
    documents = {
        (case.name, own): case.own if own else case.twin for case in cases() for own in (True, False)
    }
    problems = {key: _exact_problem(document) for key, document in documents.items()}
    return _rows(n, seed, "forgeries-exact", exact_refusal, problems)


def _rows(
    n: int,
    seed: int,
    name: str,
    checker: Callable[[Any, str], str | None],
    problems: Mapping[tuple[str, bool], Any],
) -> list[Row]:
    tallies: dict[str, Tally] = {}
    for forgery in forgeries(n, seed):
        tally = tallies.setdefault(str(forgery.case.certificate["kind"]), Tally())
        tally.hand_in(
            f"{forgery.case.name}, {forgery.change}: ",
            forgery.text,
            checker,
            problems[forgery.case.name, forgery.own],
        )
    return [tallies[kind].row(f"{name}/{kind}") for kind in sorted(tallies)]


def _exact_problem(document: Document) -> Problem:
    with tempfile.TemporaryDirectory() as folder:
        file = Path(folder) / "set.json"
        file.write_text(json.dumps(document), encoding="utf-8")
        return read_problems(file)["one"]


BENCHES = (
    Bench(
        "forgeries",
        10_000,
        "certificates that prove nothing: how many are accepted (none may be)",
        forgery_rows,
    ),
    Bench("forgeries-exact", 1_000, "the same, handed to the second checker", exact_rows),
)
