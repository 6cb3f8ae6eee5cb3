"""Torques that a trajectory needs, by Pinocchio's recursive Newton-Euler: known before anything is executed.

Pinocchio stands beside MuJoCo here: the chain is built from the scene's masses, but every algorithm after that is
another one than the simulator's, so that the two check each other.
"""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass
from typing import Protocol

import numpy as np
from numpy.typing import ArrayLike

from workcell.errors import InputError
from workcell.model.robot import Robot
from workcell.model.scene import Scene
from workcell.model.scene_parts import SceneRobot, data_at
from workcell.motion.path import Trajectory
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


class Dynamics(Protocol):
    """What a limit on torques asks of a robot's dynamics, or of several robots' side by side."""

    @property
    def kinematics(self) -> Robot:
        """Whose joints they are."""

    @property
    def damping(self) -> Array:
        """(n,) viscous damping of the joints, newton metre seconds a radian."""

    def at(self, q: Array, qd: Array, qdd: Array) -> Array:
        """(T, n) torques for rows of positions, velocities and accelerations (T, n) each."""


class ChainDynamics:
    """Inverse dynamics of one robot of a scene, gripper and carried object included.

    Args:
        scene: the scene.
        robot: the robot's name; None: the only one.
        attached: (object name, T_tool_object) that the hand carries.
        share: of its mass and inertia that this robot carries; several hands that hold one thing share it.
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
        dofs = self.robot.dof_addresses
        self._armature, self._damping = scene.model.dof_armature[dofs], scene.model.dof_damping[dofs]
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
        for k in range(chain.dof):
            step = placement * pin.SE3(np.array(chain.joint_rotation[k]), np.array(chain.joint_xyz[k]))
            kind = pin.JointModelPrismaticUnaligned if chain.prismatic[k] else pin.JointModelRevoluteUnaligned
            parent = self._model.addJoint(parent, kind(np.array(chain.axis[k])), step, chain.joint_names[k])
            for mass, T, moments in inertias[k + 1]:
                body = pin.Inertia(mass, np.zeros(3), np.diag(moments))
                self._model.appendBodyToJoint(parent, body, pin.SE3(T.rotation, np.array(T.position)))
            placement = pin.SE3.Identity()

    def at(self, q: Array, qd: Array, qdd: Array) -> Array:
        """(T, n) joint torques that produce the motion, joint damping and armature included.

        Args:
            q, qd, qdd: (T, n) rows of positions, velocities and accelerations.
        """
        rows = [self._pin.rnea(self._model, self._data, *row).copy() for row in zip(q, qd, qdd, strict=True)]
        total: Array = np.array(rows) + self._armature * qdd + self._damping * qd
        return total

    @property
    def kinematics(self) -> Robot:
        """The robot's own, apart from the scene."""
        return self.robot.robot

    @property
    def damping(self) -> Array:
        """(n,) viscous damping of the joints, newton metre seconds a radian."""
        return np.array(self._damping)

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


class TooWeakError(InputError):
    """A joint's torque does not suffice to hold the arm, and what it carries, still somewhere on a path."""


@dataclass(frozen=True, slots=True)
class TorqueLimits:
    """Largest absolute joint torques, as bounds on the speed and acceleration along a path.

    Attributes:
        dynamics: of the robot and what it carries, or of several that share a load.
        effort: (n,) newton metres (newtons), positive; inf where unknown.
    """

    dynamics: Dynamics
    effort: Array

    @staticmethod
    def of(dynamics: Dynamics, effort: ArrayLike | None = None) -> TorqueLimits:
        """The given limits (a number, or one for each joint), or the robot's own.

        Raises:
            InputError: a limit that is zero, negative or NaN.
        """
        robot = dynamics.kinematics
        values = np.broadcast_to(np.asarray(robot.effort if effort is None else effort, float), (robot.dof,))
        bad = np.isnan(values) | (values <= 0)
        if np.any(bad):
            joint = int(np.argmax(bad))
            raise InputError(
                f"the effort limit of {robot.joint_names[joint]} is {values[joint]}",
                where="effort",
                remedy="pass positive limits: one number, or one for each joint",
            )
        return TorqueLimits(dynamics, np.array(values))

    def along(self, q: Array, first: Array, second: Array, cap: Array) -> tuple[Array, Array, Array, Array]:
        """Rows `low <= a sdd + b sd^2 <= high` (g, m), for joints with a limit, at q, dq/ds and d2q/ds2.

        What it takes to hold still, and damping at the largest speed (its square is `cap`), is taken off the limits.

        Raises:
            TooWeakError: a joint can't hold the arm still somewhere.
        """
        zero = np.zeros_like(q)
        still = self.dynamics.at(q, zero, zero)
        damped = self.dynamics.damping * np.abs(first) * np.sqrt(np.minimum(cap, 1e12))[:, None]
        self._check(still)
        a = self.dynamics.at(q, zero, first) - still
        b = self.dynamics.at(q, first, second) - still - self.dynamics.damping * first
        room = np.maximum(self.effort - np.abs(still) - damped, 1e-3 * (self.effort - np.abs(still)))
        high = np.where(still >= 0, room, room + 2 * np.abs(still))
        low = np.where(still >= 0, -room - 2 * np.abs(still), -room)
        limited = np.isfinite(self.effort)
        return a[:, limited], b[:, limited], low[:, limited], high[:, limited]

    def share(self, q: Array, qd: Array, qdd: Array) -> Array:
        """(T,) the largest share, over the joints, of the torque that holding still leaves for moving."""
        zero = np.zeros_like(q)
        still = self.dynamics.at(q, zero, zero)
        self._check(still)
        moving = self.dynamics.at(q, qd, qdd) - still
        left = np.where(moving >= 0, self.effort - still, self.effort + still)
        shares: Array = np.where(np.isfinite(self.effort), np.abs(moving) / left, 0.0).max(axis=1)
        return shares

    def _check(self, still: Array) -> None:
        over = np.abs(still) >= self.effort
        if np.any(over):
            row, joint = (int(i) for i in np.argwhere(over)[0])
            robot = self.dynamics.kinematics
            raise TooWeakError(
                f"joint {robot.joint_names[joint]} needs {abs(still[row, joint]):.1f} N m to hold still on the path, "
                f"and has {self.effort[joint]:.1f}",
                where="path",
                remedy="carry less, or keep the load closer to the base",
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
