"""The parts of a compiled `Scene` from a task file or a cell: robots and objects attached by `MjSpec.attach`."""

from __future__ import annotations

from collections.abc import Collection, Iterable, Mapping
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from workcell.errors import InputError, ModelError, UnknownNameError
from workcell.model.loading.actuators import actuator_of_joint
from workcell.model.loading.assets import find_asset, find_task, is_path, list_assets, list_tasks
from workcell.model.loading.compiled import compiled_robot
from workcell.model.loading.couplings import harden, settled
from workcell.model.loading.labels import keep_apart
from workcell.model.loading.load import compile_spec, load_spec
from workcell.model.loading.passive_joints import find_loops
from workcell.model.loading.placing import cell_site
from workcell.model.loading.subtrees import Members, actuators_of, bodies_of_links, joints_of
from workcell.model.loading.taskfile import ObjectEntry, RobotEntry, TaskFile, read_task_file
from workcell.model.loops.loops import Loops
from workcell.model.scene_parts import SceneObject, SceneRobot

if TYPE_CHECKING:
    import mujoco

GRASP = "grasp:{robot}:{object}"
"""Name of the weld, inactive at first, that holds an object to a robot's hand once the simulation grasps it."""


@dataclass(frozen=True, slots=True)
class Mounted:
    """A robot in a cell that is not compiled yet.

    Attributes:
        roots: its root bodies.
        hand: the body that carries its gripper's tool, or None.
        home: values of its keyframe `home` by joint name.
    """

    roots: tuple[mujoco.MjsBody, ...]
    hand: mujoco.MjsBody | None = None
    home: Mapping[str, float] = field(default_factory=dict)


def task_of(source: str | Path, robot: str | None) -> TaskFile:
    """The task file of `source`; a cell alone becomes a task without goals."""
    text = str(source)
    if text.endswith((".toml", ".py")) or text in list_tasks():
        task = read_task_file(find_task(source))
        if robot is None:
            return task
        if len(task.robots) != 1:
            raise InputError(
                f"the task {task.name} has {len(task.robots)} robots",
                where="robot",
                remedy="change its task file",
            )
        entry = task.robots[0]
        if robot == entry.model:
            return task
        # a robot that is called after its model is called after the other one now, by the goals too
        name = Path(robot).stem if entry.name == entry.model else entry.name
        goals = tuple(replace(goal, robot=name) if goal.robot == entry.name else goal for goal in task.goals)
        other = replace(entry, name=name, model=robot, start=None, gripper_site="tool", tool=None)
        return replace(task, robots=(other,), goals=goals)
    if text not in list_assets("cells") and not is_path(text):
        raise UnknownNameError("task or cell", text, [*list_tasks(), *list_assets("cells")])
    path = find_asset("cells", source)
    robots = () if robot is None else (RobotEntry(Path(robot).stem, robot),)
    return TaskFile(path, path.stem, str(path), robots)


def attach_robot(spec: mujoco.MjSpec, entry: RobotEntry, task: TaskFile) -> Mounted:
    """Mount a robot (and its gripper) in the cell."""
    where, tool = f"{task.path}: robot {entry.name!r}", None
    arm = load_spec(entry.model, relative_to=task.path.parent, where=f"{where} model")
    home = _take_home(arm, entry.model)
    if entry.gripper is not None:
        gripper = load_spec(entry.gripper, relative_to=task.path.parent, where=f"{where} gripper")
        home |= {f"gripper/{joint}": value for joint, value in _take_home(gripper, entry.gripper).items()}
        site = arm.site(entry.gripper_site)
        if site is None:
            raise UnknownNameError(
                "site", entry.gripper_site, [s.name for s in arm.sites], where=f"{task.path}: gripper_site"
            )
        keep_apart(arm, gripper, "gripper/", f"{where} gripper")
        tool = gripper.site("tool")
        arm.attach(gripper, site=site, prefix="gripper/")
    mount = entry.mount or ("robot_mount" if spec.site("robot_mount") is not None else None)
    prefix, roots = f"{entry.name}/", tuple(arm.worldbody.bodies)
    keep_apart(spec, arm, prefix, f"{where} model")
    if mount is None:
        spec.attach(arm, frame=spec.worldbody.add_frame(), prefix=prefix)
    else:
        spec.attach(
            arm, site=cell_site(spec, mount, f"{task.path}: robot {entry.name!r} mount"), prefix=prefix
        )
    return Mounted(roots, None if tool is None else tool.parent, home)


def _take_home(spec: mujoco.MjSpec, where: str) -> dict[str, float]:
    """Values of the keyframe `home` by joint name; keyframes are removed, as they don't fit the larger model."""
    home: dict[str, float] = {}
    if list(spec.keys):
        model = compile_spec(spec, where)
        for key in range(model.nkey):
            if model.key(key).name == "home":
                home = {
                    model.joint(j).name: float(model.key_qpos[key, model.jnt_qposadr[j]])
                    for j in range(model.njnt)
                }
        for spec_key in list(spec.keys):
            spec.delete(spec_key)
    return home


def robots_inside(spec: mujoco.MjSpec, task: TaskFile) -> tuple[TaskFile, dict[str, Mounted]]:
    """A cell file that holds its robot: of the bodies with actuated joints that with a site `tool`; doors have none.

    Parallel robots, whose drives hang on ball joints, are none of these: they are mechanisms.

    Raises:
        ModelError: several robots.
    """
    import mujoco

    moving = {a.target for a in spec.actuators if a.trntype == mujoco.mjtTrn.mjTRN_JOINT}
    driven = [
        root for root in spec.worldbody.bodies if moving & {joint.name for joint in root.find_all("joint")}
    ]
    sites = [[site.name.rsplit("/", 1)[-1] for site in root.find_all("site")] for root in driven]
    named = [root for root, inside in zip(driven, sites, strict=True) if "tool" in inside]
    if len(named) > 1:
        raise ModelError(
            f"the cell holds {len(named)} robots: {', '.join(root.name for root in named)}",
            where=task.path,
            remedy="leave one, or give each a file of its own and put them together in a task file",
        )
    serial = [root for root in driven if _has_serial_drive(root, moving)]
    with_sites = [root for root, inside in zip(driven, sites, strict=True) if inside and root in serial]
    found = named or with_sites or serial
    if not found:
        return task, {}
    root = found[0]
    return replace(task, robots=(RobotEntry(root.name, ""),)), {root.name: Mounted((root,))}


def _has_serial_drive(root: mujoco.MjsBody, driven: Collection[str]) -> bool:
    """Whether a driven joint of a body, or below it, hangs on hinges and slides alone."""
    import mujoco

    single = (mujoco.mjtJoint.mjJNT_HINGE, mujoco.mjtJoint.mjJNT_SLIDE)
    joints = list(root.joints)
    if any(joint.type not in single for joint in joints):
        return False
    return any(joint.name in driven for joint in joints) or any(
        _has_serial_drive(body, driven) for body in root.bodies
    )


def add_grasp_welds(
    spec: mujoco.MjSpec, task: TaskFile, robots: Mapping[str, Mounted], objects: Mapping[str, mujoco.MjsBody]
) -> None:
    """A weld, inactive at first, between every hand and every free object: what a grasp switches on."""
    import mujoco

    for name, robot in robots.items():
        for thing in task.objects:
            if robot.hand is None or thing.fixed:
                continue
            weld = spec.add_equality(
                name=GRASP.format(robot=name, object=thing.name),
                type=mujoco.mjtEq.mjEQ_WELD,
                objtype=mujoco.mjtObj.mjOBJ_BODY,
                name1=robot.hand.name,
                name2=objects[thing.name].name,
            )
            weld.active = False


def scene_robot(
    model: mujoco.MjModel, entry: RobotEntry, mine: Members, home: Mapping[str, float], task: TaskFile
) -> SceneRobot:
    """Where a robot of the task lives in the compiled model; `home` by joint name, from its keyframe."""
    prefix = f"{entry.name}/" if entry.model else ""
    found = compiled_robot(
        model, bodies=mine.own, prefix=prefix, name=entry.name, tool=entry.tool, where=task.path
    )
    folder = task.path.parent
    robot, joints = found.robot, found.joints
    values = [home.get(joint, robot.home[k]) for k, joint in enumerate(robot.joint_names)]
    robot = replace(robot, home=np.array(values))
    start = robot.home
    if entry.start is not None:
        where = f"{task.path}: robot {entry.name!r} start"
        start = robot.configuration(np.array(entry.start), where=where)
        robot.check_limits(start, where=where)
    base, *carried = bodies_of_links(model, joints, mine.own | mine.guests)
    links = (tuple(body for body in base if body in mine.own), *carried)
    guests = mine.guests.intersection(body for link in carried for body in link)
    variables = [joints[k] for k in found.variables]
    if robot.coupling is not None:
        harden(model, joints)
    loops = find_loops(model, mine.own, joints)
    links = tuple(tuple(body for body in link if body not in loops.bodies) for link in links)
    resting = [j for body in mine.own for j in joints_of(model, body) if j not in (*joints, *loops.joints)]
    return SceneRobot(
        name=entry.name,
        prefix=prefix,
        robot=robot,
        body_ids=mine.own | guests,
        link_body_ids=links,
        qpos_addresses=np.array([model.jnt_qposadr[j] for j in variables]),
        dof_addresses=np.array([model.jnt_dofadr[j] for j in variables]),
        actuator_ids=np.array([actuator_of_joint(model, j) for j in variables]),
        gripper=_gripper_actuator(model, mine.own, joints),
        start=start,
        fingers=_settled_inside(model, loops, _fingers(model, resting, prefix, home)),
        base_body=found.base,
        source=find_asset("robots", entry.model, relative_to=folder) if entry.model else task.path,
        site_ids=found.sites,
        guest_ids=guests,
        joint_qpos_addresses=np.array([model.jnt_qposadr[j] for j in joints]),
        joint_dof_addresses=np.array([model.jnt_dofadr[j] for j in joints]),
        riders=_riders(model, guests),
        loops=loops,
    )


def _fingers(
    model: mujoco.MjModel, joints: Iterable[int], prefix: str, home: Mapping[str, float]
) -> tuple[tuple[int, float], ...]:
    """(address in qpos, home value) of the hinges and slides among some joints; without a keyframe those of `qpos0`."""
    import mujoco

    values: dict[int, float] = {}
    for joint in sorted(joints):
        if int(model.jnt_type[joint]) in (mujoco.mjtJoint.mjJNT_HINGE, mujoco.mjtJoint.mjJNT_SLIDE):
            name = str(model.joint(joint).name).removeprefix(prefix)
            values[joint] = home.get(name, float(model.qpos0[model.jnt_qposadr[joint]]))
    return tuple((int(model.jnt_qposadr[joint]), value) for joint, value in settled(model, values).items())


def _settled_inside(
    model: mujoco.MjModel, loops: Loops, fingers: tuple[tuple[int, float], ...]
) -> tuple[tuple[int, float], ...]:
    """Values of joints by address, those of passive ones where a gripper's linkages have them."""
    qpos = np.array(model.qpos0)
    for address, value in fingers:
        qpos[address] = value
    loops.settle(qpos)
    return tuple((address, float(qpos[address])) for address, _ in fingers)


def settled_joints(model: mujoco.MjModel, robots: Iterable[SceneRobot]) -> tuple[tuple[int, float], ...]:
    """(address in qpos, value) of hinges and slides of no robot that are held, or follow, elsewhere than `qpos0`."""
    import mujoco

    mine = {int(a) for robot in robots for a in robot.joint_qpos_addresses}
    mine |= {address for robot in robots for address, _ in robot.fingers}
    mine |= {
        int(a)
        for robot in robots
        if robot.loops
        for loop in robot.loops.loops
        for a in loop.system.passive_qpos
    }
    single = (mujoco.mjtJoint.mjJNT_HINGE, mujoco.mjtJoint.mjJNT_SLIDE)
    others = [
        j for j in range(model.njnt) if model.jnt_type[j] in single and int(model.jnt_qposadr[j]) not in mine
    ]
    before = {joint: float(model.qpos0[model.jnt_qposadr[joint]]) for joint in others}
    after = settled(model, before)
    return tuple((int(model.jnt_qposadr[j]), after[j]) for j in others if after[j] != before[j])


def _riders(model: mujoco.MjModel, guests: frozenset[int]) -> tuple[tuple[int, float], ...]:
    """(address in qpos, value in `qpos0`) of all joints of some bodies."""
    sizes = {0: 7, 1: 4}  # MuJoCo's free and ball joints; hinges and slides have one value
    joints = [joint for body in sorted(guests) for joint in joints_of(model, body)]
    addresses = [
        int(model.jnt_qposadr[joint]) + k
        for joint in joints
        for k in range(sizes.get(int(model.jnt_type[joint]), 1))
    ]
    return tuple((address, float(model.qpos0[address])) for address in addresses)


def _gripper_actuator(model: mujoco.MjModel, bodies: frozenset[int], joints: tuple[int, ...]) -> str | None:
    """The name of the actuator `gripper` of some bodies that drives none of the joints."""
    driving = {actuator_of_joint(model, joint) for joint in joints}
    for actuator in actuators_of(model, bodies):
        name = str(model.actuator(actuator).name)
        if name.rsplit("/", 1)[-1] == "gripper" and actuator not in driving:
            return name
    return None


def scene_object(model: mujoco.MjModel, entry: ObjectEntry, mine: Members) -> SceneObject:
    """Where an object of the task lives in the compiled model."""
    root = mine.roots[0]
    address = None if entry.fixed else int(model.jnt_qposadr[model.body_jntadr[root]])
    return SceneObject(entry.name, root, mine.own | mine.guests, address)


def obstacles_of(
    model: mujoco.MjModel, robots: dict[str, SceneRobot], objects: dict[str, SceneObject]
) -> tuple[str, ...]:
    """Names of the fixed bodies with collision geometry that belong to no robot and no object."""
    taken = {b for r in robots.values() for b in r.body_ids} | {
        b for o in objects.values() for b in o.body_ids
    }
    names = []
    for body in range(model.nbody):
        first, count = int(model.body_geomadr[body]), int(model.body_geomnum[body])
        solid = any(model.geom_contype[g] or model.geom_conaffinity[g] for g in range(first, first + count))
        if body not in taken and solid:
            names.append(str(model.body(body).name))
    return tuple(names)
