"""A `Robot` as a `Mechanism`: its m joints, those that follow others as followers, its tools as frames."""

from __future__ import annotations

import numpy as np

from workcell.model.mechanism.mechanism import Follower, Frame, Joint, Mechanism
from workcell.model.robot import Robot
from workcell.pose import Array, Pose


def of_robot(robot: Robot) -> Mechanism:
    """The mechanism of a robot, a chain or a tree; it comes from no compiled model.

    A configuration (m,) is of all the robot's joints, `robot.joint_values(q)` of its variables (n,); links have the
    robot's numbers, and its base is the world. Joints that follow others have the limits that follow from those.
    """
    everything = robot.uncoupled
    coupling = robot.coupling
    own = range(robot.joint_count) if coupling is None else coupling.own.tolist()
    lower, upper = np.array(everything.lower), np.array(everything.upper)
    lower[own], upper[own] = robot.lower, robot.upper
    joints = []
    for k, name in enumerate(everything.joint_names):
        T, parent = Pose.from_rotation(robot.joint_xyz[k], robot.joint_rotation[k]), int(robot.parents[k])
        joints.append(
            Joint(
                name,
                "slide" if robot.prismatic[k] else "hinge",
                parent,
                robot.T_world_base @ T if parent == 0 else T,
                robot.axis[k],
                float(lower[k]),
                float(upper[k]),
            )
        )
    frames = {
        tool.name: Frame(
            tool.name,
            tool.link,
            tool.T_link_tool if tool.link else robot.T_world_base @ tool.T_link_tool,
        )
        for tool in robot.tools.values()
    }
    return Mechanism(
        name=robot.name,
        joints=tuple(joints),
        link_names=("world", *robot.link_names[1:]),
        followers=_followers(robot, everything.joint_names),
        frames=frames,
        home=robot.joint_values(robot.home),
    )


def variables_of(robot: Robot, q: Array) -> Array:
    """The robot's variables (n,) at a configuration (m,) of its mechanism that keeps the couplings."""
    return np.array(q) if robot.coupling is None else robot.coupling.variables(q)


def _followers(robot: Robot, names: tuple[str, ...]) -> tuple[Follower, ...]:
    coupling = robot.coupling
    if coupling is None:
        return ()
    found = []
    for joint in coupling.followers.tolist():
        leader = int(coupling.own[coupling.variable[joint]])
        row = np.trim_zeros(coupling.coefficients[joint], "b")
        found.append(
            Follower(
                f"{names[joint]} follows {names[leader]}", joint, leader, row if len(row) else np.zeros(1)
            )
        )
    return tuple(found)
