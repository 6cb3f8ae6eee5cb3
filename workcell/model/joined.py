"""Several robots of a scene as one kinematic tree: their joints side by side, the world as their common base."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from itertools import pairwise
from typing import Any

import numpy as np

from workcell.errors import InputError
from workcell.model.coupling import Coupling
from workcell.model.coupling import side_by_side as couplings_side_by_side
from workcell.model.robot import Robot
from workcell.model.scene_parts import SceneRobot
from workcell.pose import Pose


def joined_robot(robots: Sequence[SceneRobot]) -> Robot:
    """One robot out of several: limits, paths and timing treat them together.

    Names of joints, links and tools get the robot's name in front, as in `left/joint1`; the default tool is the first
    robot's.

    Raises:
        InputError: no robot.
    """
    if not robots:
        raise InputError("there is no robot to join", where="robots")
    parents, xyz, rotation, links, tools = [], [], [], ["world"], {}
    first = 0
    for robot in robots:
        chain = robot.robot
        for k in range(chain.joint_count):
            root = chain.parents[k] == 0
            T = Pose.from_rotation(chain.joint_xyz[k], chain.joint_rotation[k])
            T = chain.T_world_base @ T if root else T
            parents.append(0 if root else first + int(chain.parents[k]))
            xyz.append(T.position)
            rotation.append(T.rotation)
            links.append(f"{robot.name}/{chain.link_names[k + 1]}")
        for tool in chain.tools.values():
            if tool.link > 0:
                name = f"{robot.name}/{tool.name}"
                tools[name] = replace(tool, name=name, link=first + tool.link)
        first += chain.joint_count
    chains = [robot.robot for robot in robots]

    def side_by_side(name: str) -> Any:
        return np.concatenate([getattr(chain, name) for chain in chains])

    return Robot(
        name="+".join(robot.name for robot in robots),
        joint_names=tuple(f"{robot.name}/{joint}" for robot in robots for joint in robot.robot.joint_names),
        link_names=tuple(links),
        parents=np.array(parents),
        joint_xyz=np.array(xyz),
        joint_rotation=np.array(rotation),
        tools=tools,
        default_tool=f"{robots[0].name}/{robots[0].robot.default_tool}",
        axis=side_by_side("axis"),
        prismatic=side_by_side("prismatic"),
        lower=side_by_side("lower"),
        upper=side_by_side("upper"),
        velocity=side_by_side("velocity"),
        acceleration=side_by_side("acceleration"),
        effort=side_by_side("effort"),
        home=side_by_side("home"),
        coupling=_coupling(robots),
    )


def _coupling(robots: Sequence[SceneRobot]) -> Coupling | None:
    joined = couplings_side_by_side([r.robot.coupling for r in robots], [r.robot.joint_names for r in robots])
    if joined is None:
        return None
    names = [f"{robot.name}/{joint}" for robot in robots for joint in robot.robot.all_joint_names]
    return replace(joined, joint_names=tuple(names))


def columns(robots: Sequence[SceneRobot]) -> list[slice]:
    """Where each robot's joints stand in the joined robot's configurations."""
    ends = np.cumsum([0, *(robot.robot.dof for robot in robots)])
    return [slice(int(a), int(b)) for a, b in pairwise(ends)]
