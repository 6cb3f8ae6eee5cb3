"""What follows from a question and the tolerances that are covered (12.3)."""

from __future__ import annotations

from dataclasses import dataclass

from workcell.proofs.exact.convex.joints import perpendicular
from workcell.proofs.exact.mechanisms.question import Joint, Question
from workcell.proofs.exact.reading import RefusedError
from workcell.proofs.exact.spans import (
    PI,
    UNIT,
    ZERO,
    Span,
    cos_sin,
    larger,
    length,
    root,
    smaller,
    span,
    total,
)
from workcell.proofs.exact.vectors import (
    IDENTITY,
    Matrix,
    Vector,
    about,
    add,
    cross,
    multiply,
    scale,
    transpose,
    turn,
)

SLACK = span(1e-6)
HALF = span(0.5)
ROOT_OF_8 = root(span(8))
MISSED, TWISTED, BLUR = span(2), span(5), span(1e-8)
MOST = {"joints": 64, "closures": 64, "goals": 32, "rows of regions": 256}
LONGEST = 50
WIDEST = 100

Ends = tuple[Span | None, Span | None]


@dataclass(frozen=True, slots=True)
class Derived:
    """Of joints: ends, middles, halves, e, J u, J a, rest; of links: nodes, X, reach; of steps theta and P.

    What is None is infinite, or not there.
    """

    ends: tuple[Ends, ...]
    middle: tuple[Span, ...]
    half: tuple[Span, ...]
    e: tuple[Vector, ...]
    u_before: tuple[Vector, ...]
    axis_before: tuple[Vector, ...]
    rest: tuple[Matrix, ...]
    node: tuple[int, ...]
    inner: tuple[Matrix, ...]
    reach: tuple[Span | None, ...]
    theta: tuple[Span | None, ...]
    relative: tuple[Matrix, ...]
    room: tuple[Vector | None, ...]


def derive(question: Question, covered: tuple[Span, ...], near: Span) -> Derived:
    """All of it.

    Args:
        question: the question.
        covered: T, A, C, G.
        near: how far the places of frames are from their goals at most.

    Raises:
        RefusedError: it is larger than rounding is proved for.
    """
    _count(question)
    joints = question.joints
    ends = [_ends(question, k) for k in range(len(joints))]
    middle, half = zip(*(_range(joint, ends[k]) for k, joint in enumerate(joints)), strict=True)
    e, u, axis, rest = [], [], [], []
    for k, joint in enumerate(joints):
        raw = joint.raw_axis if joint.kind == "hinge" else (0.0, 0.0, 1.0)
        own = joint.axis if joint.kind == "hinge" else (ZERO, ZERO, UNIT)
        c, s = cos_sin(middle[k])
        e.append(perpendicular(own, raw))
        u.append(turn(joint.rotation, add(scale(c, e[k]), scale(s, cross(own, e[k])))))
        axis.append(turn(joint.rotation, joint.axis))
        rest.append(multiply(joint.rotation, about(own, c, s)))
    node, inner = _nodes(joints)
    room = [_room(question, k) for k in range(len(joints))]
    reach = _reach(question, ends, covered, room, near)
    ends = [_bounded(question, k, ends[k], reach) for k in range(len(joints))]
    if not total(_lengths(question, ends, reach, covered)).high <= span(LONGEST).high:
        raise RefusedError(f"everything is more than {LONGEST} m together")
    if not all(abs(value).high <= span(WIDEST).high for value in middle):
        raise RefusedError(f"limits are more than {WIDEST} rad from zero")
    theta, relative = [], []
    for k, joint in enumerate(joints):
        theta.append(_theta(question, k))
        R = IDENTITY
        if question.reference is not None:
            rotations = question.reference.rotations
            R = multiply(transpose(rotations[joint.parent]), rotations[k + 1])
        relative.append(R)
    return Derived(
        tuple(ends), middle, half, tuple(e), tuple(u), tuple(axis), tuple(rest), node, inner,
        tuple(reach), tuple(theta), tuple(relative), tuple(room),
    )  # fmt: skip


def _count(question: Question) -> None:
    counts = (len(question.joints), len(question.ties), len(question.goals), question.rows)
    for (what, most), count in zip(MOST.items(), counts, strict=True):
        if count > most:
            raise RefusedError(f"there are {count} {what}, more than {most}")


def _ends(question: Question, k: int) -> Ends:
    joint = question.joints[k]
    lower = None if joint.lower is None else span(joint.lower)
    upper = None if joint.upper is None else span(joint.upper)
    if joint.kind in ("hinge", "slide") and question.steps is not None and question.reference is not None:
        step = question.steps[k][0]
        if step is not None:
            value = span(question.reference.values[k])
            low, high = value - span(step), value + span(step)
            lower = low if lower is None else larger(lower, low)
            upper = high if upper is None else smaller(upper, high)
    return None if lower is None else lower - SLACK, None if upper is None else upper + SLACK


def _range(joint: Joint, ends: Ends) -> tuple[Span, Span]:
    lower, upper = ends
    if joint.kind == "ball" and upper is not None:
        return ZERO, smaller(upper, PI)
    if joint.kind == "hinge" and lower is not None and upper is not None:
        half = (upper - lower) * HALF
        if (PI - half).surely_positive:
            return (lower + upper) * HALF, half
    return ZERO, PI


def _nodes(joints: tuple[Joint, ...]) -> tuple[tuple[int, ...], tuple[Matrix, ...]]:
    node, inner = [0], [IDENTITY]
    for k, joint in enumerate(joints):
        slides = joint.kind == "slide"
        node.append(node[joint.parent] if slides else k + 1)
        inner.append(multiply(inner[joint.parent], joint.rotation) if slides else IDENTITY)
    return tuple(node), tuple(inner)


def _theta(question: Question, k: int) -> Span | None:
    """How far a ball or a floating body turns against the reference; None without steps."""
    if question.steps is None or question.joints[k].kind not in ("ball", "free"):
        return None
    parts = question.steps[k][-3:]
    if any(part is None for part in parts):
        return PI
    return smaller(length(span(part) + SLACK for part in parts if part is not None), PI)


def _room(question: Question, k: int) -> Vector | None:
    """How far each coordinate of a floating body may be from the reference; None where that is infinite."""
    if question.steps is None or question.joints[k].kind != "free":
        return None
    x, y, z = question.steps[k][:3]
    if x is None or y is None or z is None:
        return None
    return span(x) + SLACK, span(y) + SLACK, span(z) + SLACK


def _reach(
    question: Question, ends: list[Ends], covered: tuple[Span, ...], room: list[Vector | None], near: Span
) -> list[Span | None]:
    ways: list[tuple[int, int, Span]] = []
    for k, joint in enumerate(question.joints):
        step = length(joint.offset)
        if joint.kind == "slide":
            lower, upper = ends[k]
            if lower is None or upper is None:
                continue
            step = step + larger(abs(lower), abs(upper))
        if joint.kind != "free":
            ways.append((joint.parent, k + 1, step))
        elif (free := room[k]) is not None and question.reference is not None:
            ways.append((0, k + 1, length(question.reference.origins[k + 1]) + length(free)))
    for tie in question.ties:
        one, two = tie.ends
        ways.append((one.link, two.link, length(one.place) + length(two.place) + MISSED * covered[2]))
    for goal in question.goals:
        if goal.position is not None:
            ways.append((0, goal.frame.link, length(goal.position) + length(goal.frame.place) + near))
    found: list[Span | None] = [ZERO] + [None] * len(question.joints)
    for _ in found:
        for a, b, step in ways:
            for here, there in ((a, b), (b, a)):
                if (before := found[here]) is not None:
                    now, old = before + step, found[there]
                    found[there] = now if old is None else smaller(old, now)
    return found


def _bounded(question: Question, k: int, ends: Ends, reach: list[Span | None]) -> Ends:
    """Ends of a slide that has none, by how far its links can be."""
    joint = question.joints[k]
    one, two = reach[joint.parent], reach[k + 1]
    if joint.kind != "slide" or one is None or two is None:
        return ends
    farthest = one + two + length(joint.offset)
    return -farthest if ends[0] is None else ends[0], farthest if ends[1] is None else ends[1]


def _lengths(
    question: Question, ends: list[Ends], reach: list[Span | None], covered: tuple[Span, ...]
) -> list[Span]:
    lengths = [length(joint.offset) for joint in question.joints] + list(covered)
    for k, joint in enumerate(question.joints):
        lower, upper = ends[k]
        if joint.kind == "slide" and lower is not None and upper is not None:
            lengths.append(larger(abs(lower), abs(upper)))
        if joint.kind == "free" and (far := reach[k + 1]) is not None:
            lengths.append(far)
    lengths += [length(end.place) for tie in question.ties for end in tie.ends]
    for goal in question.goals:
        lengths.append(length(goal.frame.place))
        if goal.position is not None:
            lengths.append(length(goal.position))
    for region in question.regions:
        lengths += [length(region.frame.place), length(region.point)]
        largest = ZERO
        for end in region.ends:
            largest = larger(largest, abs(end))
        lengths.append(largest)
    return lengths
