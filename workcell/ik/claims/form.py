"""What every checker of certificates asks: the form of the numbers, and that no file says more than it proves.

The rules are those of docs/proofs.md, section 2. What a certificate says of itself (scope, statement, margin) is
computed by its checker from the numbers and compared here.
"""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np

from workcell.ik.certificate import Certificate, problem_hash
from workcell.ik.problem import IKProblem
from workcell.pose import Array

LARGEST = 1e50
"""Size that no number of a proof may exceed: products of a few of them are finite."""
WIDEST = 1.0
"""Metres, radians and metres that the covered tolerances may have at most."""
AGREEMENT = 1e-6
"""Part of the margin by which a file's may differ from its checker's, beside 1e-9: checkers may round differently."""

Shape = tuple[int | None, ...]
"""Sizes of an array; None where any will do."""


def wrong_subject(problem: IKProblem, certificate: Certificate, kind: str) -> str | None:
    """Why a certificate is not one of a kind about a problem, or None."""
    if certificate.kind != kind:
        return f"it is of kind {certificate.kind!r}, not {kind!r}"
    if certificate.problem_hash != problem_hash(problem):
        return "it belongs to another problem"
    return None


def wrong_form(certificate: Certificate, shapes: Mapping[str, Shape]) -> str | None:
    """Why the arrays of a certificate are not those of `shapes`, each finite and none too large; None if they are."""
    data = certificate.data
    for name in data:
        if name not in shapes:
            return f"{name!r} has no place in a proof of kind {certificate.kind!r}"
    for name, shape in shapes.items():
        if name not in data:
            return f"{name!r} is missing"
        if not _fits(data[name].shape, shape):
            wanted = ", ".join("any" if size is None else str(size) for size in shape)
            return f"{name!r} is of shape {list(data[name].shape)}, not [{wanted}]"
        # not `any larger`: nan is neither
        if not bool(np.all(np.abs(data[name]) <= LARGEST)):
            return f"{name!r} holds a number that is not finite, or larger than {LARGEST:g}"
    return None


def _fits(shape: tuple[int, ...], wanted: Shape) -> bool:
    return len(shape) == len(wanted) and all(b is None or a == b for a, b in zip(shape, wanted, strict=True))


def whole_numbers(values: Array, below: int) -> bool:
    """Whether all values are whole numbers from 0 to `below` - 1: only then may they become indices."""
    return bool(np.all((values >= 0) & (values < below) & (np.floor(values) == values)))


def wrong_tolerances(problem: IKProblem, covered: Array) -> str | None:
    """Why the covered tolerances, metres and radians (and metres of penetration), don't do for a problem, or None."""
    allowed = problem.tolerances
    asked = np.array([allowed.position, allowed.rotation, 0.0])[: len(covered)]
    if not bool(np.all(covered >= asked)):
        return "the covered tolerances are narrower than those of the problem"
    if not bool(np.all(covered <= WIDEST)):
        return f"the covered tolerances exceed {WIDEST:g} m or rad"
    return None


def overclaims(certificate: Certificate, scope: str, margin: float, statement: str) -> str | None:
    """Why what a certificate says is not what its numbers show; None where scope, margin and statement are that.

    Args:
        certificate: what is said.
        scope, margin, statement: what was found; the margin has been found to be positive.
    """
    if certificate.scope != scope:
        return f"the scope {certificate.scope!r} is not what it proves: that is of the scope {scope!r}"
    if not abs(certificate.margin - margin) <= AGREEMENT * margin + 1e-9:
        return f"the margin is {margin:.6g}, not {certificate.margin:.6g} as it says"
    if certificate.statement != statement:
        return f"the statement is not what is proved, which is: {statement}"
    return None
