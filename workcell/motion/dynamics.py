"""Torques that a trajectory needs, by Pinocchio's recursive Newton-Euler: known before anything is executed.

Pinocchio stands beside MuJoCo here: the chain is built from the scene's masses, but every algorithm after that is
another one than the simulator's, so that the two check each other.
"""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from workcell.errors import InputError
from workcell.model.scene import Scene, SceneRobot
from workcell.motion.path import Trajectory
from workcell.pose import Array, Pose

if TYPE_CHECKING:
    import mujoco


@dataclass(frozen=True, slots=True)
class TorqueUse:
    """Largest torque of each joint over a trajectory, and its share of the effort limit.

    Attributes:
        peak: (n,) newton metres (newtons for a prismatic joint).
        share: (n,) of the effort limit; 0 where the limit is unknown.
        joint: name of the joint that uses the largest share.
    """

    peak: Array
    share: Array
    joint: str

    @property
    def kept(self) -> bool:
        """Whether no joint needs more than its limit."""
        return bool(np.all(self.share <= 1.0))


class ChainDynamics:
    """Inverse dynamics of one robot of a scene, gripper and carried object included.

    Args:
        scene: the scene.
        robot: the robot's name; None: the only one.
        attached: (object name, T_tool_object) that the hand carries.
    """

    def __init__(
        self, scene: Scene, robot: str | None = None, attached: tuple[str, Pose] | None = None
    ) -> None:
        import pinocchio

        self._pin = pinocchio
        self.robot = scene.robot(robot)
        dofs = self.robot.dof_addresses
        self._armature, self._damping = scene.model.dof_armature[dofs], scene.model.dof_damping[dofs]
        self._model = pinocchio.Model()
        self._model.gravity.linear = np.array(scene.model.opt.gravity)
        self._build(scene, attached)
        self._data = self._model.createData()

    def _build(self, scene: Scene, attached: tuple[str, Pose] | None) -> None:
        pin, chain = self._pin, self.robot.robot
        inertias = link_inertias(scene, self.robot)
        if attached is not None:
            tool = chain.tool()
            parts = body_inertias(scene, scene.object(attached[0]).body_ids)
            frame = tool.T_link_tool @ attached[1] @ scene_object_pose(scene, attached[0]).inverse()
            inertias[tool.link] += [(mass, frame @ T, moments) for mass, T, moments in parts]
        base = chain.T_world_base
        parent, placement = 0, pin.SE3(base.rotation, base.position)
        for k in range(chain.dof):
            step = placement * pin.SE3(np.array(chain.joint_rotation[k]), np.array(chain.joint_xyz[k]))
            kind = pin.JointModelPrismaticUnaligned if chain.prismatic[k] else pin.JointModelRevoluteUnaligned
            parent = self._model.addJoint(parent, kind(np.array(chain.axis[k])), step, chain.joint_names[k])
            for mass, T, moments in inertias[k + 1]:
                body = pin.Inertia(mass, np.zeros(3), np.diag(moments))
                self._model.appendBodyToJoint(parent, body, pin.SE3(T.rotation, np.array(T.position)))
            placement = pin.SE3.Identity()

    def torques(self, trajectory: Trajectory) -> Array:
        """(T, n) joint torques that produce the motion, joint damping and armature included.

        Raises:
            InputError: another robot's trajectory.
        """
        if trajectory.q.shape[1] != self.robot.robot.dof:
            raise InputError(
                f"the trajectory moves {trajectory.q.shape[1]} joints, {self.robot.name} has {self.robot.robot.dof}",
                where="trajectory",
            )
        rows = [
            self._pin.rnea(self._model, self._data, q, qd, qdd).copy()
            for q, qd, qdd in zip(trajectory.q, trajectory.qd, trajectory.qdd, strict=True)
        ]
        total: Array = np.array(rows) + self._armature * trajectory.qdd + self._damping * trajectory.qd
        return total

    def use(self, trajectory: Trajectory, every: int = 5) -> TorqueUse:
        """Peak torques at every `every`-th sample against the robot's effort limits."""
        thinned = Trajectory(
            trajectory.robot_name,
            trajectory.time[::every],
            trajectory.q[::every],
            trajectory.qd[::every],
            trajectory.qdd[::every],
        )
        peak: Array = np.abs(self.torques(thinned)).max(axis=0)
        share: Array = np.where(np.isfinite(self.robot.robot.effort), peak / self.robot.robot.effort, 0.0)
        return TorqueUse(peak, share, self.robot.robot.joint_names[int(np.argmax(share))])


Inertia = tuple[float, Pose, Array]
"""Mass, pose of the principal frame at the centre of mass, principal moments (3,)."""


def body_inertias(scene: Scene, bodies: Iterable[int]) -> list[Inertia]:
    """Inertias of bodies, placed in the world as the scene begins; massless bodies are left out."""
    model, data = scene.model, _initial_data(scene)
    found = []
    for body in sorted(bodies):
        if model.body_mass[body] > 0:
            T = Pose.from_rotation(data.xipos[body], data.ximat[body].reshape(3, 3))
            found.append((float(model.body_mass[body]), T, np.array(model.body_inertia[body])))
    return found


def link_inertias(scene: Scene, robot: SceneRobot) -> list[list[Inertia]]:
    """For each link of a robot, the inertias of the bodies that it carries, in the link's frame."""
    links = robot.robot.link_transforms(robot.start)
    placed = []
    for link, bodies in enumerate(robot.link_body_ids):
        T_link_world = Pose.from_matrix(links[link]).inverse()
        placed.append([(mass, T_link_world @ T, m) for mass, T, m in body_inertias(scene, bodies)])
    return placed


def scene_object_pose(scene: Scene, name: str) -> Pose:
    """World pose of an object as the scene begins; raises UnknownNameError."""
    data, body = _initial_data(scene), scene.object(name).body_id
    return Pose(data.xpos[body], data.xquat[body])


def _initial_data(scene: Scene) -> mujoco.MjData:
    import mujoco

    data = mujoco.MjData(scene.model)
    data.qpos[:] = scene.initial_qpos()
    mujoco.mj_kinematics(scene.model, data)
    return data
