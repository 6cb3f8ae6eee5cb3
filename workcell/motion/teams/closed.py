"""A team's path as steps of the one closed chain that arms and object are: every hand welded to what it holds.

Section VIII of IKSPARK for a closed chain (Remark 1): the object's pose is the goal, every joint and every link, the
object's among them, is bound to the step before, and all arms answer one question together, apart from each other.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from itertools import product

import numpy as np

from workcell.errors import InputError
from workcell.ik.mechanisms.goals import FrameGoal
from workcell.ik.mechanisms.problem import MechanismProblem
from workcell.model.labels import geom_name, geoms_called
from workcell.model.mechanism.walking import joint_label
from workcell.model.scene import Scene
from workcell.motion.mechanisms.follow import FrameWaypoint, MechanismSteps, follow_mechanism
from workcell.motion.mechanisms.planners import mechanism_solver
from workcell.motion.teams.team import Team
from workcell.motion.tool_paths.planners import OWN_STEP_BUDGET
from workcell.motion.tool_paths.result import Answered, FollowLimits
from workcell.pose import Array, Pose
from workcell.world.mechanism_world import Held, MechanismWorld

_ANYWHERE = 10.0
"""Metres and radians: the object's own joint is bound by its goal, not by a step."""


@dataclass(frozen=True, slots=True)
class ClosedWay:
    """What became of an object's way.

    Attributes:
        configurations: (k, n) of the joined robot; None: it ended early.
        failure: where and why, in words.
        answered: who answered its configurations.
    """

    configurations: Array | None
    failure: str
    answered: Answered


def follow_closed(
    team: Team,
    object_poses: Sequence[Pose],
    starts: Mapping[str, Array],
    *,
    limits: FollowLimits,
    solver: str = "ikspark",
    seed: int = 0,
) -> ClosedWay:
    """Bring the object along its poses with all arms at once.

    Where a tool strays from its place on the object between two steps, or a step can't be made, the object stops
    half-way.

    Args:
        team: the arms and their grasps.
        object_poses: `T_world_object`, the first being where the object is at `starts`.
        starts: (n,) of each arm, by name.
        limits: of the motion.
        solver: a planner that knows mechanisms.
        seed: same seed, same way.
    """
    chain = _Chain(team, limits, seed)
    steps = MechanismSteps(chain.largest_steps(), limits.max_link_rotation, limits.max_halvings)
    answer = mechanism_solver(solver, OWN_STEP_BUDGET, seed)
    poses = list(object_poses)
    for _ in range(limits.max_halvings + 1):
        waypoints = [chain.waypoint(pose) for pose in poses[1:]]
        way = follow_mechanism(chain.problem, waypoints, chain.at(starts, poses[0]), answer, steps=steps)
        answered = Answered(dict(way.by))
        if way.path is None or way.failure:
            return ClosedWay(None, way.failure or "its first step can't be made", answered)
        configurations, poses = chain.joined(way.path.configurations), chain.poses(way.path.configurations)
        strays = _strays(team, configurations, poses, limits)
        if not strays.any():
            return ClosedWay(configurations, "", answered)
        poses = _halved(poses, strays)
    return ClosedWay(None, "between its steps a tool strays however close they are", answered)


class _Chain:
    """Arms and object as one mechanism."""

    def __init__(self, team: Team, limits: FollowLimits, seed: int) -> None:
        scene, model = team.scene, team.scene.model
        self._team, thing = team, scene.object(team.thing)
        self._body = str(model.body(thing.body_id).name)
        joints = {
            name: [_joint_at(scene, int(address)) for address in scene.robot(name).joint_qpos_addresses]
            for name in team.grasps
        }
        held = []
        for name, grasp in team.grasps.items():
            robot = scene.robot(name)
            site = model.site(robot.site_ids[robot.robot.tool().name]).name
            held.append(Held(self._body, str(site), grasp.inverse()))
        world = MechanismWorld.of(
            model,
            qpos=scene.initial_qpos(),
            moving=[joint for names in joints.values() for joint in names],
            held=held,
            touching=_touching(scene, team),
            seed=seed,
        )
        self.mechanism = world.mechanism
        self.problem: MechanismProblem = world.problem(margin=limits.clearance)
        self._limits = limits
        self._values = {
            name: [self.mechanism.value_slices[self.mechanism.joint(joint)].start for joint in names]
            for name, names in joints.items()
        }
        (free,) = [k for k, joint in enumerate(self.mechanism.joints) if joint.kind == "free"]
        self._free = self.mechanism.value_slices[free]
        self._T_link_body = self.mechanism.frame(self._body).T_link_frame

    def largest_steps(self) -> Array:
        """(dof,) of each number of the tangent: the object's are bound by its goals."""
        steps = np.full(self.mechanism.dof, _ANYWHERE)
        for joint, rate in zip(self.mechanism.joints, self.mechanism.rate_slices, strict=True):
            if joint.kind != "free":
                steps[rate] = self._limits.max_step
        return steps

    def waypoint(self, pose: Pose) -> FrameWaypoint:
        """The object at a pose."""
        return FrameWaypoint((FrameGoal.posed(self._body, pose),))

    def at(self, starts: Mapping[str, Array], pose: Pose) -> Array:
        """The configuration (size,) in which the arms stand at theirs and the object at its pose."""
        q = np.array(self.mechanism.home)
        for name, values in self._values.items():
            q[values] = self._team.scene.robot(name).robot.joint_values(starts[name])
        link = pose @ self._T_link_body.inverse()
        q[self._free] = np.concatenate([link.position, link.quat_wxyz])
        return q

    def joined(self, configurations: Array) -> Array:
        """(k, n) of the joined robot, of those (k, size) of the mechanism."""
        parts = []
        for name, values in self._values.items():
            coupling = self._team.scene.robot(name).robot.coupling
            own = configurations[:, values]
            parts.append(own if coupling is None else coupling.variables(own))
        return np.concatenate(parts, axis=1)

    def poses(self, configurations: Array) -> list[Pose]:
        """Where the object is at configurations (k, size)."""
        return [Pose(q[self._free][:3], q[self._free][3:]) @ self._T_link_body for q in configurations]


def _joint_at(scene: Scene, address: int) -> str:
    """The name of the joint whose value is at an address of qpos."""
    found = int(np.flatnonzero(np.asarray(scene.model.jnt_qposadr) == address)[0])
    return joint_label(scene.model, found)


def _touching(scene: Scene, team: Team) -> list[tuple[str, str]]:
    """Pairs of geoms that may touch: the object and the hands, and what it stands on."""
    model, body_of = scene.model, np.asarray(scene.model.geom_bodyid)
    hands = [body for name in team.grasps for body in scene.robot(name).hand_ids]
    own = np.flatnonzero(np.isin(body_of, list(scene.object(team.thing).body_ids)))
    others = [*np.flatnonzero(np.isin(body_of, hands)), *geoms_called(model, team.supports, "supports")]
    return [(geom_name(model, int(a)), geom_name(model, int(b))) for a, b in product(own, others)]


def _strays(team: Team, configurations: Array, poses: Sequence[Pose], limits: FollowLimits) -> Array:
    """(k - 1,) whether a tool is off its place on the object half-way of a step."""
    middle = 0.5 * (configurations[1:] + configurations[:-1])
    off = np.zeros(len(middle), dtype=bool)
    for name, grasp in team.grasps.items():
        for k, T in enumerate(team.tools(name, middle)):
            wanted = poses[k].interpolate(poses[k + 1], 0.5) @ grasp
            away, turned = Pose.from_matrix(T).error_to(wanted)
            off[k] |= away > limits.deviation_m or turned > limits.deviation_rad
    return off


def _halved(poses: Sequence[Pose], strays: Array) -> list[Pose]:
    """Poses with one more half-way of each step that strays."""
    if len(strays) != len(poses) - 1:
        raise InputError("as many steps as poses but one", where="strays")
    found = [poses[0]]
    for k, stray in enumerate(strays):
        found += [poses[k].interpolate(poses[k + 1], 0.5)] if stray else []
        found.append(poses[k + 1])
    return found
