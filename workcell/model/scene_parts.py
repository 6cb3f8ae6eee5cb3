"""What a scene is made of: its robots, objects and goals; and where bodies and sites stand at raw positions."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import ArrayLike, NDArray

from workcell.errors import UnknownNameError
from workcell.model.loops.loops import Loops
from workcell.model.robot import Robot
from workcell.pose import Array, Pose, read_only

if TYPE_CHECKING:
    import mujoco


@dataclass(frozen=True, slots=True)
class SceneRobot:
    """One robot of a scene, and where it lives in the compiled model.

    Attributes:
        name: its name in the scene.
        prefix: of all its elements in the compiled model, e.g. `sawyer/`.
        robot: its kinematics, with the base where it stands as the scene begins.
        body_ids: all bodies that are its own, gripper included, and its guests.
        link_body_ids: for each link, the bodies that it carries.
        qpos_addresses, dof_addresses, actuator_ids: (n,) of its variables, in the robot's order.
        gripper: name of the actuator that closes its gripper, or None.
        start: (n,) configuration at the start of the task.
        fingers: (address in qpos, home value) of the joints that are not planned for: the gripper's.
        base_body: the body that its link 0 is, or that its first joint moves.
        site_ids: ids of its tools' sites, by the tools' names.
        guest_ids: bodies of others that its links carry: of an object fixed to its hand, of a robot on its flange.
        joint_qpos_addresses, joint_dof_addresses: (m,) of all its joints, those that follow included; empty: n = m.
        riders: (address in qpos, value) of its guests' joints as the scene begins.
        loops: its joints that nothing drives, and what determines them; None: nobody has looked.
        source: the file that it came from; None: not known.
    """

    name: str
    prefix: str
    robot: Robot
    body_ids: frozenset[int]
    link_body_ids: tuple[tuple[int, ...], ...]
    qpos_addresses: NDArray[np.int64]
    dof_addresses: NDArray[np.int64]
    actuator_ids: NDArray[np.int64]
    gripper: str | None
    start: Array
    fingers: tuple[tuple[int, float], ...] = ()
    joint_qpos_addresses: NDArray[np.int64] = field(default_factory=lambda: np.zeros(0, dtype=np.int64))
    joint_dof_addresses: NDArray[np.int64] = field(default_factory=lambda: np.zeros(0, dtype=np.int64))
    base_body: int = 0
    site_ids: Mapping[str, int] = field(default_factory=dict)
    guest_ids: frozenset[int] = frozenset()
    riders: tuple[tuple[int, float], ...] = ()
    loops: Loops | None = None
    source: Path | None = None

    @property
    def own_ids(self) -> frozenset[int]:
        """Its own bodies, gripper included, without guests."""
        return self.body_ids - self.guest_ids

    @property
    def hand_ids(self) -> frozenset[int]:
        """Its own bodies that the tool's link carries: what may touch an object in the hand."""
        return self.own_ids.intersection(self.link_body_ids[self.robot.tool().link])

    def has_moving_base(self, model: mujoco.MjModel) -> bool:
        """Whether a joint that is not its own moves its base: a carriage's, a lift's, another robot's."""
        return int(model.body_weldid[model.body_parentid[self.base_body]]) != 0

    def standing(self, model: mujoco.MjModel, qpos: ArrayLike) -> SceneRobot:
        """The same robot with its base, and the joints of its guests, where raw positions (nq,) have them.

        The robot itself where nothing of that is different.
        """
        values, found = np.asarray(qpos, dtype=float), self
        riders = tuple((address, float(values[address])) for address, _ in self.riders)
        if riders != self.riders:
            found = replace(found, riders=riders)
        if not self.has_moving_base(model):
            return found
        below = body_pose(model, int(model.body_parentid[self.base_body]), values)
        base = below @ Pose(model.body_pos[self.base_body], model.body_quat[self.base_body])
        here = self.robot.T_world_base
        if np.array_equal(base.matrix, here.matrix):
            return found
        return replace(found, robot=replace(self.robot, T_world_base=base))

    def __post_init__(self) -> None:
        object.__setattr__(self, "start", read_only(self.start))
        for name in ("qpos", "dof"):
            if len(getattr(self, f"joint_{name}_addresses")) == 0:
                object.__setattr__(self, f"joint_{name}_addresses", getattr(self, f"{name}_addresses"))
        addresses = ("qpos_addresses", "dof_addresses", "joint_qpos_addresses", "joint_dof_addresses")
        for name in (*addresses, "actuator_ids"):
            object.__setattr__(self, name, read_only(getattr(self, name), np.int64))

    def place(self, qpos: Array, q: Array) -> str:
        """Write a configuration (n,), and what follows from it, into raw positions (nq,).

        Returns:
            why it is none of the mechanism, where a passive loop can't be closed; else an empty text.
        """
        qpos[self.joint_qpos_addresses] = self.robot.joint_values(q)
        return "" if self.loops is None else self.loops.close(qpos)


@dataclass(frozen=True, slots=True)
class SceneObject:
    """A thing that a task handles; `qpos_address` of its free joint is None when it is fixed.

    Its bodies are those of its own file, and those of what is fixed to it.
    """

    name: str
    body_id: int
    body_ids: frozenset[int]
    qpos_address: int | None

    def place(self, qpos: Array, pose: Pose) -> None:
        """Write the world pose of its root body into raw positions (nq,); a fixed one stays where it is."""
        at = self.qpos_address
        if at is not None:
            qpos[at : at + 3], qpos[at + 3 : at + 7] = pose.position, pose.quat_wxyz


@dataclass(frozen=True, slots=True)
class Goal:
    """A named pose `T_world_tool` for a robot's tool."""

    name: str
    robot: str
    pose: Pose


def place_holding(qpos: Array, robot: SceneRobot, q: Array, held: SceneObject, T_tool_object: Pose) -> str:
    """Write a robot's configuration (n,) into raw positions (nq,), and where the object in its hand is then.

    Returns what `SceneRobot.place` does.

    Args:
        qpos: (nq,) raw positions, changed.
        robot: whose hand.
        q: (n,) its configuration.
        held: the object.
        T_tool_object: how it stands in the tool's frame.
    """
    reason = robot.place(qpos, q)
    held.place(qpos, robot.robot.fk(q) @ T_tool_object)
    return reason


def data_at(model: mujoco.MjModel, qpos: ArrayLike) -> mujoco.MjData:
    """Fresh data with bodies, geoms and sites where raw positions (nq,) have them; nothing else is computed."""
    import mujoco

    data = mujoco.MjData(model)
    data.qpos[:] = qpos
    mujoco.mj_kinematics(model, data)
    return data


def body_pose(model: mujoco.MjModel, body: int, qpos: ArrayLike) -> Pose:
    """World pose of a body (id) at raw positions (nq,)."""
    data = data_at(model, qpos)
    return Pose(data.xpos[body], data.xquat[body])


def site_pose(model: mujoco.MjModel, name: str, qpos: Array, where: str | Path) -> Pose:
    """World pose of a site at raw positions (nq,); raises UnknownNameError with the model's sites."""
    import mujoco

    site = mujoco.mj_name2id(model, mujoco.mjtObj.mjOBJ_SITE, name)
    if site < 0:
        raise UnknownNameError("site", name, [model.site(i).name for i in range(model.nsite)], where=where)
    data = data_at(model, qpos)
    return Pose.from_rotation(data.site_xpos[site], data.site_xmat[site].reshape(3, 3))
