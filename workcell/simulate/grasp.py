"""The hand in a compiled model: its fingers, its actuator, and the welds that hold objects."""

from __future__ import annotations

import itertools
from collections.abc import Iterable
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from workcell.errors import ModelError
from workcell.model.loading.build import GRASP
from workcell.model.loops.elements import loop_elements
from workcell.model.scene_parts import SceneObject, SceneRobot
from workcell.pose import Array, Pose, read_only

if TYPE_CHECKING:
    import mujoco


@dataclass(frozen=True, slots=True)
class Hand:
    """A gripper: one actuator, two or more fingers.

    Attributes:
        actuator: its id; `closed` and `open` are its control values.
        fingers: for each finger, the bodies that move with it, with all that hangs on it or closes a loop with it.
        joints: addresses in qvel of the fingers' joints.
        bodies: all of the robot's own that the tool's link carries: what may touch a held object.
    """

    actuator: int
    closed: float
    open: float
    fingers: tuple[frozenset[int], ...]
    joints: tuple[int, ...]
    bodies: frozenset[int]

    @staticmethod
    def of(model: mujoco.MjModel, robot: SceneRobot) -> Hand | None:
        """The robot's gripper, or None; raises ModelError for a gripper without two moving fingers."""
        if robot.gripper is None:
            return None
        actuator = model.actuator(robot.gripper).id
        low, high = model.actuator_ctrlrange[actuator]
        carried = robot.hand_ids
        arm = {int(dof) for dof in robot.joint_dof_addresses}
        roots = [
            body
            for body in sorted(carried)
            if model.body_jntnum[body] > 0 and int(model.body_dofadr[body]) not in arm
        ]
        fingers = _fingers(model, carried, roots)
        if len(fingers) < 2 or not low < high:
            raise ModelError(
                f"the gripper {robot.gripper!r} has {len(fingers)} moving fingers and control range [{low}, {high}]",
                remedy="a gripper takes two fingers with a joint each, and a ctrlrange from closed to open",
            )
        joints = tuple(int(model.body_dofadr[root]) for root in roots)
        return Hand(actuator, float(low), float(high), fingers, joints, carried)


@dataclass(frozen=True, slots=True)
class Weld:
    """The equality, inactive at first, that holds one object to one hand.

    Attributes:
        equality: its id; hand_body, object_body: of the bodies that it joins.
        corners: (k, 3) of the boxes around the object's geoms, in its own frame.
    """

    equality: int
    hand_body: int
    object_body: int
    corners: Array

    @staticmethod
    def of(model: mujoco.MjModel, robot: SceneRobot, thing: SceneObject) -> Weld:
        """Look the weld up by its name; raises ModelError where the model has none."""
        import mujoco

        name = GRASP.format(robot=robot.name, object=thing.name)
        equality = mujoco.mj_name2id(model, mujoco.mjtObj.mjOBJ_EQUALITY, name)
        if equality < 0:
            raise ModelError(
                f"{robot.name} can't hold {thing.name!r}: the model has no weld {name!r}",
                remedy="a free object, and a gripper with a site named `tool`, get one when the scene is loaded",
            )
        hand, held = int(model.eq_obj1id[equality]), int(model.eq_obj2id[equality])
        return Weld(equality, hand, held, read_only(_corners(model, held, thing.body_ids)))

    def relative_pose(self, data: mujoco.MjData) -> Pose:
        """`T_hand_object` as the bodies stand in `data`."""
        hand = Pose(data.xpos[self.hand_body], data.xquat[self.hand_body])
        return hand.inverse() @ Pose(data.xpos[self.object_body], data.xquat[self.object_body])

    def slip(self, data: mujoco.MjData, T_hand_object: Pose) -> float:
        """How far any point of the object has moved in the hand since it stood at `T_hand_object`, metres."""
        R_hand, R_object = (data.xmat[body].reshape(3, 3) for body in (self.hand_body, self.object_body))
        from_hand = self.corners @ R_object.T + (data.xpos[self.object_body] - data.xpos[self.hand_body])
        moved = from_hand @ R_hand - T_hand_object.apply(self.corners)
        return float(np.sqrt((moved**2).sum(axis=1).max(initial=0.0)))

    def close(self, model: mujoco.MjModel, data: mujoco.MjData) -> Pose:
        """Hold the object as it stands in the hand now; returns `T_hand_object`."""
        held = self.relative_pose(data)
        model.eq_data[self.equality, 0:3] = 0.0
        model.eq_data[self.equality, 3:6] = held.position
        model.eq_data[self.equality, 6:10] = held.quat_wxyz
        model.eq_data[self.equality, 10] = 1.0
        # As stiff as the time step allows: MuJoCo's default would let 0.3 kg sag by 0.2 mm.
        model.eq_solref[self.equality] = [2.5 * model.opt.timestep, 1.0]
        model.eq_solimp[self.equality, :2] = [0.99, 0.999]
        data.eq_active[self.equality] = 1
        return held

    def release(self, data: mujoco.MjData) -> None:
        """Let go."""
        data.eq_active[self.equality] = 0


def _corners(model: mujoco.MjModel, root: int, bodies: Iterable[int]) -> Array:
    """(8 g, 3) corners of the boxes around the geoms of `bodies`, which stand still on `root`, in its frame."""
    signs = np.array(list(itertools.product((-1.0, 1.0), repeat=3)))
    found = [np.zeros((0, 3))]
    for body in bodies:
        T_root_body, at = Pose.identity(), body
        while at != root:
            T_root_body = Pose(model.body_pos[at], model.body_quat[at]) @ T_root_body
            at = int(model.body_parentid[at])
        for geom in np.flatnonzero(model.geom_bodyid == body):
            T_root_geom = T_root_body @ Pose(model.geom_pos[geom], model.geom_quat[geom])
            centre, half = model.geom_aabb[geom, :3], model.geom_aabb[geom, 3:]
            found.append(T_root_geom.apply(centre + signs * half))
    return np.concatenate(found)


def _fingers(
    model: mujoco.MjModel, carried: Iterable[int], roots: Iterable[int]
) -> tuple[frozenset[int], ...]:
    """Bodies of a hand that move, finger by finger: chains, and what loops tie to them while two fingers are left."""
    moving = set(roots)
    first = [root for root in roots if not any(_is_under(model, root, o) for o in moving - {root})]
    fingers = [frozenset(body for body in carried if _is_under(model, body, root)) for root in first]
    for element in loop_elements(model):
        tied = [finger for finger in fingers if finger.intersection(element.bodies)]
        if len(tied) == 2 and len(fingers) > 2:
            fingers = [finger for finger in fingers if finger not in tied] + [tied[0] | tied[1]]
    return tuple(fingers)


def _is_under(model: mujoco.MjModel, body: int, root: int) -> bool:
    while body > 0:
        if body == root:
            return True
        body = int(model.body_parentid[body])
    return False


def finger_speed(data: mujoco.MjData, hand: Hand) -> float:
    """Largest speed of a finger's joint, metres (or radians) a second."""
    return float(np.abs(data.qvel[list(hand.joints)]).max())
