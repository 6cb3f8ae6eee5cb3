"""Serial robots of turning joints, as problem-set files have them."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import numpy as np

from workcell.model.robot import Robot, Tool
from workcell.pose import Array, Pose, quat_to_matrix


def serial_robot(
    name: str,
    joints: Sequence[Mapping[str, object]],
    T_link_tool: Pose,
) -> Robot:
    """A serial revolute robot from joints `{name, xyz, quat, axis, lower, upper}` (problem-set files)."""
    n = len(joints)

    def column(key: str) -> Array:
        return np.array([joint[key] for joint in joints], dtype=float)

    names = tuple(str(joint["name"]) for joint in joints)
    unlimited = np.full(n, np.inf)
    return Robot(
        name=name,
        joint_names=names,
        link_names=("base", *(f"link{k + 1}" for k in range(n))),
        parents=np.arange(n),
        joint_xyz=column("xyz"),
        joint_rotation=quat_to_matrix(column("quat")),
        axis=column("axis"),
        prismatic=np.zeros(n, dtype=bool),
        lower=column("lower"),
        upper=column("upper"),
        velocity=unlimited,
        acceleration=unlimited,
        effort=unlimited,
        tools={"tool": Tool("tool", n, T_link_tool)},
        default_tool="tool",
    )
