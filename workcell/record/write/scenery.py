"""What of a compiled model is drawn where: bodies sorted into robots, objects and obstacles, with their shapes."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import numpy as np

from workcell.model.labels import body_name
from workcell.pose import Array
from workcell.record.shapes import Shape, body_shapes, has_visuals
from workcell.record.write.rrd import entity, rerun
from workcell.record.write.tracks import BodyPoses

if TYPE_CHECKING:
    import mujoco

    from workcell.model.scene import Scene


@dataclass(frozen=True, slots=True)
class Layer:
    """The visual or the collision shapes of one body, and the entity they are below.

    With a `carrier` the shapes follow that entity, so that no pose is written twice.
    """

    path: str
    body: int
    moves: bool
    shapes: tuple[Shape, ...]
    carrier: str | None = None


def owners_of_bodies(scene: Scene) -> dict[int, str]:
    """`robots/<name>` or `objects/<name>` for each body that belongs to one."""
    owners: dict[int, str] = {}
    for name, robot in scene.robots.items():
        owners |= {body: f"robots/{entity(name)}" for body in robot.own_ids}
    if scene.mechanism is not None:
        owners |= {body: f"robots/{entity(scene.mechanism.name)}" for body in scene.mechanism.own_ids}
    for name, thing in scene.objects.items():
        owners |= {body: f"objects/{entity(name)}" for body in thing.body_ids}
    return owners


def layers(model: mujoco.MjModel, owners: Mapping[int, str]) -> Iterator[Layer]:
    """Every body with something to draw. A body that is welded to the world does not move.

    A body without visuals is drawn by its collision geometry, but not where other bodies of the same robot or object
    have visuals: there it is the inside of what one sees.
    """
    dressed = {owners.get(body) for body in range(model.nbody) if has_visuals(model, body)} - {None}
    taken: set[tuple[str | None, str]] = set()
    for body in range(model.nbody):
        moves = int(model.body_weldid[body]) != 0
        visual, collision = body_shapes(model, body)
        owner = owners.get(body)
        if owner in dressed and not has_visuals(model, body):
            visual, collision = [], visual
        name = _body_name(model, body, owner)
        while (owner, name) in taken:  # two bodies of one name, apart from what is cut off, are drawn both
            name = f"{name}_{body}"
        taken.add((owner, name))
        above = f"world/obstacles/{name}" if owner is None else f"world/{owner}/visual/{name}"
        below = f"world/obstacles/{name}/collision" if owner is None else f"world/{owner}/collision/{name}"
        if visual or collision:
            yield Layer(above, body, moves, tuple(_distinct(visual)))
        if collision:
            yield Layer(below, body, moves, tuple(_distinct(collision)), carrier=above)


def _body_name(model: mujoco.MjModel, body: int, owner: str | None) -> str:
    """The body's name without its owner's prefix: `sawyer/gripper/left_finger` is `gripper.left_finger`."""
    parts = body_name(model, body).split("/")
    prefixed = owner is not None and len(parts) > 1 and owner.partition("/")[2] == entity(parts[0])
    return entity(".".join(parts[1:] if prefixed else parts))


def _distinct(shapes: list[Shape]) -> Iterator[Shape]:
    """Shapes with names that differ, so that none hides another."""
    from dataclasses import replace

    seen: dict[str, int] = {}
    for shape in shapes:
        count = seen[shape.name] = seen.get(shape.name, 0) + 1
        yield shape if count == 1 else replace(shape, name=f"{shape.name}_{count}")


def world_axes() -> tuple[Any, ...]:
    """Tells the viewer that z is up."""
    return (rerun().ViewCoordinates.RIGHT_HAND_Z_UP,)


def eye(scene: Scene) -> tuple[Array, Array]:
    """A camera position and the point it looks at: the robots from their right-hand side as they face the goals."""
    positions, _ = BodyPoses(scene.model)(scene.initial_qpos()[None])
    moving = np.flatnonzero(scene.model.body_weldid != 0)
    goals = np.array([goal.pose.position for goal in scene.goals.values()]).reshape(-1, 3)
    points = np.concatenate([positions[0][moving], goals])
    if not len(points):
        points = positions[0]
    centre = (points.min(axis=0) + points.max(axis=0)) / 2
    bases = np.array([robot.robot.T_world_base.position for robot in scene.robots.values()]).reshape(-1, 3)
    ahead = (goals.mean(axis=0) if len(goals) else centre) - (bases.mean(axis=0) if len(bases) else centre)
    ahead[2] = 0.0
    ahead = ahead / np.linalg.norm(ahead) if np.linalg.norm(ahead) > 1e-6 else np.array([1.0, 0.0, 0.0])
    right = np.array([ahead[1], -ahead[0], 0.0])
    reach = max(float(np.linalg.norm(np.ptp(points, axis=0))), 0.5)
    return centre + 1.5 * reach * (right - 0.45 * ahead + np.array([0.0, 0.0, 0.5])), centre
