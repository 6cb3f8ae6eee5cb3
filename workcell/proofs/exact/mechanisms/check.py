"""Checks a certificate about a mechanism against its question (12.6, 12.7)."""

from __future__ import annotations

from fractions import Fraction
from typing import Any

from workcell.proofs.exact.certificates import Certificate, Claim, compare, read_certificate
from workcell.proofs.exact.mechanisms.bound import upper_bound
from workcell.proofs.exact.mechanisms.derived import derive
from workcell.proofs.exact.mechanisms.hanging import Hanging
from workcell.proofs.exact.mechanisms.multipliers import read_multipliers
from workcell.proofs.exact.mechanisms.question import Question, read_question
from workcell.proofs.exact.mechanisms.sums import Sum
from workcell.proofs.exact.reading import RefusedError
from workcell.proofs.exact.spans import ONE, Span, root, span, square, total
from workcell.proofs.exact.vectors import frobenius

KIND, COST = "mechanism/1", "mechanism_cost/1"
KEPT_BACK, _OF_SQUARES = span(2e-9), span(1e-12)


def check(question: Any, certificate: Any) -> str:
    """The statement that a certificate (its JSON value) proves about a question (its JSON value).

    Raises:
        RefusedError: it proves nothing, or something else than it says.
    """
    asked, said = read_question(question), read_certificate(certificate)
    if said.kind not in (KIND, COST):
        raise RefusedError(f"it is of kind {said.kind!r}, not {KIND!r} or {COST!r}")
    reached = said.kind == KIND
    m = read_multipliers(asked, said)
    covered = tuple(span(value) for value in m.tolerances)
    if not said.margin > 0:
        raise RefusedError(f"a margin of {said.margin:g} says nothing")
    derived = derive(asked, covered, covered[0] if reached else root(span(said.margin)))
    sums = Sum(asked, derived, m, covered, reached=reached)
    hanging = Hanging(asked, derived, m.hangs, covered[2], reached=reached)
    value = upper_bound(asked, derived, m, sums, hanging, covered[1])
    if reached:
        statement = nothing_reaches(asked, m.tolerances)
        compare(said, Claim("kinematics", statement, -value / m.size - KEPT_BACK))
        return statement
    squares = total(square(entry) for row in m.positions for entry in row)
    squares += total(square(frobenius(matrix)) for matrix in m.rotations)
    quarter = squares * span(0.25)
    return _compare_bound(
        asked, said, m.tolerances, -quarter - value - KEPT_BACK * m.size - _OF_SQUARES * quarter
    )


def _compare_bound(question: Question, said: Certificate, covered: tuple[float, ...], bound: Span) -> str:
    if not Fraction(said.margin) * ONE <= bound.low:
        raise RefusedError(f"it says {said.margin:g}, and proves {float(Fraction(bound.low, ONE)):g}")
    statement = nothing_is_closer(question, covered, said.margin)
    if said.scope != "kinematics" or said.statement != statement:
        raise RefusedError(f"it is about the kinematics, and its statement should read: {statement}")
    return statement


def nothing_reaches(question: Question, covered: tuple[float, ...]) -> str:
    """The statement of `mechanism/1`."""
    parts = _ties(question, covered)
    if question.goals:
        parts.append(f"reaches all goals within {1e3 * covered[0]:g} mm and {covered[1]:g} rad")
    return _sentence(question, [*parts, *_regions(question, covered)])


def nothing_is_closer(question: Question, covered: tuple[float, ...], bound: float) -> str:
    """The statement of `mechanism_cost/1`."""
    parts = _ties(question, covered)
    if any(goal.direction is not None for goal in question.goals):
        parts.append(f"keeps the directions within {covered[1]:g} rad")
    parts += _regions(question, covered)
    least = f"{0.99999 * bound:.6g}"
    return _sentence(
        question,
        [*parts, f"has a sum of squared pose errors (metres, and entries of rotations) below {least}"],
    )


def _ties(question: Question, covered: tuple[float, ...]) -> list[str]:
    return [f"keeps the ties within {1e3 * covered[2]:g} mm and {covered[2]:g} rad"] if question.ties else []


def _regions(question: Question, covered: tuple[float, ...]) -> list[str]:
    return [f"has all points within {1e3 * covered[3]:g} mm of their regions"] if question.regions else []


def _sentence(question: Question, parts: list[str]) -> str:
    bounds = [name for name, there in (("max_step", question.steps), ("max_link_rotation", question.link_rotation))
              if there is not None]  # fmt: skip
    within = f" and within {' and '.join(bounds)} of q_reference" if bounds else ""
    said = parts[-1] if parts else "is there"
    if len(parts) > 1:
        said = f"{', '.join(parts[:-1])} and {said}"
    return f"No configuration within the joint limits{within} {said}, obstacles aside."
