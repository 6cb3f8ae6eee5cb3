"""Answer files: one JSON line a problem, with the proof of every "no".

A proof is inline or, when it is large, in a file beside it.
"""

from __future__ import annotations

import json
import math
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from workcell.errors import InputError, OutputError
from workcell.files import regular_text
from workcell.ik.certificate import Certificate
from workcell.ik.result import IKResult, Status

INLINE_NUMBERS = 4096
"""Certificates with more numbers than this go into a file of their own."""
LARGEST_FILE = 256 << 20
"""Bytes of a certificate's file that are read at most."""


@dataclass(frozen=True, slots=True)
class Answer:
    """What a line of an answer file claims."""

    id: str
    status: Status
    q: list[float] | None
    certificate: Certificate | None
    cpu_s: float


def answer_line(
    identity: str, result: IKResult, folder: Path | None, certificate: Certificate | None = None
) -> dict[str, Any]:
    """The JSON object of one answer.

    Args:
        identity: the problem's id.
        result: the answer.
        folder: where certificates are written that are too large for a line; None: they are inline.
        certificate: what goes with a solution; None: what the result has, if it has one.
    """
    solved = result.status is Status.SOLVED and result.q is not None
    return {
        "id": identity,
        "status": result.status.value,
        "q": [float(value) for value in result.q] if solved and result.q is not None else None,
        "time_s": round(float(result.stats.get("time_s", math.nan)), 6),
        "cpu_s": round(float(result.stats.get("cpu_s", math.nan)), 6),
        "solver": result.solver,
        "certificate": _certificate_entry(identity, certificate or result.certificate, folder),
        "rejected": list(result.rejected) if not solved else [],
    }


def _certificate_entry(identity: str, certificate: Certificate | None, folder: Path | None) -> Any:
    if certificate is None:
        return None
    document = certificate.to_json()
    if folder is None or sum(array.size for array in certificate.data.values()) <= INLINE_NUMBERS:
        return document
    name = "".join(letter if letter.isalnum() or letter in "-_" else "_" for letter in identity)
    path = folder / f"{name}-{certificate.problem_hash[:12]}.json"
    try:
        folder.mkdir(parents=True, exist_ok=True)
        path.write_text(json.dumps(document), encoding="utf-8")
    except OSError as error:
        raise OutputError(f"the certificate can't be written: {error.strerror}", where=path) from None
    return f"{folder.name}/{path.name}"


def certificate_folder(out: Path) -> Path:
    """Where the large certificates of an answer file stand."""
    return out.with_name(f"{out.stem}_certificates")


def parse_answer(document: Any, folder: Path) -> Answer:
    """What a line's JSON value claims; certificates in files of their own are looked for from `folder`.

    Raises:
        InputError: it is no answer, or its certificate can't be read.
    """
    if not isinstance(document, dict):
        raise InputError("is not a JSON object", remedy='{"id": ..., "status": ..., "q": ...}')
    identity = document.get("id")
    if not isinstance(identity, str):
        raise InputError('the key "id" is missing or not a text')
    q = document.get("q")
    if q is not None:
        _check_numbers(q, identity)
    known = [status.value for status in Status]
    name = document.get("status", Status.NOT_FOUND.value if q is None else Status.SOLVED.value)
    if name not in known:
        raise InputError(f"{identity}: unknown status {name!r}", remedy=", ".join(known))
    certificate = _certificate(document.get("certificate"), folder)
    cpu = document.get("cpu_s", document.get("time_s"))
    cpu_s = float(cpu) if isinstance(cpu, int | float) and abs(cpu) < 1e300 else math.nan
    return Answer(identity, Status(name), q, certificate, cpu_s)


def _check_numbers(q: Any, identity: str) -> None:
    fine = isinstance(q, list) and all(isinstance(v, int | float) and not isinstance(v, bool) for v in q)
    if not fine or not all(abs(v) < 1e300 for v in q):
        raise InputError(f'{identity}: "q" is not a list of finite numbers')


def _certificate(entry: Any, folder: Path) -> Certificate | None:
    if entry is None:
        return None
    if not isinstance(entry, str):
        return Certificate.from_json(entry)
    return read_certificate(folder / entry)


def read_certificate(path: Path) -> Certificate:
    """The certificate in a file.

    Raises:
        InputError: it is no plain file, too large, or not a certificate.
    """
    try:
        if path.stat().st_size > LARGEST_FILE:
            raise InputError(f"the certificate file is larger than {LARGEST_FILE >> 20} MB", where=path)
        text = regular_text(path)
    except (OSError, UnicodeError, ValueError) as error:
        raise InputError(f"the certificate file can't be read: {error}", where=path) from None
    return Certificate.from_json(text, str(path))
