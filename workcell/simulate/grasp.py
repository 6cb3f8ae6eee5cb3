"""The hand in a compiled model: its fingers, its actuator, and the welds that hold objects."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from workcell.errors import ModelError
from workcell.model.build import GRASP
from workcell.model.scene import SceneObject, SceneRobot
from workcell.pose import Pose

if TYPE_CHECKING:
    import mujoco


@dataclass(frozen=True, slots=True)
class Hand:
    """A gripper: one actuator, two or more fingers.

    Attributes:
        actuator: its id; `closed` and `open` are its control values.
        fingers: for each finger, the bodies that move with it.
        joints: addresses in qvel of the fingers' joints.
        bodies: everything that the tool's link carries: what may touch a held object.
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
        carried = frozenset(robot.link_body_ids[robot.robot.tool().link])
        arm = {int(dof) for dof in robot.dof_addresses}
        roots = [
            body
            for body in sorted(carried)
            if model.body_jntnum[body] > 0 and int(model.body_dofadr[body]) not in arm
        ]
        if len(roots) < 2 or not low < high:
            raise ModelError(
                f"the gripper {robot.gripper!r} has {len(roots)} moving fingers and control range [{low}, {high}]",
                remedy="a gripper takes two fingers with a joint each, and a ctrlrange from closed to open",
            )
        fingers = tuple(frozenset(b for b in carried if _is_under(model, b, root)) for root in roots)
        joints = tuple(int(model.body_dofadr[root]) for root in roots)
        return Hand(actuator, float(low), float(high), fingers, joints, carried)


@dataclass(frozen=True, slots=True)
class Weld:
    """The equality, inactive at first, that holds one object to one hand."""

    equality: int
    hand_body: int
    object_body: int

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
        return Weld(equality, int(model.eq_obj1id[equality]), int(model.eq_obj2id[equality]))

    def relative_pose(self, data: mujoco.MjData) -> Pose:
        """`T_hand_object` as the bodies stand in `data`."""
        hand = Pose(data.xpos[self.hand_body], data.xquat[self.hand_body])
        return hand.inverse() @ Pose(data.xpos[self.object_body], data.xquat[self.object_body])

    def slip(self, data: mujoco.MjData, T_hand_object: Pose) -> float:
        """How far the object's origin has moved in the hand since it stood at `T_hand_object`, metres."""
        R = data.xmat[self.hand_body].reshape(3, 3)
        now = R.T @ (data.xpos[self.object_body] - data.xpos[self.hand_body])
        return float(np.linalg.norm(now - T_hand_object.position))

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


def _is_under(model: mujoco.MjModel, body: int, root: int) -> bool:
    while body > 0:
        if body == root:
            return True
        body = int(model.body_parentid[body])
    return False


def finger_speed(data: mujoco.MjData, hand: Hand) -> float:
    """Largest speed of a finger's joint, metres (or radians) a second."""
    return float(np.abs(data.qvel[list(hand.joints)]).max())
