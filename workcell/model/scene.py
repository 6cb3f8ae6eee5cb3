"""`Scene`: one compiled MuJoCo model of a cell with its robots, objects and named goals."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from pathlib import Path
from types import MappingProxyType
from typing import TYPE_CHECKING, Any, NoReturn

import numpy as np

from workcell.errors import InputError, UnknownNameError
from workcell.model.loading.actuators import servo_range
from workcell.model.loading.assets import find_asset
from workcell.model.loading.build import (
    Mounted,
    add_grasp_welds,
    attach_robot,
    obstacles_of,
    robots_inside,
    scene_object,
    scene_robot,
    settled_joints,
    task_of,
)
from workcell.model.loading.load import compile_spec, load_spec
from workcell.model.loading.placing import attach_object, variation
from workcell.model.loading.subtrees import members
from workcell.model.loading.taskfile import RobotEntry, TaskFile
from workcell.model.loading.warnings import heard_warnings, quiet_mujoco
from workcell.model.scene_mechanism import SceneMechanism, scene_mechanism
from workcell.model.scene_parts import Goal, SceneObject, SceneRobot, body_pose, site_pose
from workcell.pose import Array, Pose, read_only

if TYPE_CHECKING:
    import mujoco


@dataclass(frozen=True, slots=True)
class Scene:
    """A compiled cell. Build one with `Scene.load`.

    Robots on a carriage, a lift or another robot stand where that is as the scene begins.

    Attributes:
        name: the task's or the cell's name.
        path: the file it came from.
        model: the compiled MuJoCo model: the truth about geometry and dynamics.
        robots, objects, goals: by name.
        obstacles: names of the fixed bodies with collision geometry that belong to no robot and no object.
        task: the `[task]` table of the task file; a key that it lacks raises UnknownNameError.
        placed: (address in qpos, value) of the cell's own joints that begin elsewhere than the model has them, such as
            those of a closed chuck (see `workcell.model.grip.actuated`), and those that are locked, or follow others.
        warnings: what MuJoCo warned of while it read and compiled the files, each once.
        mechanism: what moves in a scene whose task file says `[mechanism]`; such a scene has no robots.
    """

    name: str
    path: Path
    model: mujoco.MjModel
    robots: Mapping[str, SceneRobot]
    objects: Mapping[str, SceneObject]
    goals: Mapping[str, Goal]
    obstacles: tuple[str, ...]
    task: Mapping[str, Any] = field(default_factory=dict)
    placed: tuple[tuple[int, float], ...] = ()
    warnings: tuple[str, ...] = ()
    mechanism: SceneMechanism | None = None

    def __post_init__(self) -> None:
        for name in ("robots", "objects", "goals"):
            object.__setattr__(self, name, MappingProxyType(dict(getattr(self, name))))
        object.__setattr__(self, "task", MappingProxyType(_Settings(self.task, self.path)))
        begin = self.initial_qpos()
        standing = {name: robot.standing(self.model, begin) for name, robot in self.robots.items()}
        object.__setattr__(self, "robots", MappingProxyType(standing))

    @staticmethod
    def load(source: str | Path, *, robot: str | None = None, seed: int | None = None) -> Scene:
        """Load a task file (TOML), a cell (MJCF), or either by name.

        Args:
            source: a task name, a cell name, or the path of a `.toml` or `.xml` file.
            robot: use this robot model in place of the task's (a cell alone gets it mounted at its site
                `robot_mount`, or at the world's origin).
            seed: draws where the objects stand that vary (`vary_xyz`, `vary_yaw`); None: each exactly in its place.

        Raises:
            ModelError: a missing or malformed file, naming the element; UnknownNameError: an unknown name.
        """
        return build_scene(source, robot, seed)

    def robot(self, name: str | None = None) -> SceneRobot:
        """The robot of that name, or the only one; raises UnknownNameError, InputError where it takes a name."""
        if name is None and len(self.robots) == 1:
            return next(iter(self.robots.values()))
        if name is None:
            raise InputError(
                f"there are {len(self.robots)} robots: name one" if self.robots else "there is no robot here",
                where=self.path,
                remedy=f"known: {', '.join(self.robots)}" if self.robots else "mount one: robot=, or --robot",
            )
        if name not in self.robots:
            raise UnknownNameError("robot", name, self.robots, where=self.path)
        return self.robots[name]

    def goal(self, name: str) -> Goal:
        """The goal of that name; raises UnknownNameError."""
        if name not in self.goals:
            raise UnknownNameError("goal", name, self.goals, where=self.path)
        return self.goals[name]

    def object(self, name: str) -> SceneObject:
        """The object of that name; raises UnknownNameError."""
        if name not in self.objects:
            raise UnknownNameError("object", name, self.objects, where=self.path)
        return self.objects[name]

    def moved(self, objects: Mapping[str, Pose]) -> Scene:
        """The same scene beginning with some objects elsewhere, by world pose of their root bodies.

        Goals stay where they are.

        Raises:
            UnknownNameError: no such object; InputError: a fixed one.
        """
        import copy

        model = copy.copy(self.model)
        for name, pose in objects.items():
            thing = self.object(name)
            if thing.qpos_address is None:
                raise InputError(f"the object {name!r} is fixed", where="objects", remedy="move a free one")
            thing.place(model.qpos0, pose)
        if self.mechanism is None:
            return replace(self, model=model)
        qpos = np.array(self.initial_qpos())
        for name, pose in objects.items():
            self.object(name).place(qpos, pose)
        return replace(self, model=model, mechanism=self.mechanism.inside(model, qpos))

    def with_start(self, robot: str, q: Array) -> Scene:
        """The same scene with a robot beginning at `q` (n,); raises UnknownNameError, InputError."""
        actor = self.robot(robot)
        actor.robot.check_limits(q, where=f"start of {robot!r}")
        return replace(self, robots={**self.robots, robot: replace(actor, start=read_only(q))})

    def drivable(self) -> Scene:
        """The same scene with joint limits that the robots' position servos can keep, for what is to be executed.

        A servo can't hold a joint where its `ctrlrange` does not reach. Limits still hold the start.
        """
        robots = dict(self.robots)
        for name, actor in robots.items():
            lower, upper = np.array(actor.robot.lower), np.array(actor.robot.upper)
            for k, actuator in enumerate(map(int, actor.actuator_ids)):
                held = servo_range(self.model, actuator) if actuator >= 0 else None
                if held is not None:
                    lower[k] = max(lower[k], min(held[0], actor.start[k]))
                    upper[k] = min(upper[k], max(held[1], actor.start[k]))
            if np.any(lower > actor.robot.lower) or np.any(upper < actor.robot.upper):
                robots[name] = replace(actor, robot=replace(actor.robot, lower=lower, upper=upper))
        return replace(self, robots=robots)

    def actuators(self) -> dict[str, int]:
        """Ids of the cell's own actuators, no robot's among them, by name: a chuck's, a door's."""
        mine = {int(a) for robot in self.robots.values() for a in robot.actuator_ids}
        mine |= {self.model.actuator(r.gripper).id for r in self.robots.values() if r.gripper is not None}
        return {self.model.actuator(a).name: a for a in range(self.model.nu) if a not in mine}

    def initial_qpos(self) -> Array:
        """MuJoCo positions (nq,) as the scene begins, robots at their starts, objects in their places; read-only."""
        qpos = np.array(self.model.qpos0)
        for address, value in self.placed:
            qpos[address] = value
        for robot in self.robots.values():
            for address, value in robot.fingers:
                qpos[address] = value
            robot.place(qpos, robot.start)
        if self.mechanism is not None:
            self.mechanism.place(qpos, self.mechanism.start)
        return read_only(qpos)

    def object_pose(self, name: str, qpos: Array | None = None) -> Pose:
        """World pose of an object's root body, initially or at raw positions (nq,); raises UnknownNameError."""
        body = self.object(name).body_id
        return body_pose(self.model, body, self.initial_qpos() if qpos is None else qpos)

    def body_pose(self, name: str, qpos: Array | None = None) -> Pose:
        """World pose of a body, initially or at raw positions (nq,); raises UnknownNameError."""
        bodies = [str(self.model.body(body).name) for body in range(self.model.nbody)]
        if name not in bodies:
            raise UnknownNameError("body", name, bodies, where=self.path)
        return body_pose(self.model, bodies.index(name), self.initial_qpos() if qpos is None else qpos)

    def site_pose(self, name: str, qpos: Array | None = None) -> Pose:
        """World pose of a site, initially or at raw positions (nq,); raises UnknownNameError."""
        return site_pose(self.model, name, self.initial_qpos() if qpos is None else qpos, self.path)


class _Settings(dict[str, Any]):
    """The `[task]` table, which names the file when a script asks it for a key that it lacks."""

    def __init__(self, table: Mapping[str, Any], path: Path) -> None:
        super().__init__(table)
        self._path = path

    def __missing__(self, key: str) -> NoReturn:
        raise UnknownNameError("key", key, self, where=f"{self._path}: [task]")


def build_scene(source: str | Path, robot: str | None, seed: int | None = None) -> Scene:
    """See `Scene.load`."""
    task = task_of(source, robot)
    where = f"{task.path}: cell" if task.cell != str(task.path) else None
    with heard_warnings() as heard:
        cell = load_spec(task.cell, kind="cells", relative_to=task.path.parent, where=where)
        scene = _compiled(cell, task, seed)
    return replace(scene, warnings=tuple(heard))


def scene_spec(source: str | Path, robot: str | None = None, seed: int | None = None) -> mujoco.MjSpec:
    """The model of `Scene.load`'s scene before it is compiled, to which bodies may be added; arguments as there."""
    task = task_of(source, robot)
    with heard_warnings():
        spec = load_spec(task.cell, kind="cells", relative_to=task.path.parent)
        _assemble(spec, task, seed)
    return spec


def _assemble(
    spec: mujoco.MjSpec, task: TaskFile, seed: int | None
) -> tuple[TaskFile, dict[str, Mounted], dict[str, mujoco.MjsBody]]:
    """Put robots and objects into a cell: the task as it is then, the robots, the objects' root bodies."""
    free = any(not entry.fixed for entry in task.objects)
    places = compile_spec(spec.copy(), task.cell) if free else None
    with quiet_mujoco(task.path):
        mounted = {entry.name: attach_robot(spec, entry, task) for entry in task.robots}
        placed = {
            entry.name: attach_object(spec, entry, task, variation(entry, k, seed), places)
            for k, entry in enumerate(task.objects)
        }
    if not task.robots and task.mechanism is None:
        task, mounted = robots_inside(spec, task)
    add_grasp_welds(spec, task, mounted, placed)
    return task, mounted, placed


def _compiled(spec: mujoco.MjSpec, task: TaskFile, seed: int | None = None) -> Scene:
    task, mounted, placed = _assemble(spec, task, seed)
    model = compile_spec(spec, task.path)
    roots = {("robot", name): [root.id for root in robot.roots] for name, robot in mounted.items()}
    bodies = members(model, roots | {("object", name): [root.id] for name, root in placed.items()})
    robots = {
        entry.name: scene_robot(model, entry, bodies["robot", entry.name], mounted[entry.name].home, task)
        for entry in task.robots
    }
    objects = {entry.name: scene_object(model, entry, bodies["object", entry.name]) for entry in task.objects}
    scene = Scene(
        name=task.name,
        path=task.path,
        model=model,
        robots=robots,
        objects=objects,
        goals={},
        obstacles=obstacles_of(model, robots, objects),
        task=task.task,
        placed=settled_joints(model, tuple(robots.values())),
    )
    if task.mechanism is not None:
        moving = scene_mechanism(model, scene.initial_qpos(), task.mechanism, task.path)
        fixed = _standing(model, scene.obstacles, moving.body_ids)
        scene = replace(scene, mechanism=moving, obstacles=fixed)
    return replace(scene, goals=_goals(scene, task))


def _standing(model: mujoco.MjModel, names: tuple[str, ...], moving: frozenset[int]) -> tuple[str, ...]:
    """Those of some bodies' names that are of none that moves."""
    taken = {str(model.body(body).name) for body in moving}
    return tuple(name for name in names if name not in taken)


def robot_scene(robot: str | Path) -> Scene:
    """A robot alone in an empty world, base at the world's origin; raises as `load_robot`."""
    import mujoco

    path = find_asset("robots", robot)
    task = TaskFile(path, path.stem, "", (RobotEntry(path.stem, str(path)),))
    with heard_warnings() as heard:
        scene = _compiled(mujoco.MjSpec(), task)
    return replace(scene, warnings=tuple(heard))


def _goals(scene: Scene, task: TaskFile) -> dict[str, Goal]:
    goals = {}
    qpos = scene.initial_qpos()
    for entry in task.goals:
        frame = Pose.identity()
        if entry.relative_to != "world":
            frame = site_pose(
                scene.model, entry.relative_to, qpos, f"{task.path}: goal {entry.name!r} relative_to"
            )
        goals[entry.name] = Goal(entry.name, entry.robot, frame @ entry.offset)
    return goals
