"""What both convex kinds need of every joint: normals of its axis, and half of its range (rule 7.2)."""

from __future__ import annotations

from dataclasses import dataclass

from workcell.proofs.exact.problems import SLACK, Joint, Problem
from workcell.proofs.exact.spans import PI, Span, cos_sin, length, smaller, span
from workcell.proofs.exact.vectors import Matrix, Vector, add, cross, multiply, scale, transpose, turn


@dataclass(frozen=True, slots=True)
class Range:
    """Of joint k: e_k, f_k = a_k x e_k and u_k in link k, the others seen in link k - 1.

    Attributes:
        e, f: normal to the axis and to each other.
        axis_before, e_before, f_before, u_before: J_k a_k, J_k e_k, J_k f_k, J_k u_k.
        cos_middle, sin_middle: of the middle of the limits.
        cos_half: cosine of half of the range, with the slack, at most half a turn.
        chord: 2 sin(half / 2).
    """

    e: Vector
    f: Vector
    axis_before: Vector
    e_before: Vector
    f_before: Vector
    u_before: Vector
    cos_middle: Span
    sin_middle: Span
    cos_half: Span
    chord: Span


def ranges(problem: Problem) -> list[Range]:
    """Of all joints, in their order."""
    return [_range(joint) for joint in problem.arm.joints]


def _range(joint: Joint) -> Range:
    e = perpendicular(joint.axis, joint.raw_axis)
    f = cross(joint.axis, e)
    lower, upper, halved = span(joint.lower), span(joint.upper), span(0.5)
    cos_middle, sin_middle = cos_sin((lower + upper) * halved)
    half = smaller((upper - lower) * halved + span(SLACK), PI)
    u = add(scale(cos_middle, e), scale(sin_middle, f))
    axis_before, e_before, f_before, u_before = (turn(joint.rotation, v) for v in (joint.axis, e, f, u))
    sine = cos_sin(half * halved)[1]
    before = (axis_before, e_before, f_before, u_before)
    return Range(e, f, *before, cos_middle, sin_middle, cos_sin(half)[0], sine + sine)


def perpendicular(axis: Vector, raw: tuple[float, ...]) -> Vector:
    """A unit vector normal to an axis: E_i x a divided by its length, i the first of the axis' smallest components."""
    first = min(range(3), key=lambda i: abs(raw[i]))
    e: Vector = tuple(span(int(i == first)) for i in range(3))  # type: ignore[assignment]
    beside = cross(e, axis)
    size = length(beside)
    return beside[0] / size, beside[1] / size, beside[2] / size


def last_rotation(problem: Problem) -> Matrix:
    """R_n at the target itself."""
    return multiply(problem.target_rotation, transpose(problem.arm.tool_rotation))
