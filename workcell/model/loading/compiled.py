"""The `Robot` inside a compiled MuJoCo model: joints, limits, tools and link bodies."""

from __future__ import annotations

from collections.abc import Collection, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from workcell.errors import ModelError, UnknownNameError
from workcell.model.loading.actuators import actuator_of_joint, effort_limits
from workcell.model.loading.couplings import ChainLimits, chain_variables, leaders, locked_values
from workcell.model.loading.subtrees import bodies_of_links, joints_of, path_to
from workcell.model.robot import LIMIT_SLACK, Robot, Tool
from workcell.pose import Array, Pose, axis_angle_to_matrix

if TYPE_CHECKING:
    import mujoco

VELOCITY, ACCELERATION = ":velocity", ":acceleration"
"""Suffixes of the `<numeric>` elements that carry a joint's limits, which MJCF itself has no attribute for."""


@dataclass(frozen=True, slots=True)
class CompiledRobot:
    """A `Robot`, and where it lives in its compiled model.

    Attributes:
        robot: its kinematics.
        base: id of the body that is its link 0, or that its first joint moves.
        joints: ids of its m joints, in order.
        variables: (n,) places in them of those that are variables.
        sites: ids of its tools' sites, by the tools' names.
    """

    robot: Robot
    base: int
    joints: tuple[int, ...]
    variables: tuple[int, ...]
    sites: Mapping[str, int]


def robot_from_model(
    model: mujoco.MjModel, *, name: str = "robot", tool: str | None = None, where: str | Path | None = None
) -> Robot:
    """The one robot of a compiled model; raises as `compiled_robot`."""
    return compiled_robot(model, name=name, tool=tool, where=where).robot


def compiled_robot(
    model: mujoco.MjModel,
    *,
    bodies: Collection[int] | None = None,
    prefix: str = "",
    name: str = "robot",
    tool: str | None = None,
    where: str | Path | None = None,
) -> CompiledRobot:
    """The actuated joints between a robot's root body and its tool, as a `Robot`, and their ids.

    The tool is a site: `tool` if named (with or without the prefix); else the site called `tool` that lies deepest
    (a gripper's hides the arm's own); else the deepest site. All other sites on those links are tools too.

    Args:
        model: compiled model that holds the robot.
        bodies: ids of the robot's own bodies; None: all.
        prefix: of its elements' names in the model, which its own names are without.
        name: the robot's name in messages.
        tool: a site's name.
        where: the file, for messages.

    Raises:
        ModelError: no actuated joint, no site, or a joint that is neither hinge nor slide on the way to the tool.
        UnknownNameError: no site of that name.
    """
    bodies = frozenset(range(1, model.nbody) if bodies is None else bodies)
    if not bodies:
        raise ModelError(f"the robot {name!r} has no body", where=where)
    if not any(_is_actuated(model, joint) for body in bodies for joint in joints_of(model, body)):
        raise ModelError(
            f"the robot {name!r} has no actuated joint",
            where=where,
            remedy="add an <actuator> with a <motor joint=...> for every joint that workcell may move",
        )
    site = _tool_site(model, bodies, prefix, tool, name, where)
    path = path_to(model, int(model.site_bodyid[site]), bodies)
    walk = _walk(model, path, name, where)
    tools, sites = _tools(model, bodies, prefix, walk)
    joint_names = tuple(model.joint(j).name.removeprefix(prefix) for j in walk.joints)
    count = len(walk.joints)
    own = ChainLimits(
        *_limits(model, walk.joints, where),
        _numeric_limits(model, walk.joints, VELOCITY, where),
        _numeric_limits(model, walk.joints, ACCELERATION, where),
        effort_limits(model, walk.joints),
    )
    variables = chain_variables(model, walk.joints, joint_names, own, where)
    limits = variables.limits
    robot = Robot(
        name=name,
        joint_names=tuple(joint_names[k] for k in variables.joints),
        link_names=(
            model.body(path[0]).name.removeprefix(prefix),
            *(model.body(int(model.jnt_bodyid[j])).name.removeprefix(prefix) for j in walk.joints),
        ),
        parents=np.arange(count),
        joint_xyz=np.array(walk.xyz).reshape(-1, 3),
        joint_rotation=np.array(walk.rotation).reshape(-1, 3, 3),
        axis=np.array([model.jnt_axis[j] for j in walk.joints]),
        prismatic=np.array([int(model.jnt_type[j]) == _slide() for j in walk.joints]),
        lower=limits.lower,
        upper=limits.upper,
        velocity=limits.velocity,
        acceleration=limits.acceleration,
        effort=limits.effort,
        tools=tools,
        default_tool=model.site(site).name.removeprefix(prefix),
        T_world_base=_pose_of_fixed_body(model, path[0]),
        home=np.array([_home_value(model, walk.joints[k], prefix) for k in variables.joints]),
        coupling=variables.coupling,
    )
    return CompiledRobot(robot, path[0], tuple(walk.joints), variables.joints, sites)


@dataclass(frozen=True, slots=True)
class _Walk:
    """The actuated joints on a body path, with the pose of every body of the path in its link's frame."""

    joints: list[int]
    xyz: list[Array]
    rotation: list[Array]
    link_of_body: dict[int, int]
    T_link_body: dict[int, Pose]


def _walk(model: mujoco.MjModel, path: Sequence[int], name: str, where: str | Path | None) -> _Walk:
    """Follow the bodies from the root, folding fixed transforms; a link's frame sits at its joint's anchor."""
    walk = _Walk([], [], [], {path[0]: 0}, {path[0]: Pose.identity()})
    T_link_body = Pose.identity()
    held, follows = locked_values(model), leaders(model)
    for body in path:
        if body != path[0]:
            T_link_body = T_link_body @ Pose(model.body_pos[body], model.body_quat[body])
        for joint in joints_of(model, body):
            leads = joint in follows or any(
                leader == joint for found in follows.values() for leader, _ in found
            )
            idle = not _is_actuated(model, joint)
            if (idle and joint not in held and not leads) or not _is_single(model, joint):
                kind = "is not actuated" if _is_single(model, joint) else "is neither hinge nor slide"
                raise ModelError(
                    f"joint {model.joint(joint).name!r} lies between the base of {name} and its tool, but {kind}",
                    where=where,
                    remedy="workcell plans for actuated hinge and slide joints, and those that follow them",
                )
            anchor, axis = model.jnt_pos[joint], model.jnt_axis[joint]
            reference = float(model.qpos0[model.jnt_qposadr[joint]])
            slide = int(model.jnt_type[joint]) == _slide()
            if idle and joint in held and all(leader in held for leader, _ in follows.get(joint, [])):
                away = held[joint] - reference
                turn = np.eye(3) if slide else axis_angle_to_matrix(axis, away)
                shift = away * axis if slide else anchor - turn @ anchor
                T_link_body = T_link_body @ Pose.from_rotation(shift, turn)
                continue
            walk.joints.append(joint)
            offset = anchor - (reference * axis if slide else 0.0)
            walk.xyz.append(T_link_body.apply(offset))
            turn = np.eye(3) if slide else axis_angle_to_matrix(axis, -reference)
            walk.rotation.append(T_link_body.rotation @ turn)
            T_link_body = Pose.from_xyz(-np.asarray(anchor))
        walk.link_of_body[body] = len(walk.joints)
        walk.T_link_body[body] = T_link_body
    if not walk.joints:
        raise ModelError(f"no actuated joint moves the tool of {name}", where=where)
    return walk


def _tools(
    model: mujoco.MjModel, bodies: Collection[int], prefix: str, walk: _Walk
) -> tuple[dict[str, Tool], dict[str, int]]:
    """The sites that the walk's links carry: as tools, and their ids."""
    tools, sites = {}, {}
    for site in range(model.nsite):
        body = int(model.site_bodyid[site])
        name = model.site(site).name
        if body not in bodies or not name:
            continue
        T = Pose(model.site_pos[site], model.site_quat[site])
        while body not in walk.link_of_body and body in bodies and not joints_of(model, body):
            T = Pose(model.body_pos[body], model.body_quat[body]) @ T
            body = int(model.body_parentid[body])
        if body in walk.link_of_body:
            name = name.removeprefix(prefix)
            tools[name] = Tool(name, walk.link_of_body[body], walk.T_link_body[body] @ T)
            sites[name] = site
    return tools, sites


def is_gripper(model: mujoco.MjModel) -> bool:
    """Whether a model by itself is a hand.

    It is one if its one actuator, `gripper`, drives no joint directly; or if it is a tool without joints. A
    tool without joints is a body with a site `tool`, such as a stylus.
    """
    actuators = [model.actuator(i).name for i in range(model.nu)]
    if not actuators and model.njnt == 0:
        return any(model.site(site).name == "tool" for site in range(model.nsite))
    driven = any(actuator_of_joint(model, joint) is not None for joint in range(model.njnt))
    return actuators == ["gripper"] and not driven


def link_bodies(model: mujoco.MjModel, robot: Robot) -> tuple[tuple[int, ...], ...]:
    """For each link of a robot that was compiled by itself, the MuJoCo bodies that it carries."""
    return bodies_of_links(
        model, [model.joint(name).id for name in robot.all_joint_names], range(1, model.nbody)
    )


def _tool_site(
    model: mujoco.MjModel,
    bodies: Collection[int],
    prefix: str,
    tool: str | None,
    name: str,
    where: str | Path | None,
) -> int:
    sites = {
        model.site(s).name: s
        for s in range(model.nsite)
        if int(model.site_bodyid[s]) in bodies and model.site(s).name
    }
    if tool is not None:
        for candidate in (tool, prefix + tool):
            if candidate in sites:
                return sites[candidate]
        raise UnknownNameError("tool site", tool, [s.removeprefix(prefix) for s in sites], where=where)
    if not sites:
        raise ModelError(
            f"the robot {name!r} has no site",
            where=where,
            remedy='add <site name="tool"/> to the link that carries the tool',
        )

    def depth(item: tuple[str, int]) -> tuple[bool, int]:
        return item[0].rsplit("/", 1)[-1] == "tool", len(
            path_to(model, int(model.site_bodyid[item[1]]), bodies)
        )

    # of several as deep the first by name, in whatever order they stand in the file
    return max(sorted(sites.items()), key=depth)[1]


def _is_single(model: mujoco.MjModel, joint: int) -> bool:
    return int(model.jnt_type[joint]) in (_hinge(), _slide())


def _is_actuated(model: mujoco.MjModel, joint: int) -> bool:
    return actuator_of_joint(model, joint) is not None


def _limits(model: mujoco.MjModel, joints: Sequence[int], where: str | Path | None) -> tuple[Array, Array]:
    """Position limits, infinite for joints without.

    A range that MuJoCo is told to ignore (`limited="false"`) holds here, and a locked joint has its one value.
    """
    held = locked_values(model)
    lower, upper = [], []
    for joint in joints:
        low, high = map(float, model.jnt_range[joint])
        name = model.joint(joint).name
        given = bool(model.jnt_limited[joint]) or low != 0.0 or high != 0.0
        if not low <= high:  # MuJoCo takes the joint for unlimited
            raise ModelError(
                f"the range of joint {name!r} is {model.jnt_range[joint].tolist()}",
                where=where,
                remedy="the lower limit, then the upper one",
            )
        if joint in held:
            value = held[joint]
            if given and not low - LIMIT_SLACK <= value <= high + LIMIT_SLACK:
                raise ModelError(
                    f"an equality constraint holds joint {name!r} at {value:g}, outside its range [{low:g}, {high:g}]",
                    where=where,
                )
            low, high = value, value
        elif not given:
            low, high = -np.inf, np.inf
        lower.append(low)
        upper.append(high)
    return np.array(lower), np.array(upper)


def _numeric_limits(
    model: mujoco.MjModel, joints: Sequence[int], suffix: str, where: str | Path | None
) -> Array:
    names = {model.numeric(i).name: i for i in range(model.nnumeric)}
    values = []
    for joint in joints:
        numeric = names.get(model.joint(joint).name + suffix)
        value = np.inf if numeric is None else float(model.numeric_data[model.numeric_adr[numeric]])
        if not value > 0:
            raise ModelError(
                f"the limit {model.joint(joint).name + suffix!r} is {value:g}",
                where=where,
                remedy="a positive number",
            )
        values.append(value)
    return np.array(values)


def _home_value(model: mujoco.MjModel, joint: int, prefix: str) -> float:
    address = int(model.jnt_qposadr[joint])
    for key in range(model.nkey):
        if model.key(key).name == prefix + "home":
            return float(model.key_qpos[key, address])
    return float(model.qpos0[address])


def _pose_of_fixed_body(model: mujoco.MjModel, body: int) -> Pose:
    pose = Pose.identity()
    while body > 0:
        pose = Pose(model.body_pos[body], model.body_quat[body]) @ pose
        body = int(model.body_parentid[body])
    return pose


def _hinge() -> int:
    import mujoco

    return int(mujoco.mjtJoint.mjJNT_HINGE)


def _slide() -> int:
    import mujoco

    return int(mujoco.mjtJoint.mjJNT_SLIDE)
