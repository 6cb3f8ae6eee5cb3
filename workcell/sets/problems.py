"""Problem-set files (`workcell-ikset/1`): one robot, many targets with their obstacles.

Everything that is wrong in one is named.
"""

from __future__ import annotations

import json
import math
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from workcell.errors import InputError
from workcell.files import parse_json, regular_text
from workcell.geometry.types import Piece, SphereCover
from workcell.ik.problem import IKProblem
from workcell.model.robot import LIMIT_SLACK, Robot
from workcell.model.serial import serial_robot
from workcell.pose import UNIT_TOLERANCE, Array, Pose, read_only

FORMAT = "workcell-ikset/1"

_LARGEST = 1e6
"""Metres or radians beyond which a number can only be a mistake (and arithmetic loses digits)."""

_LONGEST = 1000
"""Characters of a name."""


@dataclass(frozen=True, slots=True)
class NamedProblem:
    """One problem of a set: its id, the question, and where a path to the answer begins (n,) or None."""

    id: str
    problem: IKProblem
    start: Array | None = None


@dataclass(frozen=True, slots=True)
class ProblemSet:
    """A problem-set file.

    Attributes:
        name: the set's label, e.g. `shelf`.
        robot: the file's own chain and limits; its tool is the one to place, its base the world.
        cover: the file's own spheres: the truth about the robot's shape (`given`).
        problems: in the file's order.
    """

    name: str
    robot: Robot
    cover: SphereCover
    problems: tuple[NamedProblem, ...]

    def __len__(self) -> int:
        return len(self.problems)


def load_problem_set(path: str | Path) -> ProblemSet:
    """Read and validate a problem-set file.

    Raises:
        InputError: the file can't be read, or something in it is missing, malformed or impossible; the message
            names the file, the problem's id and the element.
    """
    path = Path(path)
    return parse_problem_set(_read_json(path), str(path))


def parse_problem_set(document: Any, where: str = "problem set") -> ProblemSet:
    """The same from a parsed JSON document; `where` begins every message."""
    root = _Element(document, where)
    found = root.key("format").text()
    if found != FORMAT:
        raise root.key("format").error(f"the format is {found!r}", f"this version reads {FORMAT!r}")
    robot, cover = _robot(root.key("robot"))
    problems: dict[str, NamedProblem] = {}
    for element in root.key("problems").items():
        named = _problem(element, where, robot, cover)
        if named.id in problems:
            raise element.key("id").error(f"the id {named.id!r} occurs twice", "ids are unique in a file")
        problems[named.id] = named
    name = root.key("set").text() if root.has("set") else Path(where).stem
    return ProblemSet(name, robot, cover, tuple(problems.values()))


def _read_json(path: Path) -> Any:
    try:
        text = regular_text(path)
    except OSError as error:
        raise InputError(f"can't be read: {error.strerror}", where=path) from None
    except UnicodeDecodeError:
        raise InputError(
            "is not a text file", where=path, remedy=f"a JSON file of format {FORMAT!r}"
        ) from None
    try:
        return parse_json(text)
    except json.JSONDecodeError as error:
        raise InputError(
            f"is not JSON: {error.msg}", where=f"{path}, line {error.lineno}, column {error.colno}"
        ) from None
    except ValueError as error:
        raise InputError(str(error), where=path) from None


def _robot(element: _Element) -> tuple[Robot, SphereCover]:
    joints = [_joint(joint) for joint in element.key("joints").items()]
    if not joints:
        raise element.key("joints").error("the robot has no joint", "at least one")
    names = [joint["name"] for joint in joints]
    for k, name in enumerate(names):
        if name in names[:k]:
            raise element.key("joints").error(f"two joints are named {name!r}", "names are unique")
    robot = serial_robot(element.key("name").text(), joints, element.key("tool").pose())
    rows = [_sphere_row(row, robot.dof) for row in element.key("spheres").items()]
    table = np.array(rows, dtype=float).reshape(-1, 5)
    return robot, SphereCover(table[:, 0].astype(np.int64), table[:, 1:4], table[:, 4], kind="given")


def _joint(element: _Element) -> dict[str, Any]:
    name = element.key("name").text()
    lower, upper = element.key("lower").number(), element.key("upper").number()
    if lower > upper:
        raise element.error(
            f"the limits of {name!r} are reversed: lower {lower}, upper {upper}", "lower <= upper"
        )
    return {
        "name": name,
        "xyz": element.key("xyz").numbers(3),
        "quat": element.key("quat").unit(4),
        "axis": element.key("axis").unit(3),
        "lower": lower,
        "upper": upper,
    }


def _sphere_row(element: _Element, dof: int) -> list[float]:
    row = element.numbers(5)
    link, radius = row[0], row[4]
    if link != int(link) or not 0 <= link <= dof:
        raise element.error(f"there is no link {link:g}", f"a whole number from 0 (base) to {dof}")
    if radius <= 0:
        raise element.error(f"the radius is {radius:g}", "a positive number")
    return row


def _problem(element: _Element, file: str, robot: Robot, cover: SphereCover) -> NamedProblem:
    identity = element.key("id").text()
    element = _Element(element.value, f"{file}, problem {identity!r}")
    target = element.key("target").pose()
    problem = IKProblem(robot, target, _obstacles(element.key("obstacles")), cover)
    start = None
    if element.has("start"):
        start = read_only(element.key("start").numbers(robot.dof))
        _check_start(element.key("start"), robot, start)
    return NamedProblem(identity, problem, start)


def _check_start(element: _Element, robot: Robot, start: Array) -> None:
    for k in np.flatnonzero((start < robot.lower - LIMIT_SLACK) | (start > robot.upper + LIMIT_SLACK)):
        raise element.error(
            f"joint {robot.joint_names[k]!r} starts at {start[k]:g}, outside its limits",
            f"from {robot.lower[k]:g} to {robot.upper[k]:g}",
        )


def _obstacles(element: _Element) -> tuple[Piece, ...]:
    readers = {"boxes": _box, "spheres": _ball, "cylinders": _cylinder}
    for name in element.names():
        if name not in readers:
            raise element.error(f"unknown kind of obstacle {name!r}", ", ".join(readers))
    pieces = []
    for name, read in readers.items():
        if element.has(name):
            pieces += [read(item, k) for k, item in enumerate(element.key(name).items())]
    return tuple(pieces)


def _box(element: _Element, index: int) -> Piece:
    element.key("half").numbers(3)
    half = [size.positive() for size in element.key("half").items()]
    return Piece(f"box {index}", "box", element.obstacle_pose(), np.array(half))


def _ball(element: _Element, index: int) -> Piece:
    pose = Pose.from_xyz(element.key("centre").numbers(3))
    return Piece(f"sphere {index}", "sphere", pose, np.array([element.key("radius").positive()]))


def _cylinder(element: _Element, index: int) -> Piece:
    size = [element.key("radius").positive(), element.key("half_length").positive()]
    return Piece(f"cylinder {index}", "cylinder", element.obstacle_pose(), np.array(size))


@dataclass(frozen=True, slots=True)
class _Element:
    """A value of the document and where it stands, with typed access that complains precisely."""

    value: Any
    where: str

    def error(self, message: str, remedy: str) -> InputError:
        return InputError(message, where=self.where, remedy=remedy)

    def names(self) -> list[str]:
        if not isinstance(self.value, dict):
            raise self.error(f"expected an object, found {_describe(self.value)}", "{...}")
        return list(self.value)

    def has(self, name: str) -> bool:
        return name in self.names() and self.value[name] is not None

    def key(self, name: str) -> _Element:
        if name not in self.names():
            raise self.error(f"the key {name!r} is missing", f"keys here: {', '.join(self.value) or 'none'}")
        return _Element(self.value[name], f"{self.where}, {name}")

    def items(self) -> Iterator[_Element]:
        if not isinstance(self.value, list):
            raise self.error(f"expected a list, found {_describe(self.value)}", "[...]")
        return (_Element(item, f"{self.where}[{k}]") for k, item in enumerate(self.value))

    def text(self) -> str:
        if not isinstance(self.value, str) or not self.value:
            raise self.error(f"expected a name, found {_describe(self.value)}", "a non-empty string")
        if len(self.value) > _LONGEST or any("\ud800" <= letter <= "\udfff" for letter in self.value):
            raise self.error(
                f"the name {_describe(self.value)} is too long or holds half of a character",
                f"up to {_LONGEST} characters, each of them whole",
            )
        return self.value

    def number(self) -> float:
        if isinstance(self.value, bool) or not isinstance(self.value, int | float):
            raise self.error(f"expected a number, found {_describe(self.value)}", "a finite number")
        if abs(self.value) > _LARGEST or not math.isfinite(self.value):
            raise self.error(f"the number is {_describe(self.value)}", f"a finite number, up to {_LARGEST:g}")
        return float(self.value)

    def positive(self) -> float:
        value = self.number()
        if value <= 0:
            raise self.error(f"the size is {value:g}", "a positive number")
        return value

    def numbers(self, size: int) -> list[float]:
        items = list(self.items())
        if len(items) != size:
            raise self.error(f"expected {size} numbers, found {len(items)}", f"a list of {size}")
        return [item.number() for item in items]

    def unit(self, size: int) -> list[float]:
        values = self.numbers(size)
        length = math.sqrt(sum(value * value for value in values))
        if abs(length - 1) > UNIT_TOLERANCE:
            kind = "quaternion [w, x, y, z]" if size == 4 else "axis"
            raise self.error(
                f"the {kind} {values} has length {length:.7g}", f"a unit vector, to {UNIT_TOLERANCE:g}"
            )
        return [value / length for value in values]

    def pose(self) -> Pose:
        return Pose(np.array(self.key("xyz").numbers(3)), np.array(self.key("quat").unit(4)))

    def obstacle_pose(self) -> Pose:
        centre = self.key("centre").numbers(3)
        quat = self.key("quat").unit(4) if self.has("quat") else [1.0, 0.0, 0.0, 0.0]
        return Pose(np.array(centre), np.array(quat))


def _describe(value: Any) -> str:
    if value is None:
        return "null"
    text = json.dumps(value, default=str)
    return text if len(text) <= 40 else f"{text[:37]}..."
