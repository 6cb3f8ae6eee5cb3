"""Signed distances of rule 1.2, as spans."""

from __future__ import annotations

from workcell.proofs.exact.problems import Obstacle
from workcell.proofs.exact.spans import ZERO, Span, larger, length, smaller, span
from workcell.proofs.exact.vectors import Vector, subtract, transpose, turn


def distance(obstacle: Obstacle, point: Vector) -> Span:
    """The signed distance of a point to an obstacle."""
    u = turn(transpose(obstacle.axes), subtract(point, obstacle.centre))
    sizes = [span(size) for size in obstacle.sizes]
    if obstacle.sort == "sphere":
        return length(u) - sizes[0]
    if obstacle.sort == "box":
        beyond = [abs(x) - half for x, half in zip(u, sizes, strict=True)]
    else:
        beyond = [length(u[:2]) - sizes[0], abs(u[2]) - sizes[1]]
    deepest = beyond[0]
    for e in beyond[1:]:
        deepest = larger(deepest, e)
    # both cases in one: the length of what is above zero, plus the largest where none is
    return length(larger(e, ZERO) for e in beyond) + smaller(deepest, ZERO)
