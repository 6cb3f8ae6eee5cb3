"""The joints of a compiled model as those of a mechanism, body by body, parents first."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from workcell.errors import ModelError
from workcell.model.loading.actuators import actuated_joints
from workcell.model.loading.couplings import leaders, locked_values
from workcell.model.loops.elements import joints_on
from workcell.model.mechanism.mechanism import WORLD, Joint, JointKind
from workcell.model.robot import LIMIT_SLACK
from workcell.pose import Array, Pose, axis_angle_to_matrix

if TYPE_CHECKING:
    import mujoco

KINDS: Mapping[int, JointKind] = {0: "free", 1: "ball", 2: "slide", 3: "hinge"}
"""MuJoCo's `mjtJoint`."""


def joint_label(model: mujoco.MjModel, joint: int) -> str:
    """A joint's name, or its number where it has none; no other joint has that."""
    if name := str(model.joint(joint).name):
        return name
    label, known = f"joint {joint}", {str(model.joint(other).name) for other in range(model.njnt)}
    while label in known:
        label = f"{label} (unnamed)"
    return label


def addresses_of(model: mujoco.MjModel, joint: int) -> slice:
    """Where a joint's numbers are in raw positions."""
    first = int(model.jnt_qposadr[joint])
    return slice(first, first + {0: 7, 1: 4}.get(int(model.jnt_type[joint]), 1))


class Walk:
    """The joints of all bodies, parents first, and where every body is on its link.

    Args:
        model: compiled model.
        moving: ids of the joints that move.
        start: (nq,) where the others stand.
        where: the file, for messages.

    Attributes:
        joints, names: the joints, and the links' names.
        link_of_body, T_link_body: of every body.

    Raises:
        ModelError: limits the wrong way round, or none of which a joint that is held keeps.
    """

    def __init__(
        self, model: mujoco.MjModel, moving: frozenset[int], start: Array, where: str | Path | None
    ) -> None:
        self.joints: list[Joint] = []
        self.names = ["world"]
        self.link_of_body, self.T_link_body = [WORLD], [Pose.identity()]
        self._model, self._start, self._where = model, start, where
        self._held = locked_values(model)
        follows = leaders(model)
        driven = actuated_joints(model)
        self._driven = driven | {
            j for j, found in follows.items() if any(lead in driven for lead, _ in found)
        }
        for body in range(1, model.nbody):
            self._body(body, moving)

    def _body(self, body: int, moving: frozenset[int]) -> None:
        model = self._model
        parent = int(model.body_parentid[body])
        link, T = self.link_of_body[parent], self.T_link_body[parent]
        T = T @ Pose(model.body_pos[body], model.body_quat[body])
        for joint in joints_on(model, body):
            if joint in moving:
                link, T = self._joint(joint, link, T)
            else:
                T = self._fixed(joint, T)
        self.link_of_body.append(link)
        self.T_link_body.append(T)

    def _fixed(self, joint: int, T: Pose) -> Pose:
        """Where a body is after a joint that stays where it begins."""
        model, value = self._model, self._start[addresses_of(self._model, joint)]
        kind, anchor, axis = KINDS[int(model.jnt_type[joint])], model.jnt_pos[joint], model.jnt_axis[joint]
        if kind == "free":
            return Pose(value[:3], value[3:])
        reference = float(model.qpos0[model.jnt_qposadr[joint]])
        if kind == "slide":
            return T @ Pose.from_xyz((value[0] - reference) * axis)
        turn = (
            Pose(np.zeros(3), value)
            if kind == "ball"
            else Pose.from_rotation(np.zeros(3), axis_angle_to_matrix(axis, value[0] - reference))
        )
        return T @ Pose.from_xyz(anchor) @ turn @ Pose.from_xyz(-np.asarray(anchor))

    def _joint(self, joint: int, link: int, T: Pose) -> tuple[int, Pose]:
        model = self._model
        kind, name = KINDS[int(model.jnt_type[joint])], joint_label(self._model, joint)
        axis, anchor = np.array(model.jnt_axis[joint]), np.array(model.jnt_pos[joint])
        lower, upper = self._limits(joint, kind, name)
        if kind == "free":
            link, frame, below, axis = WORLD, Pose.identity(), Pose.identity(), np.zeros(3)
        else:
            frame, below = T @ Pose.from_xyz(anchor), Pose.from_xyz(-anchor)
            reference = float(model.qpos0[model.jnt_qposadr[joint]])
            if kind == "slide":
                frame = frame @ Pose.from_xyz(-reference * axis)
            elif kind == "hinge":
                frame = frame @ Pose.from_rotation(np.zeros(3), axis_angle_to_matrix(axis, -reference))
            else:
                axis = np.zeros(3)
        self.joints.append(Joint(name, kind, link, frame, axis, lower, upper, joint, joint in self._driven))
        body = int(model.jnt_bodyid[joint])
        self.names.append(str(model.body(body).name) or f"body {body}")
        return len(self.joints), below

    def _limits(self, joint: int, kind: JointKind, name: str) -> tuple[float, float]:
        """Limits as the file means them: MuJoCo ignores a range of zero width, and one beside `limited="false"`."""
        low, high = map(float, self._model.jnt_range[joint])
        given = bool(self._model.jnt_limited[joint]) or low != 0.0 or high != 0.0
        if kind == "free":
            return -np.inf, np.inf
        if not low <= high:
            raise ModelError(
                f"the range of joint {name!r} is [{low:g}, {high:g}]",
                where=self._where,
                remedy="the lower limit, then the upper one",
            )
        if kind == "ball":
            return (0.0, high) if given else (0.0, np.inf)
        if joint in self._held:
            value = self._held[joint]
            if given and not low - LIMIT_SLACK <= value <= high + LIMIT_SLACK:
                raise ModelError(
                    f"an equality constraint holds joint {name!r} at {value:g}, outside its range [{low:g}, {high:g}]",
                    where=self._where,
                )
            return value, value
        return (low, high) if given else (-np.inf, np.inf)
