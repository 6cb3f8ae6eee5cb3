"""Robots as URDF, for packages that read nothing else."""

from __future__ import annotations

from collections.abc import Sequence
from xml.etree.ElementTree import Element, SubElement, tostring

import numpy as np

from workcell.model.robot import Robot
from workcell.pose import Array, Pose

ROOT = "world"
"""The link that all arms stand on."""


def urdf_of(names: Sequence[str], robots: Sequence[Robot]) -> str:
    """Serial arms without couplings on one root, their elements prefixed with their names, and their tools' frames.

    Kinematics and limits alone: no masses, no shapes.
    """
    root = Element("robot", name="arms")
    SubElement(root, "link", name=ROOT)
    for name, robot in zip(names, robots, strict=True):
        links = [f"{name}_link{k}" for k in range(robot.dof + 1)]
        for link in (*links, tool_link(name)):
            SubElement(root, "link", name=link)
        _joint(root, f"{name}_base", "fixed", ROOT, links[0], robot.T_world_base)
        for k in range(robot.dof):
            kind = "prismatic" if robot.prismatic[k] else "revolute"
            origin = Pose.from_rotation(robot.joint_xyz[k], robot.joint_rotation[k])
            joint = _joint(root, f"{name}_joint{k}", kind, links[k], links[k + 1], origin)
            SubElement(joint, "axis", xyz=_told(robot.axis[k]))
            limits = {"lower": robot.lower[k], "upper": robot.upper[k], "velocity": robot.velocity[k]}
            SubElement(
                joint, "limit", {key: repr(float(value)) for key, value in limits.items()}, effort="100"
            )
        frame = robot.tool()
        _joint(root, f"{name}_hand", "fixed", links[frame.link], tool_link(name), frame.T_link_tool)
    return tostring(root, encoding="unicode")


def tool_link(name: str) -> str:
    """The link that an arm's tool frame is."""
    return f"{name}_tool"


def _joint(root: Element, name: str, kind: str, parent: str, child: str, origin: Pose) -> Element:
    joint = SubElement(root, "joint", name=name, type=kind)
    SubElement(joint, "parent", link=parent)
    SubElement(joint, "child", link=child)
    SubElement(joint, "origin", xyz=_told(origin.position), rpy=_told(_roll_pitch_yaw(origin.rotation)))
    return joint


def _roll_pitch_yaw(R: Array) -> Array:
    """Angles (3,) of R = Rz(yaw) Ry(pitch) Rx(roll)."""
    pitch = np.arctan2(-R[2, 0], np.hypot(R[0, 0], R[1, 0]))
    if np.hypot(R[0, 0], R[1, 0]) < 1e-9:  # straight up or down: yaw is a choice
        return np.array([np.arctan2(-R[1, 2], R[1, 1]), pitch, 0.0])
    return np.array([np.arctan2(R[2, 1], R[2, 2]), pitch, np.arctan2(R[1, 0], R[0, 0])])


def _told(numbers: Array) -> str:
    return " ".join(repr(float(number)) for number in numbers)
