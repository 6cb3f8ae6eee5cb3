"""How many of thousands of forged certificates the checker accepts: none may be."""

from __future__ import annotations

import json
import time
from collections import Counter
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from workcell.bench.forgeries.honest import Case, cases
from workcell.bench.forgeries.mutants import CHANGES, Document, forged
from workcell.bench.rows import Bench, Row
from workcell.errors import WorkcellError
from workcell.ik.certificate import Certificate
from workcell.ik.check import check_certificate
from workcell.ik.problem import IKProblem

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


def forgery_rows(n: int, seed: int, sets: Path | None) -> list[Row]:
    """One row a kind of proof: forgeries handed in, accepted (none may be), errors that are no answers, seconds."""
    tried, accepted, crashed = Counter[str](), Counter[str](), Counter[str]()
    first: dict[str, str] = {}
    spent: dict[str, float] = {}
    problems = {(case.name, own): case.problem(own=own) for case in cases() for own in (True, False)}
    for forgery in forgeries(n, seed):
        kind = str(forgery.case.certificate["kind"])
        started = time.process_time()
        try:
            reason = refusal(problems[forgery.case.name, forgery.own], forgery.text)
        except Exception as error:  # whatever it is, it is no answer
            reason, crashed[kind] = repr(error), crashed[kind] + 1
            first.setdefault(kind, f"{forgery.change}: {error!r}")
        spent[kind] = spent.get(kind, 0.0) + time.process_time() - started
        tried[kind] += 1
        if reason is None:
            accepted[kind] += 1
            first.setdefault(kind, f"{forgery.case.name}, {forgery.change}: {forgery.text[:2000]}")
    return [
        _row(kind, tried[kind], accepted[kind], crashed[kind], first.get(kind), spent[kind])
        for kind in sorted(tried)
    ]


def _row(
    kind: str, tried: int, accepted: int, crashed: int, first: str | None, spent: float
) -> dict[str, Any]:
    return {
        "row": f"forgeries/{kind}",
        "n": tried,
        "accepted": accepted,
        "errors": crashed,
        "cpu_ms": 1e3 * spent / max(tried, 1),
        "first": first or "",
    }


BENCHES = (
    Bench(
        "forgeries",
        10_000,
        "certificates forged from scratch or by changes; none may be accepted",
        forgery_rows,
    ),
)
