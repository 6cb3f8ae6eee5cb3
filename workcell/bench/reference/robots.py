"""A robot alone at the world's origin, with its spheres: what benches draw their problems for."""

from __future__ import annotations

from workcell.geometry.types import SphereCover
from workcell.model.robot import Robot

ROBOTS = ("sawyer", "ur10", "iiwa14")
"""Those that travel with workcell, in the order of the tables."""
OVERSHOOT = 0.03
"""Metres by which the spheres of the generated sets may exceed the robots' shapes: about as coarse as covers made by
hand."""


def bench_robot(name: str) -> tuple[Robot, SphereCover]:
    """A robot alone, serial up to its tool and based at the world's origin, and spheres, which are
    the truth of the generated sets."""
    from workcell.geometry.covers.outer import robot_cover
    from workcell.model.scene import robot_scene

    scene = robot_scene(name)
    actor = scene.robot()
    outer = robot_cover(scene.model, actor, overshoot=OVERSHOOT)
    return actor.robot.chain(), SphereCover(outer.link, outer.centre, outer.radius, kind="given")
