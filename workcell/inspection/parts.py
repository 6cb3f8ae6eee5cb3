"""What a robot's tools are and could be; what carries no geometry; what belongs to nothing."""

from __future__ import annotations

from collections.abc import Collection, Iterator
from typing import TYPE_CHECKING

import numpy as np

from workcell.inspection.findings import Finding, beware, fact, wrong
from workcell.model.labels import body_name
from workcell.model.loading.actuators import actuator_of_joint
from workcell.model.loading.subtrees import joints_of, path_to

if TYPE_CHECKING:
    import mujoco

    from workcell.model.scene import Scene
    from workcell.model.scene_parts import SceneRobot

MOST_ARMS = 3
"""Other arms of one file that are told one by one."""


def tool_findings(scene: Scene) -> Iterator[Finding]:
    """The tool that is placed, the others on the way to it, and sites that other joints move."""
    for robot in scene.robots.values():
        arm = robot.robot
        others = [name for name in arm.tools if name != arm.default_tool]
        also = f"; also: {', '.join(others)}" if others else ""
        yield fact(
            "tool", f"tool of {robot.name}: {arm.default_tool}{also}", robot=robot.name, tool=arm.default_tool,
            others=others,
        )  # fmt: skip
        yield from _elsewhere(scene.model, robot)


def _elsewhere(model: mujoco.MjModel, robot: SceneRobot) -> Iterator[Finding]:
    """Sites of a robot's bodies to which other driven joints lead: tools of another arm, or of a hand's fingers."""
    own = robot.own_ids
    chain = set(robot.joint_qpos_addresses.tolist())
    arms: dict[tuple[str, ...], list[str]] = {}
    for site in range(model.nsite):
        body, name = int(model.site_bodyid[site]), str(model.site(site).name).removeprefix(robot.prefix)
        if body not in own or not name or name in robot.site_ids:
            continue
        joints = [j for b in path_to(model, body, own) for j in joints_of(model, b)]
        if any(
            int(model.jnt_qposadr[j]) not in chain and actuator_of_joint(model, j) is not None for j in joints
        ):
            names = tuple(str(model.joint(j).name).removeprefix(robot.prefix) for j in joints)
            arms.setdefault(names, []).append(name)
    together = "All of them can be asked for at once: workcell ik --goals"
    if len(arms) > MOST_ARMS:
        sites = [name for names in arms.values() for name in names]
        yield fact(
            "tool",
            f"{len(sites)} more sites hang on other driven joints: {', '.join(sites)}. {together}; each could be the "
            f'tool instead (tool = "{sites[0]}" beside the robot in a task file)',
            robot=robot.name, could_be=sites,
        )  # fmt: skip
        return
    for joints_named, (name, *others) in arms.items():
        also = f" (and {', '.join(others)})" if others else ""
        yield fact(
            "tool",
            f"{name}{also} could be the tool instead: an arm of {len(joints_named)} joints "
            f'({", ".join(joints_named)}). Choose it with tool = "{name}" beside the robot in a task file, or '
            f'load_robot(file, tool="{name}"). {together}',
            robot=robot.name, could_be=name, also=others, joints=list(joints_named),
        )  # fmt: skip


def geometry_findings(scene: Scene) -> Iterator[Finding]:
    """Robots, and links that move, without geometry that can collide: nothing to check is not clear."""
    model = scene.model
    collides = (np.asarray(model.geom_contype) != 0) | (np.asarray(model.geom_conaffinity) != 0)
    in_pairs = np.union1d(model.pair_geom1, model.pair_geom2).astype(int)
    collides[in_pairs] = True
    with_shape = {int(body) for body in np.asarray(model.geom_bodyid)[collides]}
    for robot in scene.robots.values():
        if not robot.own_ids & with_shape:
            yield wrong(
                "geometry",
                f"robot {robot.name} has no geometry that can collide: nothing would be checked. Give its links geoms "
                "with contype and conaffinity (<collision> in a URDF)",
                robot=robot.name,
            )  # fmt: skip
            continue
        bare = [
            robot.robot.link_names[link]
            for link, bodies in enumerate(robot.link_body_ids)
            if link > 0 and not with_shape.intersection(bodies)
        ]
        if bare:
            yield beware(
                "geometry",
                f"links of {robot.name} without geometry that can collide, which nothing is checked for: "
                f"{', '.join(bare)}",
                robot=robot.name, links=bare,
            )  # fmt: skip


def stray_findings(scene: Scene, moving: Collection[int] = ()) -> Iterator[Finding]:
    """Bodies that can move and belong to no robot, no object and not to what is `moving` (ids): they stand."""
    model = scene.model
    known = set[int](moving).union(
        *(r.body_ids for r in scene.robots.values()), *(o.body_ids for o in scene.objects.values())
    )
    known |= frozenset() if scene.mechanism is None else scene.mechanism.own_ids
    strays = [
        body_name(model, b)
        for b in range(1, model.nbody)
        if b not in known and int(model.body_weldid[b]) != 0
    ]
    if strays:
        yield beware(
            "body",
            f"belong to no robot and no object, and count as standing where the model has them: {', '.join(strays)}",
            bodies=strays,
        )  # fmt: skip
