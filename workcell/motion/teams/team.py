"""Several arms that hold one object: a closed chain, of which one path parameter and one timing move all joints.

What the arms may hit of each other is proved on the whole team's motion.
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from dataclasses import dataclass, replace
from itertools import product

import numpy as np

from workcell.errors import InputError
from workcell.ik.problem import Clearance
from workcell.model.collision_model import CollisionModel
from workcell.model.joined import columns, joined_robot
from workcell.model.labels import geoms_called
from workcell.model.robot import Robot
from workcell.model.scene import Scene
from workcell.motion.path import Path, Trajectory
from workcell.motion.proofs.on_model import Proof, chords, motion_bound, prove_by_halving
from workcell.pose import Array, Pose
from workcell.world.planning_world import PlanningWorld

_LOOKS = 4000
"""Collision queries of a proof before it gives up."""


@dataclass(frozen=True, slots=True)
class Team:
    """Arms of one scene that hold one object. Build one with `Team.of`.

    Attributes:
        scene: the scene, the hands closed on the object.
        thing: the object's name.
        grasps: `T_object_tool` of each arm, by the robot's name.
        worlds: what each arm's planner sees: the object in its hand, and no other arm of the team.
        robot: all arms as one kinematic tree, joints side by side in the order of `grasps`.
        supports: names of the geoms that the object may touch, such as those that it stands on.
    """

    scene: Scene
    thing: str
    grasps: Mapping[str, Pose]
    worlds: Mapping[str, PlanningWorld]
    robot: Robot
    _models: tuple[CollisionModel, ...]
    supports: tuple[str, ...] = ()

    @staticmethod
    def of(
        scene: Scene,
        thing: str,
        grasps: Mapping[str, Pose],
        *,
        overshoot: float = 0.02,
        seed: int = 0,
    ) -> Team:
        """The arms once they hold the object.

        Args:
            scene: the scene; every arm of the team begins where it holds the object, up to its own start's error.
            thing: the object's name.
            grasps: `T_object_tool` of each arm, two or more, by name.
            overshoot: of the sphere covers, metres.
            seed: of the free space's random seeds.

        Raises:
            InputError: fewer than two arms, or one that stands on another; UnknownNameError: no such robot or object.
        """
        if len(grasps) < 2:
            raise InputError(f"a team of {len(grasps)}", where="grasps", remedy="two arms or more")
        for name in grasps:
            for other in grasps:
                if scene.robot(name).guest_ids & scene.robot(other).own_ids:
                    raise InputError(
                        f"{other} stands on {name}: when one moves, so does the other",
                        where="grasps",
                        remedy="a team's arms stand apart from each other",
                    )
        worlds = {}
        for name, grasp in grasps.items():
            world = PlanningWorld.of(scene, name, overshoot=overshoot, approached=[thing], seed=seed)
            world = world.holding(thing, grasp.inverse(), towards=[scene.robot(name).start])
            scene = world.scene
            worlds[name] = world
        others = {name: [other for other in grasps if other != name] for name in grasps}
        solo = {name: replace(world.without(others[name]), scene=scene) for name, world in worlds.items()}
        joined = joined_robot([scene.robot(name) for name in grasps])
        return Team(scene, thing, dict(grasps), solo, joined, _models(solo, thing, ()))

    def touching(self, supports: Iterable[str]) -> Team:
        """The same team while the object may touch some geoms: those that it stands on, or is put down on.

        Raises:
            UnknownNameError: no geom of that name.
        """
        below = tuple(supports)
        others = {name: [other for other in self.grasps if other != name] for name in self.grasps}
        worlds = {name: w.standing_on(below).without(others[name]) for name, w in self.worlds.items()}
        return replace(self, worlds=worlds, _models=_models(worlds, self.thing, below), supports=below)

    def at(self, q: Array) -> dict[str, Array]:
        """Each robot's part (n,) of a configuration of the team."""
        return {name: np.array(q[self.columns(name)]) for name in self.grasps}

    def columns(self, robot: str) -> slice:
        """Where a robot's joints stand in the team's configurations."""
        return columns([self.scene.robot(name) for name in self.grasps])[list(self.grasps).index(robot)]

    def clearance(self, q: Array) -> Clearance:
        """Smallest signed distance of any arm, or of the object, to anything it should not touch; q (n1 + n2 + ...)."""
        first = next(iter(self.grasps))
        qpos = self._models[0].full_qpos(q[self.columns(first)])
        for name in self.grasps:
            self.scene.robot(name).place(qpos, q[self.columns(name)])
        found = min((model.distance_at(qpos) for model in self._models), key=lambda one: one.distance)
        return Clearance(found.distance, found.pair)

    def motion_bound(self, q: Array, half: Array) -> float:
        """How much distance any pair can lose while every joint stays within `half` of `q`: all arms' bounds added."""
        return sum(
            motion_bound(world.robot.robot, q[self.columns(name)], half[self.columns(name)], world.cover)
            for name, world in self.worlds.items()
        )

    def look(self, q: Array, half: Array) -> tuple[Clearance, float]:
        """What a proof asks of a configuration (`workcell.motion.proofs.on_model.Look`)."""
        found = self.clearance(q)
        return found, found.distance - self.motion_bound(q, half) - self.tolerance

    @property
    def tolerance(self) -> float:
        """Metres by which clearances may be off."""
        return max(model.tolerance for model in self._models)

    def stretch(self, configurations: Array) -> Array:
        """(k,) metres by which the closed chain would be strained at configurations (k, n).

        How far each arm's tool is from where the first arm's tool and the grasps put it; the largest of all arms.
        """
        first = next(iter(self.grasps))
        T_world_object = self.tools(first, configurations) @ self.grasps[first].inverse().matrix
        off = [
            np.linalg.norm(
                (T_world_object @ grasp.matrix - self.tools(name, configurations))[:, :3, 3], axis=1
            )
            for name, grasp in self.grasps.items()
        ]
        worst: Array = np.max(off, axis=0)
        return worst

    def tools(self, name: str, configurations: Array) -> Array:
        """(k, 4, 4) world poses of one robot's tool at configurations (k, n) of the team."""
        return self.scene.robot(name).robot.fk_transform(configurations[:, self.columns(name)])

    def split(self, trajectory: Trajectory) -> tuple[Trajectory, ...]:
        """The team's motion as one trajectory for each robot."""
        parts = []
        for name in self.grasps:
            own, base = self.columns(name), self.scene.robot(name).robot.T_world_base
            q, qd, qdd = trajectory.q[:, own], trajectory.qd[:, own], trajectory.qdd[:, own]
            parts.append(Trajectory(name, trajectory.time, q, qd, qdd, base))
        return tuple(parts)


def prove_team(team: Team, path: Path, *, floor: float = 0.0, slack: Array | float = 0.0) -> Proof:
    """Prove that a team's joint-linear path keeps its clearance above `floor` everywhere.

    It is `prove_path` for several arms. Two arms may both move towards each other: a pair loses at most what
    all arms' points move together.

    Args:
        team: the arms.
        path: of the joined robot.
        floor: clearance to keep, metres.
        slack: (k - 1, n), or what broadcasts to it: how far the motion may stray from each straight line.
    """
    edges = [float(k) for k in range(len(path))]
    return prove_by_halving(path, team.look, edges, floor=floor, slack=slack, max_evaluations=_LOOKS)


def prove_team_motion(team: Team, trajectory: Trajectory, *, floor: float = 0.0, every: int = 10) -> Proof:
    """Prove a timed motion of the joined robot, over all of time.

    See `workcell.motion.proofs.on_model.trajectory_clearance`.
    """
    q, slack = chords(trajectory, every)
    return prove_team(team, Path(team.robot, q), floor=floor, slack=slack)


def _models(
    worlds: Mapping[str, PlanningWorld], thing: str, supports: Iterable[str]
) -> tuple[CollisionModel, ...]:
    """For each arm, the distances that count: none from the hands, or what the object stands on, to the object."""
    scene = next(iter(worlds.values())).scene
    robots = [scene.robot(name) for name in worlds]
    hands = [body for robot in robots for body in sorted(robot.hand_ids)]
    below = geoms_called(scene.model, supports, "supports")
    allowed = list(product(_geoms(scene, scene.object(thing).body_ids), _geoms(scene, hands) + below))
    return tuple(
        CollisionModel(scene, name, attached=world.attached, allowed_geoms=allowed)
        for name, world in worlds.items()
    )


def _geoms(scene: Scene, bodies: Iterable[int]) -> list[int]:
    inside = set(bodies)
    return [g for g in range(scene.model.ngeom) if int(scene.model.geom_bodyid[g]) in inside]
