"""What is around the arms: robots joined, spheres side by side, obstacles that stand and obstacles that move."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from workcell.errors import InputError, UnknownNameError
from workcell.geometry.covers.outer import merge_covers
from workcell.geometry.pieces import pieces_of_bodies
from workcell.geometry.types import Piece, SphereCover
from workcell.model.joined import columns, joined_robot
from workcell.model.labels import body_name
from workcell.model.robot import Robot
from workcell.pose import Array, Pose
from workcell.world.planning_world import PlanningWorld

Index = NDArray[np.int64]


@dataclass(frozen=True, slots=True)
class Arms:
    """One or several robots of a scene as one.

    Attributes:
        worlds: what each robot's planner sees.
        robot: all of them as one tree, or the only one itself.
        tools: name of each robot's tool in `robot`.
        slices: where each robot's joints stand.
        first_link: number in `robot` before each robot's link 1.
        cover: all spheres, on the links of `robot`; owner: (s,) whose they are.
    """

    worlds: tuple[PlanningWorld, ...]
    robot: Robot
    tools: tuple[str, ...]
    slices: tuple[slice, ...]
    first_link: tuple[int, ...]
    cover: SphereCover
    owner: Index

    @staticmethod
    def of(worlds: Sequence[PlanningWorld]) -> Arms:
        """Raises InputError: no world, one robot twice, or worlds of different scenes."""
        if not worlds:
            raise InputError("there is no robot to move", where="worlds", remedy="one PlanningWorld or more")
        names = [world.robot.name for world in worlds]
        if len(set(names)) < len(names):
            raise InputError(f"a robot is there twice: {', '.join(names)}", where="worlds")
        if any(world.scene.model is not worlds[0].scene.model for world in worlds):
            raise InputError("the robots are of different scenes", where="worlds")
        for world in worlds:
            if world.robot.has_moving_base(world.scene.model):
                raise InputError(
                    f"{world.robot.name} stands on what moves",
                    where="worlds",
                    remedy="a robot on a fixed base",
                )
        owner = np.repeat(np.arange(len(worlds)), [len(world.cover) for world in worlds])
        if len(worlds) == 1:
            robot = worlds[0].robot.robot
            tool = robot.tool().name
            return Arms(tuple(worlds), robot, (tool,), (slice(0, robot.dof),), (0,), worlds[0].cover, owner)
        actors = [world.robot for world in worlds]
        robot = joined_robot(actors)
        ends = np.cumsum([0, *(actor.robot.joint_count for actor in actors)])
        covers = [_moved(w, int(first)) for w, first in zip(worlds, ends[:-1], strict=True)]
        tools = tuple(f"{actor.name}/{actor.robot.tool().name}" for actor in actors)
        return Arms(
            tuple(worlds),
            robot,
            tools,
            tuple(columns(actors)),
            tuple(int(first) for first in ends[:-1]),
            merge_covers(*covers),
            owner,
        )

    @property
    def names(self) -> tuple[str, ...]:
        """The robots' names."""
        return tuple(world.robot.name for world in self.worlds)

    def pairs(self, start: Array, margin: float) -> Index:
        """(p, 2) spheres that must keep clear of each other: each robot's own, and those of two robots.

        Pairs of one robot that touch at `start` (n,), where it is known to be free, are left out, and so are those that
        always touch: they are the covers' overshoot. Pairs that are apart there, but not by the margin, would never be.
        """
        found, first = [np.zeros((0, 2), dtype=np.int64)], 0
        for world, part in zip(self.worlds, self.slices, strict=True):
            free = start[part] if world.clearance(start[part]).distance > 0 else None
            own = world.self_pairs(world.cover, free)
            found.append(np.asarray(own, dtype=np.int64).reshape(-1, 2) + first)
            first += len(world.cover)
        for a in range(len(self.worlds)):
            for b in range(a):
                one, other = np.flatnonzero(self.owner == b), np.flatnonzero(self.owner == a)
                grid = np.stack(np.meshgrid(one, other, indexing="ij"), axis=-1).reshape(-1, 2)
                found.append(grid[np.any(self.cover.link[grid] > 0, axis=1)])
        listed = np.concatenate(found)
        centre, radius = self.cover.centres_world(self.robot.link_transforms(start)), self.cover.radius
        apart = np.linalg.norm(centre[listed[:, 0]] - centre[listed[:, 1]], axis=1)
        gap = apart - radius[listed].sum(axis=1)
        kept: Index = listed[(gap > margin) | (gap <= 0.0)]
        return kept


def _moved(world: PlanningWorld, first: int) -> SphereCover:
    """A robot's cover on the links of the joined one, whose base is the world."""
    cover, base = world.cover, world.robot.robot.T_world_base
    on_base = cover.link == 0
    centre = np.where(on_base[:, None], base.apply(cover.centre), cover.centre)
    link = np.where(on_base, 0, cover.link + first)
    return SphereCover(link, centre, cover.radius, cover.kind, cover.overshoot, cover.source)


@dataclass(frozen=True, slots=True)
class Obstacles:
    """Everything that the arms may hit.

    Attributes:
        standing: pieces in the world frame, the robots' bases among them.
        bases: of each, the robot whose base it is part of, by number; -1: of none.
        moving: pieces of what moves, in the world frame as the scene begins, by mover.
        bodies: id of each mover's root body.
    """

    standing: tuple[Piece, ...]
    bases: tuple[int, ...]
    moving: dict[str, tuple[Piece, ...]]
    bodies: dict[str, int]

    @staticmethod
    def of(arms: Arms, moving: Sequence[str]) -> Obstacles:
        """Raises UnknownNameError: a mover that is neither an object nor a body; InputError: one that an arm holds."""
        scene = arms.worlds[0].scene
        model = scene.model
        own = frozenset[int]().union(*(world.robot.body_ids for world in arms.worlds))
        held = {world.attached[0] for world in arms.worlds if world.attached is not None}
        own |= frozenset[int]().union(*(scene.object(name).body_ids for name in held))
        pieces: dict[tuple[int, str], Piece] = {}
        for world in arms.worlds:
            for piece in world.obstacles:
                if piece.geom < 0 or int(model.geom_bodyid[piece.geom]) not in own:
                    pieces.setdefault((piece.geom, piece.name + repr(piece.pose.position.tolist())), piece)
        roots = {name: _root(arms, name) for name in moving}
        groups = {name: _subtree(model, root) for name, root in roots.items()}
        for name, group in groups.items():
            if group & own:
                raise InputError(f"{name} is part of a robot, or in its hand", where="moving")
        listed = list(pieces.values())
        parts = {
            name: tuple(p for p in listed if p.geom >= 0 and int(model.geom_bodyid[p.geom]) in group)
            for name, group in groups.items()
        }
        gone = {id(piece) for part in parts.values() for piece in part}
        standing = [p for p in listed if id(p) not in gone]
        bases = [-1] * len(standing)
        for arm, world in enumerate(arms.worlds):
            base = pieces_of_bodies(model, world.robot.link_body_ids[0], scene.initial_qpos())
            standing += base
            bases += [arm] * len(base)
        return Obstacles(tuple(standing), tuple(bases), parts, roots)

    def ignored(self, arms: Arms) -> NDArray[np.bool_]:
        """(s, k) spheres and standing pieces that may touch: a base, and links that the model lets touch it."""
        found = np.zeros((len(arms.cover), len(self.standing)), dtype=np.bool_)
        for arm, (world, first) in enumerate(zip(arms.worlds, arms.first_link, strict=True)):
            geoms, links = world.collision.pair_geoms, world.collision.pair_links
            mine = arms.owner == arm
            for k in np.flatnonzero(np.array(self.bases) == arm):
                asked = links[(geoms == self.standing[k].geom).any(axis=1)].max(axis=1, initial=0)
                listed = np.isin(arms.cover.link - first, asked[asked > 0])
                found[:, k] = mine & ~listed
        return found


def _root(arms: Arms, name: str) -> int:
    scene = arms.worlds[0].scene
    if name in scene.objects:
        return int(scene.object(name).body_id)
    known = {body_name(scene.model, body): body for body in range(1, scene.model.nbody)}
    if name not in known:
        raise UnknownNameError("object or body", name, [*scene.objects, *known], where="moving")
    return known[name]


def _subtree(model: object, root: int) -> frozenset[int]:
    parents = model.body_parentid  # type: ignore[attr-defined]
    found = {root}
    for body in range(root + 1, len(parents)):
        if int(parents[body]) in found:
            found.add(body)
    return frozenset(found)


@dataclass(slots=True)
class Mover:
    """An obstacle that moves.

    Attributes:
        rows: which rows of the packed movers are its pieces.
        local: (r, 12) rotation (9) and position of each row in the frame of its root body.
        pose: where that body is; told: where it was last said to be, None: not yet.
        ahead: seconds that it has moved on since, which are not in the rows yet.
    """

    rows: slice
    local: Array
    pose: Pose
    told: Pose | None = None
    ahead: float = 0.0
