"""Task files (`workcell-task/1`, TOML): read and validated; every complaint names the file and the key."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np

from workcell.errors import InputError, UnknownNameError
from workcell.model.loading.toml_reader import TomlReader, is_number, read_toml
from workcell.pose import Pose

FORMAT = "workcell-task/1"


@dataclass(frozen=True, slots=True)
class RobotEntry:
    """`[[robots]]`: a model mounted at a site of the cell, with an optional gripper.

    `tool` names the site that is placed, where it is not to be the robot's own choice.
    """

    name: str
    model: str
    mount: str | None = None
    gripper: str | None = None
    gripper_site: str = "tool"
    start: tuple[float, ...] | None = None
    tool: str | None = None


@dataclass(frozen=True, slots=True)
class ObjectEntry:
    """`[[objects]]`: a model placed at a site of the cell, free to move unless fixed.

    A seed moves it by up to `vary_xyz` (3) metres along each axis of the site, and turns it by up to `vary_yaw` radians
    about the site's z axis.
    """

    name: str
    model: str
    place: str
    fixed: bool = False
    vary_xyz: tuple[float, ...] = (0.0, 0.0, 0.0)
    vary_yaw: float = 0.0


@dataclass(frozen=True, slots=True)
class GoalEntry:
    """`[[goals]]`: a tool pose relative to a site of the compiled model, or to the world."""

    name: str
    robot: str
    relative_to: str
    offset: Pose


@dataclass(frozen=True, slots=True)
class MechanismEntry:
    """`[mechanism]`: joints of any kind, with or without loops, that move where there is no arm with a tool.

    `joints` names those that move, where it is not all of the cell; `frames` the sites (or bodies) that a run watches;
    `start` values by joint, for where it begins. Joints that nothing drives are found from the others.
    """

    name: str
    joints: tuple[str, ...] | None = None
    frames: tuple[str, ...] = ()
    start: Mapping[str, float | tuple[float, ...]] = field(default_factory=dict)


@dataclass(frozen=True, slots=True)
class TaskFile:
    """A task file as it stands, before anything is compiled."""

    path: Path
    name: str
    cell: str
    robots: tuple[RobotEntry, ...] = ()
    objects: tuple[ObjectEntry, ...] = ()
    goals: tuple[GoalEntry, ...] = ()
    mechanism: MechanismEntry | None = None
    task: Mapping[str, Any] = field(default_factory=dict)


def read_task_file(path: Path) -> TaskFile:
    """Parse and validate; raises ModelError naming the file and the key."""
    reader, table = TomlReader(path), read_toml(path)
    reader.format(table, FORMAT)
    reader.only_keys(
        table,
        {"format", "name", "description", "cell", "robots", "objects", "goals", "mechanism", "task"},
        "",
    )
    robots = tuple(_robot(reader, entry, k) for k, entry in enumerate(reader.tables(table, "robots")))
    objects = tuple(_object(reader, entry, k) for k, entry in enumerate(reader.tables(table, "objects")))
    goals = tuple(_goal(reader, entry, k, robots) for k, entry in enumerate(reader.tables(table, "goals")))
    mechanism = _mechanism(reader, table)
    if robots and mechanism is not None:
        raise reader.error("mechanism", "stands beside robots", "one of the two")
    reader.unique(
        [*(r.name for r in robots), *(o.name for o in objects), *([mechanism.name] if mechanism else [])],
        "robots and objects",
    )
    reader.unique([g.name for g in goals], "goals")
    task = table.get("task", {})
    if not isinstance(task, dict):
        raise reader.error("task", "must be a table", "[task]")
    return TaskFile(
        path,
        reader.name(table, "", default=path.stem),
        reader.text(table, "cell", ""),
        robots,
        objects,
        goals,
        mechanism,
        task,
    )


def _mechanism(reader: TomlReader, table: Mapping[str, Any]) -> MechanismEntry | None:
    entry, at = table.get("mechanism"), "mechanism"
    if entry is None:
        return None
    if not isinstance(entry, dict):
        raise reader.error(at, "must be a table", "[mechanism]")
    reader.only_keys(entry, {"name", "joints", "frames", "start"}, at)
    start = entry.get("start", {})
    if not isinstance(start, dict):
        raise reader.error(f"{at}.start", f"is {start!r}", "a table of joints")
    values = {
        name: reader.numbers({name: [value] if is_number(value) else value}, name, f"{at}.start")
        for name, value in start.items()
    }
    joints = reader.texts(entry, "joints", at) if "joints" in entry else None
    return MechanismEntry(reader.name(entry, at), joints, reader.texts(entry, "frames", at), values)


def _robot(reader: TomlReader, entry: Mapping[str, Any], k: int) -> RobotEntry:
    at = f"robots[{k}]"
    reader.only_keys(entry, {"name", "model", "mount", "gripper", "gripper_site", "start", "tool"}, at)
    start = entry.get("start", "home")
    if isinstance(start, str) and start != "home":
        raise reader.error(f"{at}.start", f"is {start!r}", '"home", or one number for each joint')
    values = None if start == "home" else reader.numbers(entry, "start", at)
    return RobotEntry(
        name=reader.name(entry, at),
        model=reader.text(entry, "model", at),
        mount=reader.text(entry, "mount", at, default=""),
        gripper=reader.text(entry, "gripper", at, default="") or None,
        gripper_site=reader.text(entry, "gripper_site", at, default="tool"),
        start=values,
        tool=reader.text(entry, "tool", at, default="") or None,
    )


def _object(reader: TomlReader, entry: Mapping[str, Any], k: int) -> ObjectEntry:
    at = f"objects[{k}]"
    reader.only_keys(entry, {"name", "model", "place", "fixed", "vary_xyz", "vary_yaw"}, at)
    fixed = reader.truth(entry, "fixed", at)
    vary_xyz = reader.numbers(entry, "vary_xyz", at, default=(0.0, 0.0, 0.0))
    vary_yaw = reader.number(entry, "vary_yaw", at, default=0.0)
    if len(vary_xyz) != 3 or min(*vary_xyz, vary_yaw) < 0:
        raise reader.error(
            at, "has a bad vary_xyz or vary_yaw", "three half-widths and one angle, none below 0"
        )
    if fixed and (any(vary_xyz) or vary_yaw):
        raise reader.error(at, "is fixed and varies", "one of the two")
    return ObjectEntry(
        reader.name(entry, at),
        reader.text(entry, "model", at),
        reader.text(entry, "place", at),
        fixed,
        vary_xyz,
        vary_yaw,
    )


def _goal(reader: TomlReader, entry: Mapping[str, Any], k: int, robots: tuple[RobotEntry, ...]) -> GoalEntry:
    at = f"goals[{k}]"
    reader.only_keys(entry, {"name", "robot", "relative_to", "xyz", "quat_wxyz"}, at)
    robot = reader.text(entry, "robot", at, default=robots[0].name if len(robots) == 1 else "")
    if robot not in [r.name for r in robots]:
        raise UnknownNameError("robot", robot, [r.name for r in robots], where=f"{reader.path}: {at}.robot")
    xyz = reader.numbers(entry, "xyz", at)
    quat = reader.numbers(entry, "quat_wxyz", at, default=(1.0, 0.0, 0.0, 0.0))
    try:
        offset = Pose(np.array(xyz), np.array(quat))
    except InputError as error:
        raise reader.error(
            at, f"is not a pose: {error}", "xyz in metres and a unit quaternion quat_wxyz"
        ) from None
    name = reader.name(entry, at)
    return GoalEntry(name, robot, reader.text(entry, "relative_to", at, default="world"), offset)
