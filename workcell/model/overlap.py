"""Robots that stand in something before anything moves, in words."""

from __future__ import annotations

from workcell.model.collision_model import CollisionModel
from workcell.model.scene import Scene


def start_overlap(scene: Scene, robot: str) -> tuple[str, str] | None:
    """What overlaps where a robot starts, and how deep; and what mends it. None: the start is clear."""
    actor = scene.robot(robot)
    start = CollisionModel(scene, robot).distance(actor.start)
    if start.distance >= 0:
        return None
    first, second = start.pair
    remedy = "give a clear start, or move what it stands in"
    bodies = [int(scene.model.geom_bodyid[geom]) for geom in start.geoms]
    if actor.own_ids.issuperset(bodies):
        a, b = (scene.model.body(body).name.removeprefix(actor.prefix) for body in bodies)
        remedy = (
            "give a start without it; links that are meant to overlap are excluded in the robot's file: "
            f'<contact><exclude body1="{a}" body2="{b}"/></contact>'
        )
    return f"{first} and {second} overlap by {-1e3 * start.distance:.1f} mm", remedy
