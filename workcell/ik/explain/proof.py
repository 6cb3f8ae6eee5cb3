"""A certificate in words: what it claims, by which rule, what its numbers look like, what it rests on.

Nothing is believed that the certificate says of itself: with the problem at hand, its checker says whether it holds.
"""

from __future__ import annotations

from dataclasses import dataclass

from workcell.ik.certificate import Certificate
from workcell.ik.check import STATUS_OF_SCOPE, check_certificate
from workcell.ik.claims.form import wrong_form
from workcell.ik.explain.kinds import KINDS, OPTIONAL
from workcell.ik.problem import IKProblem
from workcell.ik.registry import PROOFS

_SCOPES = {
    "kinematics": "the chain and its joint limits alone, whatever stands around",
    "geometry": "the true shape of the robot and of what stands around it",
    "model": "a model that is larger than the real shapes: the real ones may leave room",
    "solution": "a configuration that solves the problem",
}


@dataclass(frozen=True, slots=True)
class ProofInWords:
    """What a certificate is, line by line.

    Attributes:
        kind, status: of the proof, and what it awards where it holds.
        lines: (what, words).
        refusal: why it does not hold, None where it does, or where there was no problem to hold it against.
        checked: whether there was one.
    """

    kind: str
    status: str
    lines: tuple[tuple[str, str], ...]
    refusal: str | None
    checked: bool

    def to_json(self) -> dict[str, object]:
        """A plain dictionary."""
        return {
            "kind": self.kind,
            "status": self.status,
            **dict(self.lines),
            "checked": self.checked,
            "refusal": self.refusal,
        }


def in_words(certificate: Certificate, problem: IKProblem | None = None, name: str = "") -> ProofInWords:
    """A certificate in words.

    Args:
        certificate: of any kind; its numbers may be damaged.
        problem: what it is about; then it is also checked.
        name: of the problem.
    """
    refusal = None if problem is None else check_certificate(problem, certificate)
    rule, shapes, tell = KINDS.get(certificate.kind, (_unknown(certificate.kind), {}, None))
    extra = {name: shape for name, shape in OPTIONAL.items() if name in certificate.data}
    damage = wrong_form(certificate, {**shapes, **extra})
    lines = [("claims", certificate.statement), ("about", _SCOPES[certificate.scope]), ("rule", rule)]
    if tell is not None and damage is not None:
        lines.append(("numbers", f"damaged: {damage}"))
    elif tell is not None:
        # names only of a problem that the numbers belong to: they may point anywhere
        lines += tell(certificate, problem if refusal is None else None)
    lines.append(("margin", _margin(certificate)))
    lines.append(("holds", _verdict(problem, refusal, name)))
    return ProofInWords(
        certificate.kind,
        STATUS_OF_SCOPE[certificate.scope].value,
        tuple(lines),
        refusal,
        problem is not None,
    )


def _verdict(problem: IKProblem | None, refusal: str | None, name: str) -> str:
    if problem is None:
        return "not looked at: that takes the problem (workcell verify SET.json --explain FILE)"
    where = f" of {name!r}" if name else ""
    return f"yes{where}, as its checker finds" if refusal is None else f"no{where}: {refusal}"


def _margin(certificate: Certificate) -> str:
    units = {"reach": " m to spare", "last_link": " m to spare", "branch": " m around the target are covered"}
    return f"{certificate.margin:.4g}{units.get(certificate.kind, '')}"


def _unknown(kind: str) -> str:
    if kind in PROOFS:
        return f"proofs of kind {kind!r} are no longer read"
    return f"proofs of kind {ascii(kind)[:60]} are unknown; known are {', '.join(PROOFS)}"
