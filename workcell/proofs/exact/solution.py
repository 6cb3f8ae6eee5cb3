"""`solution` (section 9): a box of configurations that all solve a problem, and one that solves it exactly."""

from __future__ import annotations

from fractions import Fraction

from workcell.proofs.exact.certificates import LEAST_POSITION, LEAST_ROTATION, Certificate, Claim, index
from workcell.proofs.exact.distances import distance
from workcell.proofs.exact.kinematics import FARTHEST, Placed, chord_of_rotation, placed
from workcell.proofs.exact.problems import SLACK, Problem
from workcell.proofs.exact.reading import RefusedError
from workcell.proofs.exact.spans import UNIT, ZERO, Span, cos_sin, length, root, span, square, total
from workcell.proofs.exact.vectors import Vector, cross, dot, multiply, scale, subtract, transpose, turn

_HALF = span(0.5)


def solution(problem: Problem, certificate: Certificate) -> Claim:
    """Every configuration of a box solves the problem.

    Raises:
        RefusedError: an array breaks a rule, or an inequality is not known to hold.
    """
    n = len(problem.arm.joints)
    middle, half, joints, inverse, given = certificate.arrays(
        middle=(n,), half=(n,), joints=("six",), inverse=("six", "six"), tolerances=(3,)
    )
    position, rotation, clearance = given.values
    if not (0 < position <= LEAST_POSITION and 0 < rotation <= LEAST_ROTATION and clearance >= 0):
        raise RefusedError("its tolerances are wider than what the problem asks for")
    if not all(0 <= h <= 1 for h in half.values) or not all(abs(m) <= FARTHEST for m in middle.values):
        raise RefusedError("its box is too large, or has an end beyond 100 rad")
    _within_limits(problem, middle.values, half.values)
    at = placed(problem, middle.values)
    halves = [span(h) for h in half.values]
    sizes = [length(joint.offset) for joint in problem.arm.joints]
    reach = [total((*sizes[k + 1 :], length(problem.arm.tool))) for k in range(n)]
    _reached(problem, at, halves, reach, span(position), span(rotation))
    _clear(problem, at, halves, sizes, span(clearance))
    exact = ""
    if joints.values:
        if len(joints.values) != 6:
            raise RefusedError(f"it names {len(joints.values)} joints, not six")
        six = [index(value, n, "a joint") for value in joints.values]
        if len(set(six)) != 6:
            raise RefusedError("it names a joint twice")
        _krawczyk(problem, at, six, [[span(v) for v in row] for row in inverse.rows()], halves, reach)
        exact = " One of them has it exactly there."
    statement = (
        f"Every configuration within {max(half.values):.3g} rad of this one has the tool within "
        f"{1e3 * position:g} mm and {rotation:g} rad of the target, all spheres {1e3 * clearance:g} mm or more "
        f"from everything, and keeps the joint limits.{exact}"
    )
    if certificate.margin != position:
        raise RefusedError(f"it says a margin of {certificate.margin:g}, and a solution's is {position:g}")
    return Claim("solution", statement, span(position))


def _within_limits(problem: Problem, middle: tuple[float, ...], half: tuple[float, ...]) -> None:
    """Rule 9.2."""
    slack = Fraction(SLACK)
    for k, (joint, m, h) in enumerate(zip(problem.arm.joints, middle, half, strict=True)):
        low, high = Fraction(m) - Fraction(h), Fraction(m) + Fraction(h)
        if not (Fraction(joint.lower) - slack <= low and high <= Fraction(joint.upper) + slack):
            raise RefusedError(f"its box leaves the limits of joint {k}")


def _reached(
    problem: Problem, at: Placed, half: list[Span], reach: list[Span], position: Span, rotation: Span
) -> None:
    """Rule 9.3."""
    moved = total(h * r for h, r in zip(half, reach, strict=True))
    if not (position - length(subtract(at.tool, problem.target)) - moved).low >= 0:
        raise RefusedError("the tool leaves its tolerance of position")
    turned = chord_of_rotation(problem, at) / root(span(8)) + total(half) * _HALF
    if not (cos_sin(rotation * _HALF)[1] - turned).low >= 0:
        raise RefusedError("the tool leaves its tolerance of rotation")


def _clear(problem: Problem, at: Placed, half: list[Span], sizes: list[Span], clearance: Span) -> None:
    """Rule 9.4."""
    for s, sphere in enumerate(problem.arm.spheres):
        own = length(sphere.centre)
        moved = total(half[k] * total((*sizes[k + 1 : sphere.link], own)) for k in range(sphere.link))
        kept = clearance + span(sphere.radius) + moved
        centre = at.centre(problem, s)
        for obstacle in problem.obstacles:
            if not (distance(obstacle, centre) - kept).low >= 0:
                raise RefusedError(f"sphere {s} may come nearer to {obstacle.name}")


def _krawczyk(
    problem: Problem,
    at: Placed,
    six: list[int],
    inverse: list[list[Span]],
    half: list[Span],
    reach: list[Span],
) -> None:
    """Rule 9.5."""
    m = multiply(at.tool_rotation, transpose(problem.target_rotation))
    trace = total(m[i][i] for i in range(3))
    skew = (m[2][1] - m[1][2], m[0][2] - m[2][0], m[1][0] - m[0][1])
    f = [*subtract(at.tool, problem.target), *scale(_HALF, skew)]
    columns = [_derivative(problem, at, j, m, trace) for j in six]
    radii = [half[j] for j in six]
    first = total(half[i] * half[j] * reach[max(i, j)] for i in six for j in six)
    second = square(total(radii))
    for i, row in enumerate(inverse):
        off = abs(dot(row, f))
        for j, column in enumerate(columns):
            off += abs((UNIT if i == j else ZERO) - dot(row, column)) * radii[j]
        off += total(map(abs, row[:3])) * first * _HALF + total(map(abs, row[3:])) * second * _HALF
        if not (radii[i] - off).surely_positive:
            raise RefusedError(f"its box does not map into itself along joint {six[i]}")


def _derivative(
    problem: Problem, at: Placed, j: int, m: tuple[Vector, Vector, Vector], trace: Span
) -> list[Span]:
    """J_j of rule 9.5, of the joint counted from 0."""
    joint = problem.arm.joints[j]
    z = turn(at.rotations[j], turn(joint.rotation, joint.axis))
    moved = cross(z, subtract(at.tool, at.origins[j + 1]))
    return [*moved, *scale(_HALF, subtract(scale(trace, z), turn(m, z)))]
