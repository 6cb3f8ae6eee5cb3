"""Sphere cover of a robot whose fingers open and close: each finger is covered by itself and moved along.

The cover of arm and palm stays the same whatever the fingers do, and so does that of each finger in its own frame;
nothing is covered anew when a gripper closes on an object.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from workcell.geometry.covers.outer import cover_of, merge_covers, robot_cover
from workcell.geometry.pieces import move_piece, pieces_of_bodies
from workcell.geometry.types import SphereCover
from workcell.model.scene import Scene
from workcell.model.scene_parts import SceneRobot, body_pose
from workcell.pose import Pose


def cover_with_fingers(scene: Scene, robot: SceneRobot, overshoot: float) -> SphereCover:
    """Outer cover in link frames, the gripper's fingers where `robot.fingers` has them.

    Args:
        scene: the scene.
        robot: the robot.
        overshoot: metres that a sphere may stick out.
    """
    groups = _finger_bodies(scene, robot)
    apart = frozenset[int]().union(*groups)
    links = tuple(tuple(b for b in bodies if b not in apart) for bodies in robot.link_body_ids)
    # always seen from home: a cover is known again only by the very same numbers
    arm = replace(robot, link_body_ids=links, start=robot.robot.home)
    parts = [robot_cover(scene.model, arm, overshoot=overshoot)]
    tool = robot.robot.tool().link
    own = np.array(scene.initial_qpos())
    for address, value in robot.fingers:
        own[address] = value
    for bodies in groups:
        root = min(bodies)
        at_rest = pieces_of_bodies(scene.model, sorted(bodies), scene.model.qpos0)
        T_root_world = body_pose(scene.model, root, scene.model.qpos0).inverse()
        cover = cover_of([move_piece(piece, T_root_world) for piece in at_rest], overshoot, link=tool)
        T_link_world = Pose.from_matrix(
            robot.robot.link_transforms(own[robot.qpos_addresses])[tool]
        ).inverse()
        placed = (T_link_world @ body_pose(scene.model, root, own)).apply(cover.centre)
        parts.append(replace(cover, centre=placed))
    return merge_covers(*parts)


def _finger_bodies(scene: Scene, robot: SceneRobot) -> list[frozenset[int]]:
    """The bodies that move as one, for each of those that joints of the gripper move on the tool's link.

    A body whose own joint moves it on a finger, such as a finger's tip, is a group of its own.
    """
    model, carried = scene.model, set(robot.link_body_ids[robot.robot.tool().link])
    addresses = [address for address, _ in robot.fingers]
    moved = {int(body) for body in model.jnt_bodyid[np.isin(model.jnt_qposadr, addresses)]} & carried
    groups: dict[int, set[int]] = {}
    owner: dict[int, int] = {}
    # bodies are numbered parents first
    for body in sorted(carried):
        root = body if body in moved else owner.get(int(model.body_parentid[body]))
        if root is not None:
            owner[body] = root
            groups.setdefault(root, set()).add(body)
    return [frozenset(group) for group in groups.values()]
