"""What closes on an object: fingers, a chuck's jaws; and what a hand would hit at a pose, apart from its arm."""

from __future__ import annotations

from collections.abc import Callable, Collection
from dataclasses import replace
from itertools import product
from typing import TYPE_CHECKING

import numpy as np

from workcell.errors import InputError, ModelError, UnknownNameError
from workcell.model.judge.distances import judge_model
from workcell.model.loading.couplings import locked_values, settled
from workcell.model.scene import Scene
from workcell.model.scene_parts import SceneRobot, data_at, place_holding
from workcell.pose import Array, Pose

if TYPE_CHECKING:
    import mujoco

Fingers = tuple[tuple[int, float], ...]
"""(address in qpos, value) of the gripper's joints: what `SceneRobot.fingers` holds."""

_BISECTIONS = 16


def fingers_at(scene: Scene, robot: SceneRobot, opening: float) -> Fingers:
    """The gripper's joints at a share of the way from closed (0) to where the scene has them open (1).

    Joints that are neither planned for nor in the hand, such as a second arm's, stay where they are.

    Raises:
        InputError: a share outside [0, 1].
    """
    if not 0.0 <= opening <= 1.0:
        raise InputError(
            f"an opening of {opening}", where="opening", remedy="a share from 0 (closed) to 1 (open)"
        )
    placed, hand = {}, _hand_joints(scene, robot)
    for joint, (_, opened) in zip(_joints(scene, robot), robot.fingers, strict=True):
        low, high = scene.model.jnt_range[joint]
        closed = low if abs(opened - low) > abs(opened - high) else high
        if joint not in hand:
            closed = opened
        placed[joint] = float(closed + opening * (opened - closed))
    qpos = np.array(scene.model.qpos0)
    addresses = [int(scene.model.jnt_qposadr[joint]) for joint in placed]
    qpos[addresses] = list(settled(scene.model, placed).values())
    if robot.loops is not None and (reason := robot.loops.settle(qpos)):
        raise InputError(f"an opening of {opening:g}: {reason}", where="opening")
    return tuple((address, float(qpos[address])) for address in addresses)


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
    held, hand = scene.object(thing), _hand_joints(scene, robot)
    if not hand or held.qpos_address is None:
        return robot.fingers
    model = scene.model
    qpos = np.array(scene.initial_qpos())
    place_holding(qpos, robot, robot.start, held, T_tool_object)
    fingers = _solid_geoms(model, {int(model.jnt_bodyid[joint]) for joint in hand})
    others = _solid_geoms(model, held.body_ids)

    def at(opening: float) -> Fingers:
        return fingers_at(scene, robot, opening)

    return at(_first_free(model, qpos, at, fingers, others))


def actuated(scene: Scene, actuator: str, share: float) -> Scene:
    """The same scene once an actuator of the cell, such as a chuck's or a door's, has moved to a share of its range.

    The joints that it drives move together; they stop where one of their bodies first touches an object of the scene.

    Args:
        scene: the scene.
        actuator: a position servo of the cell on a joint, or on a fixed tendon of several.
        share: from 0 to 1.

    Raises:
        UnknownNameError: no such actuator, or a robot's; InputError: a share outside [0, 1]; ModelError: it drives no
            joint.
    """
    known = scene.actuators()
    if actuator not in known:
        raise UnknownNameError("actuator", actuator, known, where=scene.path)
    if not 0.0 <= share <= 1.0:
        raise InputError(f"a share of {share}", where="share", remedy="from 0 to 1 of the actuator's range")
    model, begin = scene.model, scene.initial_qpos()
    joints, total = _driven(model, known[actuator])
    if not joints or not total:
        raise ModelError(f"the actuator {actuator!r} drives no joints", where=scene.path)
    low, high = model.actuator_ctrlrange[known[actuator]]
    value = float(low + share * (high - low)) / total
    wanted = {int(model.jnt_qposadr[j]): float(np.clip(value, *model.jnt_range[j])) for j in joints}
    bodies = {int(model.jnt_bodyid[joint]) for joint in joints}
    objects = set[int]().union(*(thing.body_ids for thing in scene.objects.values()))

    def at(left: float) -> Fingers:
        return tuple((a, float(end + left * (begin[a] - end))) for a, end in wanted.items())

    geoms = _solid_geoms(model, bodies), _solid_geoms(model, objects)
    placed = dict(scene.placed) | dict(at(_first_free(model, np.array(begin), at, *geoms)))
    return replace(scene, placed=tuple(placed.items()))


def _driven(model: mujoco.MjModel, actuator: int) -> tuple[list[int], float]:
    """Joints that an actuator moves by its own joint or a fixed tendon, and their share where they move alike.

    The share is what the actuator's value is of theirs.
    """
    import mujoco

    target = int(model.actuator_trnid[actuator, 0])
    if model.actuator_trntype[actuator] == mujoco.mjtTrn.mjTRN_JOINT:
        return [target], 1.0
    if model.actuator_trntype[actuator] != mujoco.mjtTrn.mjTRN_TENDON:
        return [], 0.0
    wraps = range(int(model.tendon_adr[target]), int(model.tendon_adr[target] + model.tendon_num[target]))
    if any(model.wrap_type[w] != mujoco.mjtWrap.mjWRAP_JOINT for w in wraps):
        return [], 0.0
    return [int(model.wrap_objid[w]) for w in wraps], float(sum(model.wrap_prm[w] for w in wraps))


def _first_free(
    model: mujoco.MjModel,
    qpos: Array,
    at: Callable[[float], Fingers],
    movers: Collection[int],
    others: Collection[int],
) -> float:
    """The smallest share of a way, from 1 (open) towards 0, at which no mover touches another geom.

    `qpos` is changed.
    """
    import mujoco

    data, judge = mujoco.MjData(model), judge_model(model)

    def free(share: float) -> bool:
        for address, value in at(share):
            qpos[address] = value
        data.qpos[:] = qpos
        mujoco.mj_kinematics(model, data)
        return all(judge.distance(data, a, b, 0.001) > 0 for a, b in product(movers, others))

    low, high = 0.0, 1.0
    if free(low):
        return low
    for _ in range(_BISECTIONS):
        middle = 0.5 * (low + high)
        low, high = (low, middle) if free(middle) else (middle, high)
    return high


def hand_clearance(
    scene: Scene, robot: SceneRobot, T_world_tool: Pose, ignored: Collection[str] = (), limit: float = 1.0
) -> float:
    """How far the hand alone would be from all that is not its robot, with the tool at a pose; metres, signed.

    A pose at which the hand collides needs no inverse kinematics.

    Args:
        scene: the scene, everything else as it begins.
        robot: whose hand: all that the tool's link carries, its fingers where `robot` has them.
        T_world_tool: the tool's pose.
        ignored: objects (by name) that don't count, such as one about to be grasped.
        limit: metres up to which is looked.
    """
    qpos = np.array(scene.initial_qpos())
    for address, value in robot.fingers:
        qpos[address] = value
    model, data = scene.model, data_at(scene.model, qpos)
    moved = T_world_tool.matrix @ np.linalg.inv(robot.robot.fk(robot.start).matrix)
    hand = _solid_geoms(model, set(robot.link_body_ids[robot.robot.tool().link]))
    skipped = set(robot.body_ids).union(*(scene.object(name).body_ids for name in ignored))
    others = _solid_geoms(model, set(range(model.nbody)) - skipped)
    for geom in hand:
        _move(data, geom, moved)
    meeting = [(a, b) for a, b in product(hand, others) if _collide(model, a, b)]
    return min(
        (judge_model(model).distance(data, a, b, limit) for a, b in meeting),
        default=limit,
    )


def _collide(model: mujoco.MjModel, a: int, b: int) -> bool:
    """Whether two geoms' bit masks let them collide."""
    return bool(
        model.geom_contype[a] & model.geom_conaffinity[b] or model.geom_contype[b] & model.geom_conaffinity[a]
    )


def _move(data: mujoco.MjData, geom: int, T: Array) -> None:
    data.geom_xpos[geom] = T[:3, :3] @ data.geom_xpos[geom] + T[:3, 3]
    data.geom_xmat[geom] = (T[:3, :3] @ data.geom_xmat[geom].reshape(3, 3)).ravel()


def _joints(scene: Scene, robot: SceneRobot) -> list[int]:
    """Ids of the joints that `robot.fingers` lists."""
    return [int(np.flatnonzero(scene.model.jnt_qposadr == address)[0]) for address, _ in robot.fingers]


def _hand_joints(scene: Scene, robot: SceneRobot) -> list[int]:
    """Those of them whose bodies the tool's link carries."""
    carried = robot.link_body_ids[robot.robot.tool().link]
    held = locked_values(scene.model)
    joints = [joint for joint in _joints(scene, robot) if joint not in held]
    return [joint for joint in joints if int(scene.model.jnt_bodyid[joint]) in carried]


def _solid_geoms(model: mujoco.MjModel, bodies: Collection[int]) -> list[int]:
    """Geoms of some bodies that can collide."""
    solid = (model.geom_contype != 0) | (model.geom_conaffinity != 0)
    return [g for g in range(model.ngeom) if solid[g] and int(model.geom_bodyid[g]) in bodies]
