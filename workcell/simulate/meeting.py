"""Whether robots that move at once, or stand elsewhere than was planned for, come into each other's way.

A motion is proved clear of the other robots where they stood when it was planned. When several move at once, or one has
moved since, that proof says nothing of the two. What the simulation is ordered to do is therefore proved again between
the robots, all of them moving as they are told: the argument is that of `workcell.motion.proofs.on_model`. What is not
proved is named.
"""

from __future__ import annotations

from collections.abc import Collection, Mapping
from dataclasses import dataclass
from itertools import combinations

import numpy as np

from workcell.errors import InputError
from workcell.geometry.types import SphereCover
from workcell.model.collision_model import CollisionModel
from workcell.model.judge.nearest import Distance
from workcell.model.passive_motion import PassiveMotion
from workcell.model.scene import Scene
from workcell.model.scene_parts import SceneObject, SceneRobot, data_at
from workcell.motion.proofs.on_model import link_motion
from workcell.pose import Array, Pose

_FINEST = 1 / 64
"""Of a control step: intervals of time that are not halved further."""
_LOOKS = 20_000
"""Distances of two robots that are asked for before a proof gives up."""


@dataclass(frozen=True, slots=True)
class Mover:
    """A robot in a simulation, and what it is told.

    Attributes:
        robot: standing where the simulation has it.
        q: (T, n) where its joints should be at every control step; one row: it holds its place.
        held: the object in its hand and how it stands in the tool's frame, or None.
    """

    robot: SceneRobot
    q: Array
    held: tuple[SceneObject, Pose] | None = None

    @property
    def moves(self) -> bool:
        """Whether it is told to move at all."""
        return bool(np.any(self.q != self.q[0]))

    def bodies(self) -> frozenset[int]:
        """What it carries along: its own, its guests', those of what it holds."""
        return self.robot.body_ids if self.held is None else self.robot.body_ids | self.held[0].body_ids

    def at(self, t: float) -> Array:
        """(n,) its joints at a time in control steps; at rest after its last."""
        last = len(self.q) - 1
        k = min(int(t), last)
        here: Array = self.q[k] + (min(t, last) - k) * (self.q[min(k + 1, last)] - self.q[k])
        return here


@dataclass(frozen=True, slots=True)
class Meeting:
    """Where two robots come together: control steps from the beginning, their names, and the nearest pair there."""

    step: float
    robots: tuple[str, str]
    nearest: Distance

    def sentence(self, timestep: float) -> str:
        """In words, which name the two."""
        first, second = self.nearest.pair
        if self.nearest.distance <= 0:
            how = f"{first} is {-1e3 * self.nearest.distance:.1f} mm inside {second}"
        else:
            how = f"{first} and {second} can't be proved apart, {1e3 * self.nearest.distance:.2f} mm from each other"
        return (
            f"{self.robots[0]} and {self.robots[1]} come together after {self.step * timestep:.2f} s: {how}"
        )


def first_meeting(
    scene: Scene, movers: Mapping[str, Mover], qpos: Array, allowed: Collection[tuple[int, int]]
) -> Meeting | None:
    """The first two robots that are not proved clear of each other; None: all are, all the time.

    Args:
        scene: the scene.
        movers: every robot of it.
        qpos: (nq,) raw positions now.
        allowed: pairs of geoms (ids) that may touch.

    Raises:
        InputError: one that moves stands on another that moves: no bound of one tells where the other is.
    """
    for one, two in combinations(movers, 2):
        a, b = movers[one], movers[two]
        if not (a.moves or b.moves):
            continue
        for below, above in ((a, b), (b, a)):
            if below.robot.guest_ids & above.robot.own_ids and a.moves and b.moves:
                raise InputError(
                    f"{above.robot.name} stands on {below.robot.name}: motions of both at once can't be proved",
                    where="motion",
                    remedy="move one after the other",
                )
        if (a.robot.guest_ids & b.robot.own_ids) or (b.robot.guest_ids & a.robot.own_ids):
            continue  # each one's own plan has looked at the other
        found = _Pair(scene, a, b, qpos, allowed).first()
        if found is not None:
            return Meeting(found[0], (one, two), found[1])
    return None


class _Pair:
    """Two robots, and how near they come."""

    def __init__(
        self, scene: Scene, a: Mover, b: Mover, qpos: Array, allowed: Collection[tuple[int, int]]
    ) -> None:
        self._movers, self._qpos, self._scene = (a, b), np.array(qpos), scene
        held = None if a.held is None else (a.held[0].name, a.held[1])
        model = CollisionModel(scene, a.robot.name, qpos=qpos, attached=held, allowed_geoms=allowed)
        self._model = model.between(a.bodies(), b.bodies())
        self._extents = tuple(_extent(scene, mover, qpos) for mover in (a, b))
        self._joints = tuple(mover.robot.robot.joint_values(mover.q) for mover in (a, b))

    def first(self) -> tuple[float, Distance] | None:
        """The first time at which the two are not proved apart, and their distance then."""
        if len(self._model.pair_geoms) == 0:
            return None
        waiting, looks = [(0.0, float(max(len(mover.q) for mover in self._movers) - 1))], 0
        while waiting:
            begin, end = waiting.pop()
            middle, looks = 0.5 * (begin + end), looks + 1
            left, nearest = self._model.excess_at(self._positions(middle), self._lost(begin, end, middle))
            if left > self._model.tolerance:
                continue
            if nearest.distance <= 0 or end - begin < _FINEST or looks >= _LOOKS:
                return middle, nearest
            waiting += [(middle, end), (begin, middle)]
        return None

    def _positions(self, t: float) -> Array:
        qpos = np.array(self._qpos)
        for mover in self._movers:
            mover.robot.place(qpos, mover.at(t))
        for mover in self._movers:
            if mover.held is not None:
                thing, T_tool_object = mover.held
                thing.place(qpos, mover.robot.robot.fk(mover.at(t)) @ T_tool_object)
        return qpos

    def _lost(self, begin: float, end: float, middle: float) -> Array:
        """(p,) metres by which each pair of geoms may come closer between two times than it is in the middle."""
        model = self._scene.model
        lost = np.zeros(model.nbody)
        for mover, extent, joints in zip(self._movers, self._extents, self._joints, strict=True):
            chain = mover.robot.robot
            if not mover.moves:
                continue
            here = chain.joint_values(mover.at(middle))
            ends = chain.joint_values(np.array([mover.at(begin), mover.at(end)]))
            between = joints[int(np.ceil(begin)) : int(end) + 1]
            half = np.abs(np.vstack([ends, between]) - here).max(axis=0)
            moved = link_motion(chain.uncoupled, here, half, extent)[0]
            for link, bodies in enumerate(mover.robot.link_body_ids):
                lost[list(bodies)] += moved[link]
            lost += self._lost_by_loops(mover.robot, self._positions(middle), half)
            if mover.held is not None:
                lost[list(mover.held[0].body_ids)] = moved[chain.tool().link]
        pairs = self._model.pair_geoms
        total: Array = lost[model.geom_bodyid[pairs]].sum(axis=1)
        return total

    def _lost_by_loops(self, robot: SceneRobot, qpos: Array, widths: Array) -> Array:
        """(b,) metres by which bodies on passive loops of a robot may move; infinite where that is not known."""
        model, lost = self._scene.model, np.zeros(self._scene.model.nbody)
        if robot.loops is None or not robot.loops.loops:
            return lost
        seen = PassiveMotion(model, robot).seen(qpos, widths)
        if seen is None:
            lost[list(robot.loops.bodies)] = np.inf
            return lost
        for geom, motion in seen.items():
            body = int(model.geom_bodyid[geom])
            lost[body] = max(lost[body], float(motion[0]))
        return lost


def _extent(scene: Scene, mover: Mover, qpos: Array) -> SphereCover:
    """A sphere around every geom of a robot, and of what it holds, in the frame of the link that carries it."""
    model, robot = scene.model, mover.robot
    data = data_at(model, qpos)
    q = np.asarray(qpos)[robot.qpos_addresses]
    inverse = np.linalg.inv(robot.robot.link_transforms(q))
    owner = {body: link for link, bodies in enumerate(robot.link_body_ids) for body in bodies}
    if mover.held is not None:
        owner |= dict.fromkeys(mover.held[0].body_ids, robot.robot.tool().link)
    geoms = [g for g in range(model.ngeom) if int(model.geom_bodyid[g]) in owner and model.geom_rbound[g] > 0]
    links = np.array([owner[int(model.geom_bodyid[g])] for g in geoms], dtype=np.int64)
    centre = [T[:3, :3] @ data.geom_xpos[g] + T[:3, 3] for T, g in zip(inverse[links], geoms, strict=True)]
    return SphereCover(links, np.array(centre).reshape(-1, 3), model.geom_rbound[geoms], "outer")
