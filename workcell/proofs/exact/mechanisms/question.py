"""The question that a certificate about a mechanism belongs to (12.1), read strictly."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

from workcell.proofs.exact.reading import RefusedError, double, doubles, member
from workcell.proofs.exact.spans import Span, length, span
from workcell.proofs.exact.vectors import Matrix, Vector, add, rotation_of, turn, unit, vector

FORMAT = "workcell-mechanism-question/1"
KINDS = ("hinge", "slide", "ball", "free")
STEPS = {"hinge": 1, "slide": 1, "ball": 3, "free": 6}
_NO_AXIS = (0.0, 0.0, 1.0)
_SHARP = 1e-9


@dataclass(frozen=True, slots=True)
class Joint:
    """A joint: it moves link k + 1. An end that is None is infinite."""

    kind: str
    parent: int
    offset: Vector
    rotation: Matrix
    axis: Vector
    raw_axis: tuple[float, ...]
    lower: float | None
    upper: float | None


@dataclass(frozen=True, slots=True)
class Frame:
    """A frame on a link."""

    link: int
    place: Vector
    rotation: Matrix

    def point(self, local: Vector) -> Vector:
        """A point of the frame in its link."""
        return add(self.place, turn(self.rotation, local))


@dataclass(frozen=True, slots=True)
class Tie:
    """A closure."""

    is_weld: bool
    ends: tuple[Frame, Frame]


@dataclass(frozen=True, slots=True)
class Goal:
    """What a frame is asked for."""

    frame: Frame
    position: Vector | None
    rotation: Matrix | None
    axis: Vector | None
    direction: Vector | None
    within: float


@dataclass(frozen=True, slots=True)
class Region:
    """Rows `A p <= b` of a point of a frame."""

    frame: Frame
    point: Vector
    normals: tuple[Vector, ...]
    ends: tuple[Span, ...]
    equal: tuple[bool, ...]


@dataclass(frozen=True, slots=True)
class Reference:
    """All links at the reference, and the values of hinges and slides."""

    rotations: tuple[Matrix, ...]
    origins: tuple[Vector, ...]
    values: tuple[float, ...]


@dataclass(frozen=True, slots=True)
class Question:
    """All of it; `steps` by joint, infinite ones None."""

    joints: tuple[Joint, ...]
    ties: tuple[Tie, ...]
    goals: tuple[Goal, ...]
    regions: tuple[Region, ...]
    reference: Reference | None
    steps: tuple[tuple[float | None, ...], ...] | None
    link_rotation: float | None
    tolerances: tuple[float, ...]

    @property
    def rows(self) -> int:
        """Rows of all regions."""
        return sum(len(region.ends) for region in self.regions)


def read_question(document: Any) -> Question:
    """A question from its JSON value.

    Raises:
        RefusedError: it is none.
    """
    if not isinstance(document, dict) or document.get("format") != FORMAT:
        raise RefusedError(f"the question's format is not {FORMAT}")
    joints = tuple(_joint(entry, k) for k, entry in enumerate(member(document, "joints", list, "it")))
    links = len(joints) + 1
    if links < 2:
        raise RefusedError("nothing moves")
    ties = tuple(_tie(entry, links) for entry in member(document, "closures", list, "it"))
    goals = tuple(_goal(entry, links) for entry in member(document, "goals", list, "it"))
    regions = tuple(_region(entry, links) for entry in member(document, "regions", list, "it"))
    reference = _reference(document.get("reference"), links)
    steps = _steps(document.get("max_step"), joints)
    limit = document.get("max_link_rotation")
    held = None if limit is None else double(limit, "max_link_rotation")
    if reference is None and not (steps is None and held is None):
        raise RefusedError("bounds need a reference")
    allowed = member(document, "tolerances", dict, "the question")
    tolerances = tuple(
        double(allowed.get(name), name) for name in ("position", "rotation", "closure", "region")
    )
    return Question(joints, ties, goals, regions, reference, steps, held, tolerances)


def _joint(entry: Any, k: int) -> Joint:
    what = f"joint {k}"
    kind, parent = member(entry, "kind", str, what), entry.get("parent")
    if kind not in KINDS or type(parent) is not int or not 0 <= parent <= k or (kind == "free" and parent):
        raise RefusedError(f"{what} is of no known kind, or hangs on nothing before it")
    place, rotation = _pose(entry, what)
    raw = doubles(entry.get("axis"), 3, f"the axis of {what}")
    raw = raw if kind in ("hinge", "slide") else _NO_AXIS
    _near_unit(raw, 1e-12, what)
    return Joint(kind, parent, place, rotation, unit(raw), raw, *_ends(entry, what))


def _ends(entry: Any, what: str) -> tuple[float | None, float | None]:
    lower, upper = (
        None if entry.get(name) is None else double(entry.get(name), f"{name} of {what}")
        for name in ("lower", "upper")
    )
    if lower is not None and upper is not None and not lower <= upper:
        raise RefusedError(f"{what} has no range")
    return lower, upper


def _near_unit(values: tuple[float, ...], most: float, what: str) -> None:
    size = length(span(value) for value in values)
    if not (span(1) - span(most) - size).high <= 0 <= (span(1) + span(most) - size).low:
        raise RefusedError(f"{what} has a direction that is no unit vector")


def _pose(entry: Any, what: str) -> tuple[Vector, Matrix]:
    if not isinstance(entry, dict):
        raise RefusedError(f"{what} is no object")
    try:
        rotation = rotation_of(doubles(entry.get("quat"), 4, f"quat of {what}"))
    except ZeroDivisionError:
        raise RefusedError(f"the quaternion of {what} is zero") from None
    return vector(doubles(entry.get("xyz"), 3, f"xyz of {what}")), rotation


def _frame(entry: Any, links: int, what: str) -> Frame:
    place, rotation = _pose(entry, what)
    link = entry.get("link")
    if type(link) is not int or not 0 <= link < links:
        raise RefusedError(f"{what} is on no link")
    return Frame(link, place, rotation)


def _tie(entry: Any, links: int) -> Tie:
    kind, tied = member(entry, "kind", str, "a closure"), member(entry, "links", list, "a closure")
    frames = member(entry, "frames", list, "a closure")
    if kind not in ("connect", "weld") or len(tied) != 2 or len(frames) != 2:
        raise RefusedError("a closure ties two links by connect or weld")
    one, two = (
        _frame({**frame, "link": link} if isinstance(frame, dict) else frame, links, "a closure")
        for frame, link in zip(frames, tied, strict=True)
    )
    return Tie(kind == "weld", (one, two))


def _goal(entry: Any, links: int) -> Goal:
    frame = _frame(entry, links, "a goal")
    found: dict[str, tuple[float, ...] | None] = {
        name: None if entry.get(name) is None else doubles(entry.get(name), 3, f"{name} of a goal")
        for name in ("position", "axis", "direction")
    }
    if (found["axis"] is None) != (found["direction"] is None):
        raise RefusedError("an axis needs its direction")
    for name in ("axis", "direction"):
        if (values := found[name]) is not None:
            _near_unit(values, _SHARP, "a goal")
    position, axis, direction = (
        None if values is None else vector(values)
        for values in (found["position"], found["axis"], found["direction"])
    )
    rotation = None if entry.get("rotation") is None else _rotation(entry["rotation"])
    within = double(entry.get("within"), "within")
    if not 0.0 <= within < 3.2:
        raise RefusedError("a cone is from 0 to less than a half turn")
    return Goal(frame, position, rotation, axis, direction, within)


def _rotation(rows: Any) -> Matrix:
    m = _matrix(rows)
    for i in range(3):
        for j in range(3):
            off = sum(((m[i][k] * m[j][k]) for k in range(3)), span(-int(i == j)))
            if abs(off).high > span(_SHARP).low:
                raise RefusedError("a goal has a rotation that is none")
    (a, b, c), (d, e, f), (g, h, i_) = m
    if not (a * (e * i_ - f * h) - b * (d * i_ - f * g) + c * (d * h - e * g)).surely_positive:
        raise RefusedError("a goal has a rotation that is none")
    return m


def _matrix(rows: Any) -> Matrix:
    if not isinstance(rows, list) or len(rows) != 3:
        raise RefusedError("a matrix has three rows")
    first, second, third = (vector(doubles(row, 3, "a row of a matrix")) for row in rows)
    return first, second, third


def _region(entry: Any, links: int) -> Region:
    frame = _frame(entry, links, "a region")
    A, b, equal = (member(entry, name, list, "a region") for name in ("A", "b", "equal"))
    if not len(A) == len(b) == len(equal) > 0 or not all(type(one) is bool for one in equal):
        raise RefusedError("a region has as many rows of A as of b and equal")
    return Region(
        frame,
        vector(doubles(entry.get("point"), 3, "point of a region")),
        tuple(vector(doubles(row, 3, "a row of a region")) for row in A),
        tuple(span(double(value, "b of a region")) for value in b),
        tuple(equal),
    )


def _reference(entry: Any, links: int) -> Reference | None:
    if entry is None:
        return None
    R, p, values = (member(entry, name, list, "the reference") for name in ("R", "p", "values"))
    if not len(R) == len(p) == links == len(values) + 1:
        raise RefusedError("the reference has not all links")
    return Reference(
        tuple(_matrix(rows) for rows in R),
        tuple(vector(doubles(row, 3, "an origin of the reference")) for row in p),
        doubles(values, links - 1, "values of the reference"),
    )


def _steps(entry: Any, joints: tuple[Joint, ...]) -> tuple[tuple[float | None, ...], ...] | None:
    if entry is None:
        return None
    sizes = [STEPS[joint.kind] for joint in joints]
    if not isinstance(entry, list) or len(entry) != sum(sizes):
        raise RefusedError(f"max_step has not {sum(sizes)} numbers")
    numbers = [None if value is None else double(value, "max_step") for value in entry]
    if not all(value is None or value > 0 for value in numbers):
        raise RefusedError("a step is not above zero")
    found, at = [], 0
    for size in sizes:
        found.append(tuple(numbers[at : at + size]))
        at += size
    return tuple(found)
