"""Files of goals (`workcell-goals/1`, TOML): goals, regions and contacts of one question about a mechanism.

docs/goals.md describes the format. Every complaint names the file and the key.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any, TypeVar, get_args

import numpy as np

from workcell.errors import InputError
from workcell.ik.ikspark.mechanisms.forms import FormName
from workcell.ik.mechanisms.goals import FrameGoal, InRegion
from workcell.ik.mechanisms.problem import MechanismProblem, MechanismTolerances
from workcell.model.loading.toml_reader import TomlReader, is_number, read_toml
from workcell.model.mechanism.mechanism import Mechanism
from workcell.model.scene import Scene
from workcell.pose import Pose, read_only
from workcell.world.box_faces import body_geoms, standing_box
from workcell.world.mechanism_world import Held, MechanismWorld, mechanism_in

FORMAT = "workcell-goals/1"
_Made = TypeVar("_Made")


@dataclass(frozen=True, slots=True)
class Contact:
    """`[[contact]]`: a point (3,) of a frame on the face of a box that stands still.

    `on` names a box geom, or a body with one; `touches` the geoms that may touch it, where it is not all of those that
    stand on the frame's body; `inset` and `lift` are metres.
    """

    frame: str
    on: str
    face: str
    point: tuple[float, ...] = (0.0, 0.0, 0.0)
    inset: float = 0.0
    lift: float = 0.0
    touches: tuple[str, ...] | None = None


@dataclass(frozen=True, slots=True)
class Goals:
    """What a file of goals asks.

    Attributes:
        path: the file.
        goals, regions, contacts: all of them hold.
        held: bodies that move with a frame.
        moving: names of the joints that move; None: as the model has it.
        touching: pairs of geoms that may touch.
        start: values by joint, to begin at and to measure `max_step` from; empty: anywhere.
        max_step, max_link_rotation: as of `MechanismProblem`.
        margin: metres of clearance.
        form: of IKSPARK's lift.
        closest: whether the closest configuration is asked for where the goals can't be reached.
    """

    path: Path
    goals: tuple[FrameGoal, ...] = ()
    regions: tuple[InRegion, ...] = ()
    contacts: tuple[Contact, ...] = ()
    held: tuple[Held, ...] = ()
    moving: tuple[str, ...] | None = None
    touching: tuple[tuple[str, str], ...] = ()
    start: Mapping[str, tuple[float, ...]] = field(default_factory=dict)
    max_step: float | None = None
    max_link_rotation: float | None = None
    margin: float = 0.0
    form: FormName | None = None
    closest: bool = False

    def problem(self, scene: Scene | str | Path) -> MechanismProblem:
        """The question, asked of a scene, or of a robot, a cell or a task (name or path).

        Raises:
            ModelError, UnknownNameError, InputError: as `MechanismWorld.of` and `MechanismProblem`, or a contact that
                is on no box that stands still.
        """
        mechanism = mechanism_in(scene, moving=self.moving, held=self.held)
        regions, touching = list(self.regions), list(self.touching)
        for k, contact in enumerate(self.contacts):
            region, pairs = _on_box(contact, mechanism, f"{self.path}: contact[{k}]")
            regions.append(region)
            touching += pairs
        world = MechanismWorld.of(mechanism, touching=list(dict.fromkeys(touching)))
        asked = self.start or self.max_step is not None or self.max_link_rotation is not None
        start = world.mechanism.configuration(dict(self.start), where=f"{self.path}: options.start")
        return world.problem(
            self.goals,
            regions,
            q_reference=read_only(start) if asked else None,
            max_step=self.max_step,
            max_link_rotation=self.max_link_rotation,
            tolerances=MechanismTolerances(safety_margin=self.margin),
        )


def read_goals(path: Path) -> Goals:
    """Parse and validate; raises ModelError, UnknownNameError or InputError naming the file and the key."""
    table, reader = read_toml(path), TomlReader(path)
    reader.format(table, FORMAT)
    reader.only_keys(table, {"format", "goal", "region", "contact", "held", "options"}, "")
    goals = tuple(_goal(reader, entry, f"goal[{k}]") for k, entry in enumerate(reader.tables(table, "goal")))
    regions = tuple(
        _region(reader, entry, f"region[{k}]") for k, entry in enumerate(reader.tables(table, "region"))
    )
    contacts = tuple(
        _contact(reader, entry, f"contact[{k}]") for k, entry in enumerate(reader.tables(table, "contact"))
    )
    held = tuple(_held(reader, entry, f"held[{k}]") for k, entry in enumerate(reader.tables(table, "held")))
    if not (goals or regions or contacts):
        raise reader.error("goal", "is missing", "at least one [[goal]], [[region]] or [[contact]]")
    return Goals(path, goals, regions, contacts, held, **_options(reader, table.get("options", {})))


def _goal(reader: TomlReader, entry: Mapping[str, Any], at: str) -> FrameGoal:
    reader.only_keys(entry, {"frame", "position", "quat_wxyz", "axis", "direction", "within_deg"}, at)
    frame = reader.text(entry, "frame", at)
    position = reader.vector(entry, "position", at) if "position" in entry else None
    if "quat_wxyz" in entry and ("direction" in entry or "axis" in entry):
        raise reader.error(at, "has quat_wxyz and a direction", "one of the two")
    if not {"position", "quat_wxyz", "direction"} & set(entry):
        raise reader.error(at, "asks for nothing", "position, quat_wxyz or direction (with axis, within_deg)")
    if "direction" in entry:
        return _made(reader, at, lambda: _pointing(reader, entry, at, frame, position))
    for key in ("axis", "within_deg"):
        if key in entry:
            raise reader.error(f"{at}.{key}", "stands without direction", "a direction beside it")
    rotation = None
    if "quat_wxyz" in entry:
        quat = np.array(reader.vector(entry, "quat_wxyz", at, size=4))
        rotation = _made(reader, at, lambda: Pose(np.zeros(3), quat)).rotation
    return _made(reader, at, lambda: FrameGoal(frame, _array(position), rotation))


def _pointing(
    reader: TomlReader, entry: Mapping[str, Any], at: str, frame: str, position: tuple[float, ...] | None
) -> FrameGoal:
    axis = reader.vector(entry, "axis", at, default=(0.0, 0.0, 1.0))
    direction = reader.vector(entry, "direction", at)
    within = math.radians(reader.number(entry, "within_deg", at, default=0.0))
    return FrameGoal.pointing(frame, direction, axis, position=position, within=within)


def _region(reader: TomlReader, entry: Mapping[str, Any], at: str) -> InRegion:
    kinds = {"A": {"A", "b"}, "box_lower": {"box_lower", "box_upper"}, "normal": {"normal", "offset"}}
    reader.only_keys(entry, {"frame", "point", *set().union(*kinds.values())}, at)
    frame, point = reader.text(entry, "frame", at), reader.vector(entry, "point", at, default=(0.0, 0.0, 0.0))
    given = [kind for kind, keys in kinds.items() if keys & set(entry)]
    if len(given) != 1:
        raise reader.error(
            at,
            "says no region" if not given else f"says {len(given)} regions",
            "A and b, or box_lower and box_upper, or normal and offset",
        )
    if given == ["A"]:
        A, b = _matrix(reader, entry, at), np.array(reader.numbers(entry, "b", at))
        return _made(reader, at, lambda: InRegion.polytope(frame, A, b, point))
    if given == ["normal"]:
        normal = reader.vector(entry, "normal", at)
        if "offset" not in entry:
            raise reader.error(f"{at}.offset", "is missing", "normal . p = offset, metres")
        offset = reader.number(entry, "offset", at, default=0.0)
        return _made(reader, at, lambda: InRegion.plane(frame, normal, offset, point))
    lower, upper = (np.array(reader.vector(entry, key, at)) for key in ("box_lower", "box_upper"))
    if not np.all(lower <= upper):
        raise reader.error(f"{at}.box_lower", "is above box_upper", "the lower corner, then the upper one")
    ends = np.concatenate([upper, -lower])
    return InRegion.polytope(frame, np.vstack([np.eye(3), -np.eye(3)]), ends, point)


def _matrix(reader: TomlReader, entry: Mapping[str, Any], at: str) -> np.ndarray[Any, Any]:
    rows = entry.get("A")
    if not isinstance(rows, list) or not all(
        isinstance(row, list) and len(row) == 3 and all(map(is_number, row)) for row in rows
    ):
        raise reader.error(
            f"{at}.A", "is missing" if rows is None else f"is {rows!r}", "rows of 3 numbers each"
        )
    return np.array(rows, dtype=float).reshape(-1, 3)


def _contact(reader: TomlReader, entry: Mapping[str, Any], at: str) -> Contact:
    reader.only_keys(entry, {"frame", "on", "face", "point", "inset", "lift", "touches"}, at)
    inset = reader.number(entry, "inset", at, default=0.0)
    if inset < 0:
        raise reader.error(f"{at}.inset", f"is {inset:g}", "zero or more, metres from the edges")
    return Contact(
        reader.text(entry, "frame", at),
        reader.text(entry, "on", at),
        reader.text(entry, "face", at),
        reader.vector(entry, "point", at, default=(0.0, 0.0, 0.0)),
        inset,
        reader.number(entry, "lift", at, default=0.0),
        reader.texts(entry, "touches", at) if "touches" in entry else None,
    )


def _on_box(contact: Contact, mechanism: Mechanism, where: str) -> tuple[InRegion, list[tuple[str, str]]]:
    """The face that a contact is on, and the pairs of geoms that may touch for it."""
    box, T, half = standing_box(mechanism, contact.on, where)
    try:
        region = InRegion.on_face(
            contact.frame, T, half, contact.face, point=contact.point, inset=contact.inset, lift=contact.lift
        )
    except InputError as error:
        raise InputError(error.message, where=where, remedy=error.remedy) from None
    mechanism.frame(contact.frame)
    touches = body_geoms(mechanism, contact.frame) if contact.touches is None else contact.touches
    return region, [(geom, box) for geom in touches]


def _held(reader: TomlReader, entry: Mapping[str, Any], at: str) -> Held:
    reader.only_keys(entry, {"body", "frame", "position", "quat_wxyz"}, at)
    T = None
    if {"position", "quat_wxyz"} & set(entry):
        position = np.array(reader.vector(entry, "position", at, default=(0.0, 0.0, 0.0)))
        quat = np.array(reader.vector(entry, "quat_wxyz", at, size=4, default=(1.0, 0.0, 0.0, 0.0)))
        T = _made(reader, at, lambda: Pose(position, quat))
    return Held(reader.text(entry, "body", at), reader.text(entry, "frame", at), T)


def _options(reader: TomlReader, table: Any) -> dict[str, Any]:
    at = "options"
    if not isinstance(table, dict):
        raise reader.error(at, "must be a table", "[options]")
    positive = ("max_step", "max_link_rotation", "margin")
    reader.only_keys(table, {"moving", "touching", "start", "form", "closest", *positive}, at)
    found: dict[str, Any] = {"closest": reader.truth(table, "closest", at)}
    for key in positive:
        if key in table:
            found[key] = reader.number(table, key, at, default=0.0)
            if not (found[key] > 0 or (key == "margin" and found[key] == 0)):
                raise reader.error(f"{at}.{key}", f"is {found[key]:g}", "a positive number")
    if "moving" in table:
        found["moving"] = reader.texts(table, "moving", at)
    if "form" in table:
        found["form"] = reader.text(table, "form", at)
        if found["form"] not in get_args(FormName):
            raise reader.error(f"{at}.form", f"is {found['form']!r}", " or ".join(get_args(FormName)))
    found["touching"] = _pairs(reader, table, at)
    found["start"] = _start(reader, table.get("start", {}), f"{at}.start")
    return found


def _pairs(reader: TomlReader, table: Mapping[str, Any], at: str) -> tuple[tuple[str, str], ...]:
    pairs = table.get("touching", [])
    if not isinstance(pairs, list) or not all(
        isinstance(pair, list) and len(pair) == 2 and all(isinstance(name, str) for name in pair)
        for pair in pairs
    ):
        raise reader.error(f"{at}.touching", f"is {pairs!r}", "pairs of geoms, such as [['finger', 'cube']]")
    return tuple((str(one), str(two)) for one, two in pairs)


def _start(reader: TomlReader, table: Any, at: str) -> dict[str, tuple[float, ...]]:
    if not isinstance(table, dict):
        raise reader.error(at, f"is {table!r}", "a table of joints")
    return {
        name: reader.numbers({name: [value] if is_number(value) else value}, name, at)
        for name, value in table.items()
    }


def _made(reader: TomlReader, at: str, make: Callable[[], _Made]) -> _Made:
    """What is made of an entry; what is wrong with it names the file and the entry."""
    try:
        return make()
    except InputError as error:
        raise InputError(error.message, where=f"{reader.path}: {at}", remedy=error.remedy) from None


def _array(values: tuple[float, ...] | None) -> np.ndarray[Any, Any] | None:
    return None if values is None else np.array(values)
