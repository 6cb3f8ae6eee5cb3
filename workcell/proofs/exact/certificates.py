"""A certificate's file: what stands in it, and what every kind has in common (rules 2.1 to 2.7)."""

from __future__ import annotations

import math
from dataclasses import dataclass
from fractions import Fraction
from typing import Any

from workcell.proofs.exact.reading import RefusedError, double, member
from workcell.proofs.exact.spans import ONE, Span

FORMAT = "workcell-certificate/1"
LARGEST = 1e50
_ROUNDED = Fraction(1, 10**9)
LEAST_POSITION = 1e-4
LEAST_ROTATION = 1e-3
SCOPES = ("kinematics", "geometry", "model")

Shape = tuple[int | str, ...]
"""Lengths of an array's sides; a letter stands for any length, the same wherever it returns."""


@dataclass(frozen=True, slots=True)
class Array:
    """Numbers row by row, with their shape."""

    shape: tuple[int, ...]
    values: tuple[float, ...]

    def rows(self) -> list[tuple[float, ...]]:
        """The rows of an array of two sides."""
        count, width = self.shape
        return [self.values[width * i : width * (i + 1)] for i in range(count)]


@dataclass(frozen=True, slots=True)
class Certificate:
    """What a file says, read strictly; nothing of it is believed yet."""

    kind: str
    scope: str
    statement: str
    margin: float
    data: dict[str, Array]

    def arrays(self, **shapes: Shape) -> tuple[Array, ...]:
        """The arrays of a kind, in the order of the names given (rule 2.3).

        Raises:
            RefusedError: one is missing, has another shape, or there are others.
        """
        if set(shapes) != set(self.data):
            raise RefusedError(f"the arrays are {sorted(self.data)}, not {sorted(shapes)}")
        letters: dict[str, int] = {}
        for name, shape in shapes.items():
            found = self.data[name].shape
            fits = len(found) == len(shape) and all(
                (letters.setdefault(side, size) if isinstance(side, str) else side) == size
                for side, size in zip(shape, found, strict=True)
            )
            if not fits:
                raise RefusedError(f"{name!r} has the shape {found}, not {shape}")
        return tuple(self.data[name] for name in shapes)


@dataclass(frozen=True, slots=True)
class Claim:
    """What a kind's rules compute: scope, statement and the margin, m in metres or of the multipliers' size."""

    scope: str
    statement: str
    margin: Span


def read_certificate(document: Any) -> Certificate:
    """A certificate from its JSON value.

    Raises:
        RefusedError: it breaks one of rules 2.1 to 2.3.
    """
    if not isinstance(document, dict) or document.get("format") != FORMAT:
        raise RefusedError(f"the certificate's format is not {FORMAT}")
    kind, scope, statement = (member(document, key, str, "it") for key in ("kind", "scope", "statement"))
    margin = double(document.get("margin"), "the margin")
    data = member(document, "data", dict, "the certificate")
    return Certificate(kind, scope, statement, margin, {name: _array(name, data[name]) for name in data})


def _array(name: str, entry: Any) -> Array:
    what = f"the array {name!r}"
    if not isinstance(entry, dict) or set(entry) != {"shape", "values"}:
        raise RefusedError(f"{what} is not made of shape and values")
    shape, values = entry["shape"], entry["values"]
    if not isinstance(shape, list) or not isinstance(values, list) or len(shape) > 4:
        raise RefusedError(f"{what} has no shape and values of a list each")
    if not all(type(side) is int and side >= 0 for side in shape) or math.prod(shape) != len(values):
        raise RefusedError(f"{what} has a shape that does not fit its {len(values)} values")
    numbers = tuple(double(value, what) for value in values)
    if not all(abs(value) <= LARGEST for value in numbers):
        raise RefusedError(f"{what} has a number beyond {LARGEST:g}")
    return Array(tuple(shape), numbers)


def index(value: float, count: int, what: str) -> int:
    """A whole number from 0 to count - 1 (rule 2.3).

    Raises:
        RefusedError: it is none.
    """
    if value != int(value) or not 0 <= value < count:
        raise RefusedError(f"{what} is {value:g}, not a whole number from 0 to {count - 1}")
    return int(value)


def tolerances(values: tuple[float, ...]) -> tuple[float, float]:
    """T and A, no narrower than a problem of a set asks for, no wider than 1.

    Raises:
        RefusedError: they are not.
    """
    position, rotation = values[:2]
    if not (LEAST_POSITION <= position <= 1.0 and LEAST_ROTATION <= rotation <= 1.0):
        raise RefusedError(f"its tolerances are {position:g} m and {rotation:g} rad")
    if not all(0.0 <= value <= 1.0 for value in values[2:]):
        raise RefusedError("its penetration is not between 0 and 1 m")
    return position, rotation


def compare(certificate: Certificate, claim: Claim) -> None:
    """Hold what the file says against what its numbers prove (rules 2.5 to 2.7).

    Raises:
        RefusedError: they differ, or nothing is proved.
    """
    if not claim.margin.surely_positive:
        raise RefusedError(f"nothing is proved: its margin is {float(Fraction(claim.margin.low, ONE)):.3g}")
    said, near = Fraction(certificate.margin) * ONE, Fraction(1, 10**6)
    least, most = (1 - near) * claim.margin.low, (1 + near) * claim.margin.high
    if not least - ONE * _ROUNDED <= said <= most + ONE * _ROUNDED:
        computed = float(Fraction(claim.margin.low, ONE))
        raise RefusedError(f"it says a margin of {certificate.margin:g}, and proves one of {computed:g}")
    if certificate.scope != claim.scope:
        raise RefusedError(f"it says {certificate.scope!r}, and is about {claim.scope!r}")
    if certificate.statement != claim.statement:
        raise RefusedError(f"its statement should read: {claim.statement}")


def poses_missed(position: float, rotation: float) -> str:
    """How statements of the convex kinds begin."""
    return (
        "No configuration within the joint limits brings the tool within "
        f"{1e3 * position:g} mm and {rotation:g} rad of the target"
    )
