"""`reach` and `last_link`: sections 4 and 5."""

from __future__ import annotations

from workcell.proofs.exact.certificates import Certificate, Claim, index, tolerances
from workcell.proofs.exact.distances import distance
from workcell.proofs.exact.problems import Joint, Problem
from workcell.proofs.exact.reading import RefusedError
from workcell.proofs.exact.spans import ZERO, Span, larger, length, span, total
from workcell.proofs.exact.vectors import Vector, add, dot, scale, subtract, transpose, turn

KEPT_BACK = span(1e-9)


def reach(problem: Problem, certificate: Certificate) -> Claim:
    """The triangle inequality along points of the joints' axes.

    Raises:
        RefusedError: an array breaks a rule.
    """
    joints = problem.arm.joints
    given, slid = certificate.arrays(tolerances=(3,), slides=(len(joints),))
    position, rotation = tolerances(given.values)
    if not all(abs(slide) <= 10.0 for slide in slid.values):
        raise RefusedError("a slide is longer than 10 m")
    slides = [span(slide) for slide in slid.values]
    seen_before = [_before(joint, slide) for joint, slide in zip(joints, slides, strict=True)]
    own = [scale(slide, joint.axis) for joint, slide in zip(joints, slides, strict=True)]
    lengths = [length(subtract(far, near)) for near, far in zip(own[:-1], seen_before[1:], strict=True)]
    longest = ZERO
    for one in lengths:
        longest = larger(longest, one)
    whole = total(lengths)
    in_tool = _in_tool(problem, own[-1])
    away = length(subtract(_at_target(problem, in_tool), seen_before[0]))
    blur = span(position) + span(rotation) * length(in_tool) + KEPT_BACK
    margin = larger(away - blur - whole, longest + longest - whole - away - blur)
    statement = (
        f"the target is {1e3 * certificate.margin:.1f} mm out of reach by the triangle inequality along the chain, "
        f"covering {1e3 * position:g} mm, {rotation:g} rad and {1e3 * given.values[2]:g} mm of penetration"
    )
    return Claim("kinematics", statement, margin)


def last_link(problem: Problem, certificate: Certificate) -> Claim:
    """A sphere next to the tool that is inside an obstacle wherever the target is reached.

    Raises:
        RefusedError: an array breaks a rule.
    """
    arm = problem.arm
    given, pair = certificate.arrays(tolerances=(3,), pair=(2,))
    position, rotation = tolerances(given.values)
    number = index(pair.values[0], len(arm.spheres), "the sphere")
    obstacle = problem.obstacles[index(pair.values[1], len(problem.obstacles), "the obstacle")]
    sphere, last = arm.spheres[number], len(arm.joints)
    place, stray = sphere.centre, ZERO
    if sphere.link == last - 1:
        place, stray = _on_last_axis(arm.joints[-1], sphere.centre)
    elif sphere.link != last:
        raise RefusedError(f"sphere {number} is on link {sphere.link}, which the target does not place")
    in_tool = _in_tool(problem, place)
    allowed = given.values[2]
    blur = stray + span(position) + span(rotation) * length(in_tool)
    outside = distance(obstacle, _at_target(problem, in_tool)) - span(sphere.radius)
    link = f"link{sphere.link}" if sphere.link else "base"
    statement = (
        f"wherever the arm reaches the target, sphere {number} ({link}) is inside {obstacle.name}, "
        f"{1e3 * certificate.margin:.1f} mm deeper than needed, "
        f"covering {1e3 * position:g} mm, {rotation:g} rad and {1e3 * allowed:g} mm of penetration"
    )
    return Claim("geometry", statement, -span(allowed) - KEPT_BACK - (outside + blur))


def _before(joint: Joint, slide: Span) -> Vector:
    return add(joint.offset, scale(slide, turn(joint.rotation, joint.axis)))


def _in_tool(problem: Problem, place: Vector) -> Vector:
    """A point of the last link in the tool's frame: f of rules 4.2 and 5.2."""
    arm = problem.arm
    return turn(transpose(arm.tool_rotation), subtract(place, arm.tool))


def _at_target(problem: Problem, in_tool: Vector) -> Vector:
    return add(problem.target, turn(problem.target_rotation, in_tool))


def _on_last_axis(joint: Joint, centre: Vector) -> tuple[Vector, Span]:
    """What the centre circles, in the last link, and how far from it."""
    axis = turn(joint.rotation, joint.axis)
    beside = subtract(centre, joint.offset)
    height = dot(beside, axis)
    return scale(height, joint.axis), length(subtract(beside, scale(height, axis)))
