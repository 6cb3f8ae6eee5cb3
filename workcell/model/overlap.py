"""Robots and mechanisms that stand in something before anything moves, in words."""

from __future__ import annotations

from workcell.model.collision_model import CollisionModel
from workcell.model.mechanism.measuring import measure_of
from workcell.model.scene import Scene
from workcell.model.scene_mechanism import SceneMechanism
from workcell.model.scene_parts import SceneRobot


def start_overlap(scene: Scene, robot: str) -> tuple[str, str] | None:
    """What overlaps where a robot starts, and how deep; and what mends it. None: the start is clear."""
    actor = scene.robot(robot)
    start = CollisionModel(scene, robot).distance(actor.start)
    if start.distance >= 0:
        return None
    first, second = start.pair
    told = f"{first} and {second} overlap by {-1e3 * start.distance:.1f} mm"
    a, b = start.geoms
    return told, f"give a clear start{remedy(scene, actor, (a, b))}"


def mechanism_overlap(moving: SceneMechanism) -> str:
    """What overlaps where a mechanism starts, and how deep; empty: nothing does."""
    found = measure_of(moving.mechanism).distance(moving.start)
    if found.distance >= 0:
        return ""
    first, second = found.pair
    return f"{first} and {second} overlap by {-1e3 * found.distance:.1f} mm"


def remedy(scene: Scene, robot: SceneRobot, geoms: tuple[int, int]) -> str:
    """What can be done about two geoms that overlap, to go behind what does, in a format that can hold it."""
    model = scene.model
    bodies = [int(model.geom_bodyid[g]) for g in geoms]
    if not robot.own_ids.issuperset(bodies):
        return "; move the robot, or what it stands in"
    names = [model.body(body).name.removeprefix(robot.prefix) for body in bodies]
    exclude = '<contact><exclude body1="{}" body2="{}"/></contact>'
    if robot.source is not None and robot.source.suffix.lower() != ".urdf":
        return f"; if they are meant to overlap, write into {robot.source.name}: {exclude.format(*names)}"
    prefixed = exclude.format(*(f"NAME/{name}" for name in names))
    return (
        "; if they are meant to overlap: a URDF can't hold an exclusion, so make one collision shape smaller or leave "
        f"it out, or write into the cell in which the robot is mounted as NAME: {prefixed}, or keep the robot as MJCF "
        f"(mujoco.MjSpec.from_file(...).to_xml()) and write into that: {exclude.format(*names)}"
    )
