"""Problem sets by `workcell-ikset/1`, read for the checker alone: chain, spheres, obstacles, targets."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from workcell.proofs.exact.reading import MOST_BYTES, RefusedError, double, doubles, member, parse, read_text
from workcell.proofs.exact.spans import Span, span
from workcell.proofs.exact.vectors import Matrix, Vector, rotation_of, unit, vector

SLACK = 1e-6


@dataclass(frozen=True, slots=True)
class Joint:
    """Joint k: what it adds to the link before, and how far it turns."""

    offset: Vector
    rotation: Matrix
    axis: Vector
    raw_axis: tuple[float, ...]
    lower: float
    upper: float


@dataclass(frozen=True, slots=True)
class Sphere:
    """A sphere of the robot, in its link's frame."""

    link: int
    centre: Vector
    radius: float


@dataclass(frozen=True, slots=True)
class Obstacle:
    """A box (three half sides), a sphere (a radius) or a cylinder (radius, half length)."""

    sort: str
    number: int
    centre: Vector
    axes: Matrix
    sizes: tuple[float, ...]

    @property
    def name(self) -> str:
        """As statements name it: counted within its sort."""
        return f"{self.sort} {self.number}"


@dataclass(frozen=True, slots=True)
class Arm:
    """The chain, its tool and its spheres."""

    joints: tuple[Joint, ...]
    tool: Vector
    tool_rotation: Matrix
    spheres: tuple[Sphere, ...]


@dataclass(frozen=True, slots=True)
class Problem:
    """One target among obstacles."""

    id: str
    arm: Arm
    target: Vector
    target_rotation: Matrix
    obstacles: tuple[Obstacle, ...]


def read_problems(file: Path) -> dict[str, Problem]:
    """The problems of a set, by id.

    Raises:
        RefusedError: the file is no problem set.
    """
    document = parse(read_text(file, MOST_BYTES))
    if not isinstance(document, dict) or document.get("format") != "workcell-ikset/1":
        raise RefusedError("the file is no problem set: its format is not workcell-ikset/1")
    arm = _arm(member(document, "robot", dict, "the set"))
    found: dict[str, Problem] = {}
    for entry in member(document, "problems", list, "the set"):
        problem = _problem(entry, arm)
        if problem.id in found:
            raise RefusedError(f"two problems have the id {problem.id!r}")
        found[problem.id] = problem
    return found


def _arm(robot: Any) -> Arm:
    joints = tuple(
        _joint(entry, f"joint {k}") for k, entry in enumerate(member(robot, "joints", list, "the robot"), 1)
    )
    if not joints:
        raise RefusedError("the robot has no joints")
    tool = member(robot, "tool", dict, "the robot")
    spheres = []
    rows = robot.get("spheres", [])
    if not isinstance(rows, list):
        raise RefusedError("the robot's spheres are no list")
    for s, row in enumerate(rows):
        link, *centre, radius = doubles(row, 5, f"sphere {s}")
        if link not in range(len(joints) + 1) or not radius >= 0:
            raise RefusedError(f"sphere {s} is on no link, or has a radius below zero")
        spheres.append(Sphere(int(link), vector(centre), radius))
    place, rotation = _pose(tool, "the tool")
    return Arm(joints, place, rotation, tuple(spheres))


def _joint(entry: Any, what: str) -> Joint:
    place, rotation = _pose(entry, what)
    axis = doubles(entry.get("axis"), 3, f"the axis of {what}")
    lower, upper = (double(entry.get(end), f"{end} of {what}") for end in ("lower", "upper"))
    if not lower <= upper:
        raise RefusedError(f"{what} has no range")
    try:
        return Joint(place, rotation, unit(axis), axis, lower, upper)
    except ZeroDivisionError:
        raise RefusedError(f"the axis of {what} is zero") from None


def _pose(entry: Any, what: str) -> tuple[Vector, Matrix]:
    if not isinstance(entry, dict):
        raise RefusedError(f"{what} is no object")
    try:
        place = vector(doubles(entry.get("xyz"), 3, f"xyz of {what}"))
        return place, rotation_of(doubles(entry.get("quat"), 4, f"quat of {what}"))
    except ZeroDivisionError:
        raise RefusedError(f"the quaternion of {what} is zero") from None


def _problem(entry: Any, arm: Arm) -> Problem:
    identity = member(entry, "id", str, "a problem")
    target, rotation = _pose(entry.get("target"), f"the target of {identity}")
    obstacles = entry.get("obstacles", {})
    if not isinstance(obstacles, dict):
        raise RefusedError(f"the obstacles of {identity} are no object")
    return Problem(identity, arm, target, rotation, tuple(_obstacles(obstacles)))


def _obstacles(document: dict[str, Any]) -> Iterable[Obstacle]:
    for sort, sizes in (("box", None), ("sphere", ("radius",)), ("cylinder", ("radius", "half_length"))):
        entries = document.get({"box": "boxes"}.get(sort, f"{sort}s"), [])
        if not isinstance(entries, list):
            raise RefusedError(f"the obstacles of sort {sort} are no list")
        for number, entry in enumerate(entries):
            yield _obstacle(sort, number, entry, sizes)


def _obstacle(sort: str, number: int, entry: Any, sizes: tuple[str, ...] | None) -> Obstacle:
    what = f"{sort} {number}"
    if not isinstance(entry, dict):
        raise RefusedError(f"{what} is no object")
    if sizes is None:
        extent = doubles(entry.get("half"), 3, f"half of {what}")
    else:
        extent = tuple(double(entry.get(size), f"{size} of {what}") for size in sizes)
    if not all(value >= 0 for value in extent):
        raise RefusedError(f"{what} has a size below zero")
    try:
        axes = rotation_of(doubles(entry.get("quat", [1, 0, 0, 0]), 4, f"quat of {what}"))
    except ZeroDivisionError:
        raise RefusedError(f"the quaternion of {what} is zero") from None
    return Obstacle(sort, number, vector(doubles(entry.get("centre"), 3, f"centre of {what}")), axes, extent)


def limit_middle(joint: Joint) -> Span:
    """mid_k of rule 7.2."""
    return (span(joint.lower) + span(joint.upper)) * span(0.5)
