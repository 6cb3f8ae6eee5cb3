"""The chain at one configuration (rule 1.2), and whether that configuration solves its problem."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from fractions import Fraction

from workcell.proofs.exact.certificates import LEAST_POSITION, LEAST_ROTATION
from workcell.proofs.exact.distances import distance
from workcell.proofs.exact.problems import SLACK, Problem
from workcell.proofs.exact.reading import RefusedError
from workcell.proofs.exact.spans import ONE, ZERO, Span, cos_sin, length, span, square
from workcell.proofs.exact.vectors import (
    IDENTITY,
    Matrix,
    Vector,
    about,
    add,
    frobenius,
    multiply,
    subtract,
    transpose,
    turn,
)

FARTHEST = 100.0


@dataclass(frozen=True, slots=True)
class Placed:
    """An arm at a configuration: R_0 ... R_n, o_0 ... o_n, p and R of the tool."""

    rotations: list[Matrix]
    origins: list[Vector]
    tool: Vector
    tool_rotation: Matrix

    def centre(self, problem: Problem, s: int) -> Vector:
        """Where a sphere's centre is."""
        sphere = problem.arm.spheres[s]
        return add(self.origins[sphere.link], turn(self.rotations[sphere.link], sphere.centre))


def placed(problem: Problem, q: Sequence[float]) -> Placed:
    """The arm at q.

    Raises:
        RefusedError: an angle is beyond 100 rad.
    """
    rotations, origins = [IDENTITY], [(ZERO, ZERO, ZERO)]
    if not all(abs(angle) <= FARTHEST for angle in q):
        raise RefusedError(f"an angle is beyond {FARTHEST:g} rad")
    for joint, angle in zip(problem.arm.joints, q, strict=True):
        origins.append(add(origins[-1], turn(rotations[-1], joint.offset)))
        rotations.append(multiply(rotations[-1], joint.rotation, about(joint.axis, *cos_sin(span(angle)))))
    tool = add(origins[-1], turn(rotations[-1], problem.arm.tool))
    return Placed(rotations, origins, tool, multiply(rotations[-1], problem.arm.tool_rotation))


def chord_of_rotation(problem: Problem, at: Placed) -> Span:
    """|M - I| of M = R(q) R_g^T in Frobenius norm: 2 sqrt 2 sin(angle / 2)."""
    m = multiply(at.tool_rotation, transpose(problem.target_rotation))
    first, second, third = (subtract(row, unit) for row, unit in zip(m, IDENTITY, strict=True))
    return frobenius((first, second, third))


def check_configuration(problem: Problem, q: Sequence[float]) -> None:
    """Whether q is admissible, reaches the target and has every sphere clear (rules 1.3 and 1.4).

    Raises:
        RefusedError: it does not, and by how much.
    """
    if len(q) != len(problem.arm.joints):
        raise RefusedError(f"{len(q)} angles for {len(problem.arm.joints)} joints")
    slack = Fraction(SLACK)
    for k, (joint, angle) in enumerate(zip(problem.arm.joints, q, strict=True)):
        if not Fraction(joint.lower) - slack <= Fraction(angle) <= Fraction(joint.upper) + slack:
            raise RefusedError(f"joint {k} is outside its limits")
    at = placed(problem, q)
    off = length(subtract(at.tool, problem.target))
    if not off.high <= span(LEAST_POSITION).low:
        raise RefusedError(f"the tool is {_text(off)} m from its target")
    sine = cos_sin(span(LEAST_ROTATION / 2))[1]
    if not (square(chord_of_rotation(problem, at)) - span(8) * sine * sine).high <= 0:
        raise RefusedError(f"the tool is turned away from its target by more than {LEAST_ROTATION:g} rad")
    for s, sphere in enumerate(problem.arm.spheres):
        centre = at.centre(problem, s)
        for obstacle in problem.obstacles:
            clear = distance(obstacle, centre) - span(sphere.radius)
            if not clear.low >= 0:
                raise RefusedError(f"sphere {s} is {_text(clear)} m from {obstacle.name}")


def _text(x: Span) -> str:
    return f"{float(Fraction(x.low, ONE)):.6g}"
