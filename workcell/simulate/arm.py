"""One robot of a simulation: its controller, its hand, and where it should be."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from workcell.errors import InputError, ModelError
from workcell.model.scene import Scene
from workcell.model.scene_parts import SceneRobot
from workcell.motion.path import Trajectory
from workcell.pose import Array, Pose
from workcell.simulate.controller import Controller, discrete_reference
from workcell.simulate.grasp import Hand
from workcell.simulate.log_rows import Worst

if TYPE_CHECKING:
    import mujoco

_START_TOLERANCE = 1e-3
"""Radians or metres that a robot, and its base, may be away from where a trajectory has them at its beginning."""


@dataclass(frozen=True, slots=True)
class Reference:
    """Where one arm should be at every control step: (T, n) joints, (T, 4, 4) tool poses; at rest after the last.

    Tool poses are in the world, for a base at `base` (4, 4).
    """

    q: Array
    qd: Array
    qdd: Array
    tools: Array
    base: Array

    def at(self, k: int) -> tuple[Array, Array, Array, Array]:
        """Joint positions, velocities, accelerations (n,) and the tool's pose (4, 4) at step `k`."""
        if k < len(self.q):
            return self.q[k], self.qd[k], self.qdd[k], self.tools[k]
        rest = np.zeros_like(self.q[-1])
        return self.q[-1], rest, rest, self.tools[-1]


class Arm:
    """One robot in motion.

    Args:
        scene: the scene.
        robot: the robot.
        model: the simulated model.
        controller: what drives its motors.

    Attributes:
        robot, controller: as given.
        hand: its gripper, or None.
        reference: (n,) where its joints should be now.
        worst: largest errors and torques since the last logged row.
        saturated: whether a joint was at its effort limit in the last step.
        rides: whether its base can move: on a carriage, a lift, another robot.
    """

    def __init__(
        self, scene: Scene, robot: SceneRobot, model: mujoco.MjModel, controller: Controller
    ) -> None:
        self.robot, self.controller = robot, controller
        self.hand = Hand.of(model, robot)
        self.reference: Array = np.array(robot.start)
        self.worst = Worst()
        self.saturated = False
        self._where = scene.path
        self._site = robot.site_ids[robot.robot.tool().name]
        self._model = model
        self.rides = robot.has_moving_base(model)

    @property
    def name(self) -> str:
        """The robot's name in the scene."""
        return self.robot.name

    def gripper(self) -> Hand:
        """The hand; raises ModelError for a robot without one."""
        if self.hand is None:
            raise ModelError(f"{self.name} has no gripper", where=self._where)
        return self.hand

    def tool_matrix(self, data: mujoco.MjData) -> Array:
        """(4, 4) world pose of the tool now."""
        T = np.eye(4)
        T[:3, :3] = data.site_xmat[self._site].reshape(3, 3)
        T[:3, 3] = data.site_xpos[self._site]
        return T

    def tool_pose(self, data: mujoco.MjData) -> Pose:
        """`T_world_tool` now."""
        return Pose.from_matrix(self.tool_matrix(data))

    def base_matrix(self, data: mujoco.MjData) -> Array:
        """(4, 4) world pose of its base now."""
        base: Array = self.robot.robot.T_world_base.matrix
        if not self.rides:
            return base
        body = self.robot.base_body
        below = int(self._model.body_parentid[body])
        offset = Pose(self._model.body_pos[body], self._model.body_quat[body])
        now: Array = (Pose(data.xpos[below], data.xquat[below]) @ offset).matrix
        return now

    def wanted_tool(self, data: mujoco.MjData, reference: Reference, k: int) -> Array:
        """(4, 4) where its tool should be at step `k`, on its base as that stands now."""
        tool = reference.at(k)[3]
        if not self.rides:
            return tool
        moved: Array = self.base_matrix(data) @ np.linalg.inv(reference.base) @ tool
        return moved

    def still(self, data: mujoco.MjData) -> Reference:
        """Stay where the reference stands."""
        q = self.reference[None]
        return self.reference_of(data, q, np.zeros_like(q), np.zeros_like(q))

    def reference_of(self, data: mujoco.MjData, q: Array, qd: Array, qdd: Array) -> Reference:
        """Joints (T, n) to be at, with the tool poses that they make on the base as it stands now."""
        chain, base = self.robot.robot, self.base_matrix(data)
        tools = chain.fk_transform(q)
        if self.rides:
            tools = base @ np.linalg.inv(chain.T_world_base.matrix) @ tools
        return Reference(q, qd, qdd, tools, base)

    def follow(self, trajectory: Trajectory, timestep: float, data: mujoco.MjData) -> Reference:
        """What `execute` tracks; raises InputError for a trajectory that doesn't fit."""
        if abs(trajectory.dt - timestep) > 1e-9:
            raise InputError(
                f"the trajectory's step is {trajectory.dt:.6g} s, the simulation's {timestep:.6g} s",
                where="trajectory",
                remedy=f"retime with dt={timestep:.6g}",
            )
        if trajectory.q.shape[1] != self.robot.robot.dof:
            raise InputError(f"the trajectory moves {trajectory.q.shape[1]} joints", where="trajectory")
        gap = float(np.abs(trajectory.q[0] - self.reference).max())
        if gap > _START_TOLERANCE:
            raise InputError(f"the trajectory begins {gap:.3g} rad away from the robot", where="trajectory")
        if trajectory.base is not None:
            away = max(Pose.from_matrix(self.base_matrix(data)).error_to(trajectory.base))
            if away > _START_TOLERANCE:
                raise InputError(
                    f"the base of {self.name} stands {away:.3g} (metres or radians) from where it was planned for",
                    where="trajectory",
                    remedy="wait until what carries it rests, or plan from where it stands",
                )
        return self.reference_of(data, *discrete_reference(trajectory))

    def drive(
        self, data: mujoco.MjData, qpos: Array, wanted: tuple[Array, Array, Array, Array]
    ) -> tuple[Array, bool]:
        """Set the motors for one step; returns the torques (n,) and whether a joint has just reached its limit."""
        q, qd, qdd, _ = wanted
        torque, saturated = self.controller.torque(qpos, data.qvel, q, qd, qdd)
        data.ctrl[self.robot.actuator_ids] = self.controller.arm.command(torque, data.qpos, data.qvel)
        self.reference = q
        just, self.saturated = saturated and not self.saturated, saturated
        return torque, just
