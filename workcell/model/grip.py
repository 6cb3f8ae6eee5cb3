"""A gripper's fingers and its hand, apart from the arm: where they stand, and what a hand would hit at a pose."""

from __future__ import annotations

from collections.abc import Collection
from itertools import product
from typing import TYPE_CHECKING

import numpy as np

from workcell.errors import InputError
from workcell.model.scene import Scene, SceneRobot
from workcell.pose import Array, Pose

if TYPE_CHECKING:
    import mujoco

Fingers = tuple[tuple[int, float], ...]
"""(address in qpos, value) of the gripper's joints: what `SceneRobot.fingers` holds."""

_BISECTIONS = 16


def fingers_at(scene: Scene, robot: SceneRobot, opening: float) -> Fingers:
    """The gripper's joints at a share of the way from closed (0) to where the scene has them open (1).

    Raises:
        InputError: a share outside [0, 1].
    """
    if not 0.0 <= opening <= 1.0:
        raise InputError(
            f"an opening of {opening}", where="opening", remedy="a share from 0 (closed) to 1 (open)"
        )
    placed = []
    for joint, (address, opened) in zip(_joints(scene, robot), robot.fingers, strict=True):
        low, high = scene.model.jnt_range[joint]
        closed = low if abs(opened - low) > abs(opened - high) else high
        placed.append((address, float(closed + opening * (opened - closed))))
    return tuple(placed)


def fingers_holding(scene: Scene, robot: SceneRobot, thing: str, T_tool_object: Pose) -> Fingers:
    """The gripper's joints when it holds an object.

    The fingers close together, from where the scene has them, and stop at the first touch (to within a 65,000th of
    the way). Without a gripper nothing changes; where the fingers don't meet the object they close completely.

    Args:
        scene: the scene.
        robot: whose hand.
        thing: the object's name.
        T_tool_object: how it stands in the tool's frame.
    """
    import mujoco

    held, at = scene.object(thing), scene.object(thing).qpos_address
    if not robot.fingers or at is None:
        return robot.fingers
    model, data = scene.model, mujoco.MjData(scene.model)
    qpos = np.array(scene.initial_qpos())
    T_world_object = robot.robot.fk(robot.start) @ T_tool_object
    qpos[robot.qpos_addresses] = robot.start
    qpos[at : at + 3], qpos[at + 3 : at + 7] = T_world_object.position, T_world_object.quat_wxyz
    fingers = _solid_geoms(model, {int(model.jnt_bodyid[joint]) for joint in _joints(scene, robot)})
    others = _solid_geoms(model, held.body_ids)

    def free(opening: float) -> bool:
        for address, value in fingers_at(scene, robot, opening):
            qpos[address] = value
        data.qpos[:] = qpos
        mujoco.mj_kinematics(model, data)
        return all(
            mujoco.mj_geomDistance(model, data, a, b, 0.001, None) > 0 for a, b in product(fingers, others)
        )

    low, high = 0.0, 1.0
    if free(low):
        return fingers_at(scene, robot, low)
    for _ in range(_BISECTIONS):
        middle = 0.5 * (low + high)
        low, high = (low, middle) if free(middle) else (middle, high)
    return fingers_at(scene, robot, high)


def hand_clearance(
    scene: Scene, robot: SceneRobot, T_world_tool: Pose, ignored: Collection[str] = (), limit: float = 1.0
) -> float:
    """How far the hand alone would be from everything that is not its robot, with the tool at a pose; metres, signed.

    A pose at which the hand collides needs no inverse kinematics.

    Args:
        scene: the scene, everything else as it begins.
        robot: whose hand: all that the tool's link carries.
        T_world_tool: the tool's pose.
        ignored: objects (by name) that don't count, such as one about to be grasped.
        limit: metres up to which is looked.
    """
    import mujoco

    model, data = scene.model, mujoco.MjData(scene.model)
    data.qpos[:] = scene.initial_qpos()
    mujoco.mj_kinematics(model, data)
    moved = T_world_tool.matrix @ np.linalg.inv(robot.robot.fk(robot.start).matrix)
    hand = _solid_geoms(model, set(robot.link_body_ids[robot.robot.tool().link]))
    skipped = set(robot.body_ids).union(*(scene.object(name).body_ids for name in ignored))
    others = _solid_geoms(model, set(range(model.nbody)) - skipped)
    for geom in hand:
        _move(data, geom, moved)
    return min(
        (mujoco.mj_geomDistance(model, data, a, b, limit, None) for a, b in product(hand, others)),
        default=limit,
    )


def _move(data: mujoco.MjData, geom: int, T: Array) -> None:
    data.geom_xpos[geom] = T[:3, :3] @ data.geom_xpos[geom] + T[:3, 3]
    data.geom_xmat[geom] = (T[:3, :3] @ data.geom_xmat[geom].reshape(3, 3)).ravel()


def _joints(scene: Scene, robot: SceneRobot) -> list[int]:
    """Ids of the joints that `robot.fingers` lists."""
    return [int(np.flatnonzero(scene.model.jnt_qposadr == address)[0]) for address, _ in robot.fingers]


def _solid_geoms(model: mujoco.MjModel, bodies: Collection[int]) -> list[int]:
    """Geoms of some bodies that can collide."""
    solid = (model.geom_contype != 0) | (model.geom_conaffinity != 0)
    return [g for g in range(model.ngeom) if solid[g] and int(model.geom_bodyid[g]) in bodies]
