"""Torques that a trajectory needs, by Pinocchio's recursive Newton-Euler: known before anything is executed.

Pinocchio stands beside MuJoCo here: the chain is built from the scene's masses, but every algorithm after that is
another one than the simulator's, so that the two check each other. Where the compiled model has what such a chain lacks
(springs, dry friction, compensated weight), its own torques are taken.
"""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass

import numpy as np

from workcell.errors import InputError
from workcell.model.robot import Robot
from workcell.model.scene import Scene
from workcell.model.scene_parts import SceneRobot, data_at
from workcell.motion.path import Trajectory
from workcell.motion.timing.compiled_dynamics import CompiledDynamics, lacks
from workcell.pose import Array, Pose


@dataclass(frozen=True, slots=True)
class TorqueUse:
    """Largest torque of each joint over a trajectory, and its share of the effort limit.

    Attributes:
        peak: (n,) newton metres (newtons for a prismatic joint).
        share: (n,) of the effort limit; 0 where the limit is unknown.
        joint: name of the joint that uses the largest share.
        worst: index of the sample of the motion at which it does.
    """

    peak: Array
    share: Array
    joint: str
    worst: int

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
        share: of its mass and inertia that this robot carries; several hands that hold one thing share it.

    Attributes:
        robot: the robot.
        lacking: what acts on it that Pinocchio's chain lacks, in words; where there is any, MuJoCo is asked instead.

    Raises:
        ModelError: a spring that yields: its torque depends on the past.
    """

    def __init__(
        self,
        scene: Scene,
        robot: str | None = None,
        attached: tuple[str, Pose] | None = None,
        share: float = 1.0,
    ) -> None:
        import pinocchio

        self._pin = pinocchio
        self.robot = scene.robot(robot)
        dofs = self.robot.joint_dof_addresses
        self._armature, self._damping = scene.model.dof_armature[dofs], scene.model.dof_damping[dofs]
        self.lacking = lacks(scene, self.robot, None if attached is None else attached[0])
        self._compiled = CompiledDynamics(scene, self.robot, attached, share) if self.lacking else None
        self._model = pinocchio.Model()
        self._model.gravity.linear = np.array(scene.model.opt.gravity)
        self._build(scene, attached, share)
        self._data = self._model.createData()

    def _build(self, scene: Scene, attached: tuple[str, Pose] | None, share: float) -> None:
        pin, chain = self._pin, self.robot.robot
        inertias = link_inertias(scene, self.robot)
        if attached is not None:
            tool = chain.tool()
            parts = body_inertias(scene, scene.object(attached[0]).body_ids)
            frame = tool.T_link_tool @ attached[1] @ scene.object_pose(attached[0]).inverse()
            inertias[tool.link] += [(share * mass, frame @ T, share * moments) for mass, T, moments in parts]
        base = chain.T_world_base
        parent, placement = 0, pin.SE3(base.rotation, base.position)
        for k in range(chain.joint_count):
            step = placement * pin.SE3(np.array(chain.joint_rotation[k]), np.array(chain.joint_xyz[k]))
            kind = pin.JointModelPrismaticUnaligned if chain.prismatic[k] else pin.JointModelRevoluteUnaligned
            parent = self._model.addJoint(
                parent, kind(np.array(chain.axis[k])), step, chain.all_joint_names[k]
            )
            for mass, T, moments in inertias[k + 1]:
                body = pin.Inertia(mass, np.zeros(3), np.diag(moments))
                self._model.appendBodyToJoint(parent, body, pin.SE3(T.rotation, np.array(T.position)))
            placement = pin.SE3.Identity()

    def at(self, q: Array, qd: Array, qdd: Array) -> Array:
        """(T, n) joint torques that produce the motion: all that acts on the joints but contacts, limits, couplings.

        Args:
            q, qd, qdd: (T, n) rows of positions, velocities and accelerations.
        """
        if self._compiled is not None:
            return self._compiled.at(q, qd, qdd)
        total: Array = self._of_masses(q, qd, qdd) + self.viscous(q, qd)
        return total

    def rigid(self, q: Array, qd: Array, qdd: Array) -> Array:
        """(T, n) the same without damping, drag and dry friction."""
        return self._of_masses(q, qd, qdd) if self._compiled is None else self._compiled.rigid(q, qd, qdd)

    def viscous(self, q: Array, qd: Array) -> Array:
        """(T, n) torques against damping and drag."""
        if self._compiled is not None:
            return self._compiled.viscous(q, qd)
        chain = self.robot.robot
        return chain.variable_forces(q, self._damping * chain.joint_motion(q, qd, np.zeros_like(q))[1])

    def dry(self, q: Array, qd: Array) -> Array:
        """(T, n) torques against dry friction, in the directions of `qd`, however small; 0 at rest."""
        return np.zeros_like(q) if self._compiled is None else self._compiled.dry(q, qd)

    def _of_masses(self, q: Array, qd: Array, qdd: Array) -> Array:
        moving = self.robot.robot.joint_motion(q, qd, qdd)
        rows = [self._pin.rnea(self._model, self._data, *row).copy() for row in zip(*moving, strict=True)]
        total: Array = np.array(rows) + self._armature * moving[2]
        return self.robot.robot.variable_forces(q, total)

    @property
    def kinematics(self) -> Robot:
        """The robot's own, apart from the scene."""
        return self.robot.robot

    def use(self, trajectory: Trajectory, every: int = 5) -> TorqueUse:
        """Peak torques at every `every`-th sample, and the last, against the robot's effort limits.

        Raises:
            InputError: another robot's trajectory.
        """
        self._check(trajectory)
        looked = np.unique(np.append(np.arange(0, len(trajectory), max(every, 1)), len(trajectory) - 1))
        torques = np.abs(self.at(trajectory.q[looked], trajectory.qd[looked], trajectory.qdd[looked]))
        shares = np.where(np.isfinite(self.robot.robot.effort), torques / self.robot.robot.effort, 0.0)
        row, joint = np.unravel_index(int(np.argmax(shares)), shares.shape)
        name = self.robot.robot.joint_names[int(joint)]
        return TorqueUse(torques.max(axis=0), shares.max(axis=0), name, int(looked[row]))

    def _check(self, trajectory: Trajectory) -> None:
        if trajectory.q.shape[1] != self.robot.robot.dof:
            raise InputError(
                f"the trajectory moves {trajectory.q.shape[1]} joints, {self.robot.name} has {self.robot.robot.dof}",
                where="trajectory",
            )


Inertia = tuple[float, Pose, Array]
"""Mass, pose of the principal frame at the centre of mass, principal moments (3,)."""


def body_inertias(scene: Scene, bodies: Iterable[int]) -> list[Inertia]:
    """Inertias of bodies, placed in the world as the scene begins; massless bodies are left out."""
    model, data = scene.model, data_at(scene.model, scene.initial_qpos())
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
