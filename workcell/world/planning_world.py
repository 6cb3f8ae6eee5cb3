"""`PlanningWorld`: a scene as the planners see it: sphere cover, pieces, free space, and the truth beside them."""

from __future__ import annotations

from collections.abc import Collection, Iterable, Sequence
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np
from numpy.typing import ArrayLike, NDArray

from workcell.errors import InputError, UnknownNameError
from workcell.geometry.covers.outer import attached_cover, merge_covers
from workcell.geometry.free_space.cuboids import biased_seeds
from workcell.geometry.free_space.fill import workspace_box
from workcell.geometry.free_space.pool import FreeSpacePool
from workcell.geometry.pieces import scene_obstacles
from workcell.geometry.types import FreeSpace, Piece, SphereCover, obstacle_name
from workcell.ik.problem import ITSELF, IKProblem, Tolerances
from workcell.model.collision_model import CollisionModel
from workcell.model.grip import fingers_at, fingers_holding, hand_clearance
from workcell.model.labels import geom_name, geoms_called, obstacle_label
from workcell.model.scene import Scene, robot_scene
from workcell.model.scene_parts import SceneRobot
from workcell.pose import Array, Pose
from workcell.world.fitting_cover import fitting_cover, hand_pieces, hand_places, sphere_centres
from workcell.world.hand_cover import cover_with_fingers
from workcell.world.inner_model import inner_model
from workcell.world.model_clearance import ModelClearance


@dataclass(frozen=True, slots=True)
class PlanningWorld:
    """What a planner needs to know about one robot in a scene. Build one with `PlanningWorld.of`.

    Attributes:
        scene: the compiled scene.
        robot: the planned robot in it.
        cover: outer spheres of the robot, and of what it carries, in link frames.
        obstacles: convex pieces of everything else, in the world frame.
        pool: free space, proved disjoint from every obstacle, which this world's queries share and let grow. A world
            that is made from this one begins with a copy of what is free there too.
        collision: the compiled model's distances, which alone decide.
        attached: (object, T_tool_object) that the hand carries, or None.
        overshoot: of the covers, metres.
        seed: of the free space's seeds.
    """

    scene: Scene
    robot: SceneRobot
    cover: SphereCover
    obstacles: tuple[Piece, ...]
    pool: FreeSpacePool
    collision: CollisionModel
    attached: tuple[str, Pose] | None = None
    overshoot: float = 0.02
    seed: int = 0

    @staticmethod
    def of(
        scene: Scene | str | Path,
        robot: str | None = None,
        *,
        tool: str | None = None,
        overshoot: float = 0.02,
        opening: float = 1.0,
        approached: Iterable[str] = (),
        towards: Iterable[Array] = (),
        seed: int = 0,
    ) -> PlanningWorld:
        """Cover the robot, collect the obstacles and inflate free space around where the robot will be.

        Args:
            scene: the scene; or the name or path of a robot, which then stands alone in an empty world and is looked at
                for collisions with itself; or the path of a task file.
            robot: the robot's name; None: the only one.
            tool: the site to place; None: the robot's own.
            overshoot: of the sphere cover, metres.
            opening: of the gripper: 1 is where the scene has it, 0 closed.
            approached: objects (by name) that the hand is to come closer to than its spheres allow, such as one about
                to be grasped. They are left out of the planners' obstacles; the compiled model counts them as ever.
            towards: configurations (n,) that the free space should hold, besides the start.
            seed: of the free space's random seeds.
        """
        if not isinstance(scene, Scene):
            scene = Scene.load(scene) if str(scene).endswith(".toml") else robot_scene(scene)
        actor = scene.robot(robot)
        if opening != 1.0:
            actor = replace(actor, fingers=fingers_at(scene, actor, opening))
            scene = replace(scene, robots={**scene.robots, actor.name: actor})
        if tool is not None:
            actor = replace(actor, robot=replace(actor.robot, default_tool=actor.robot.tool(tool).name))
        cover = cover_with_fingers(scene, actor, overshoot)
        obstacles = scene_obstacles(scene, actor.name, exclude_objects=tuple(approached))
        world = PlanningWorld(
            scene=scene,
            robot=actor,
            cover=cover,
            obstacles=obstacles,
            pool=FreeSpacePool(obstacles, workspace_box(actor.robot), cover.radius),
            collision=CollisionModel(scene, actor.name),
            overshoot=overshoot,
            seed=seed,
        )
        return world.with_free_space_around([actor.start, *towards])

    def holding(self, thing: str, T_tool_object: Pose, *, towards: Iterable[Array] = ()) -> PlanningWorld:
        """The world once the hand holds an object: it is part of the robot, its spheres move with the hand.

        The gripper's fingers stand closed on it from then on, in the cover and in the compiled model alike.

        Args:
            thing: the object's name.
            T_tool_object: how it stands in the tool's frame.
            towards: configurations (n,) that the free space should hold.
        """
        actor = replace(self.robot, fingers=fingers_holding(self.scene, self.robot, thing, T_tool_object))
        scene = replace(self.scene, robots={**self.scene.robots, actor.name: actor})
        carried = attached_cover(scene, actor, thing, T_tool_object, overshoot=self.overshoot)
        cover = merge_covers(cover_with_fingers(scene, actor, self.overshoot), carried)
        obstacles = scene_obstacles(scene, actor.name, exclude_objects=(thing,))
        world = replace(
            self,
            scene=scene,
            robot=actor,
            cover=cover,
            obstacles=obstacles,
            pool=self.pool.among(obstacles, cover.radius),
            attached=(thing, T_tool_object),
            collision=CollisionModel(scene, actor.name, attached=(thing, T_tool_object)),
        )
        return world.with_free_space_around(towards)

    def standing_on(self, supports: Iterable[str]) -> PlanningWorld:
        """The same world while the carried object still stands on `supports` (geoms), which it may touch."""
        if self.attached is None:
            raise InputError("the hand holds nothing", where="supports", remedy="call holding first")
        standing = geoms_called(self.scene.model, supports, "supports")
        pairs = _geom_pairs(self.scene, self.attached[0], standing)
        model = CollisionModel(self.scene, self.robot.name, attached=self.attached, allowed_geoms=pairs)
        world = self._among(piece for piece in self.obstacles if piece.geom not in standing)
        return replace(world, collision=model)

    def without(self, robots: Iterable[str]) -> PlanningWorld:
        """The same world as if some other robots were not there: for arms whose motions are proved together.

        Raises:
            UnknownNameError: no such robot; InputError: one that this one carries, which moves with it.
        """
        gone = [self.scene.robot(name) for name in robots]
        for other in gone:
            if other.own_ids & self.robot.guest_ids:
                raise InputError(
                    f"{self.robot.name} carries {other.name}", where="robots", remedy="it can't be left out"
                )
        others = frozenset[int]().union(*(other.body_ids for other in gone)) - self.robot.body_ids
        body_of = self.scene.model.geom_bodyid
        world = self._among(piece for piece in self.obstacles if int(body_of[piece.geom]) not in others)
        return replace(world, collision=self.collision.ignoring(others))

    def close_to(self, geoms: Iterable[str]) -> PlanningWorld:
        """The same world for a motion that comes closer to some geoms than the robot's spheres allow.

        They are left out of the planners' obstacles; the compiled model, which decides and proves, counts them as ever.

        Raises:
            UnknownNameError: no obstacle has that name.
        """
        model, known = self.scene.model, {piece.geom for piece in self.obstacles}
        if self.attached is not None:
            carried = self.scene.object(self.attached[0]).body_ids
            known.update(np.flatnonzero(np.isin(model.geom_bodyid, list(carried))).tolist())
        names = {geom_name(model, geom): geom for geom in sorted(known)}
        near = set()
        for name in geoms:
            if name not in names:
                raise UnknownNameError("geom", name, names, where="close_to")
            near.add(names[name])
        return self._among(piece for piece in self.obstacles if piece.geom not in near)

    def fitting(self, way: Sequence[Pose]) -> PlanningWorld:
        """The same world with finer spheres on the hand, and what it holds, where its spheres touch along tool poses.

        They share this world's free space. What touches even then, stays; the compiled model decides.
        """
        link, places = self.robot.robot.tool().link, hand_places(self.robot.robot, way)
        pieces = hand_pieces(self.scene, self.robot, self.attached)
        cover = fitting_cover(self.cover, pieces, link, places, self.obstacles)
        return self if cover is self.cover else replace(self, cover=cover)

    def _among(self, obstacles: Iterable[Piece]) -> PlanningWorld:
        """The same world among other obstacles, with what of its free space is free of them."""
        pieces = tuple(obstacles)
        return replace(self, obstacles=pieces, pool=self.pool.among(pieces))

    def relaxed(self, problem: IKProblem, names: Collection[str]) -> IKProblem:
        """A question of this world without some obstacles (`obstacle_name`), or `ITSELF`, for all who judge it."""
        model = self.scene.model
        gone = [geom for geom in range(model.ngeom) if obstacle_label(model, geom) in names]
        collision = self.collision.ignoring((), gone)
        if ITSELF in names:
            collision = collision.without_own()
        kept = tuple(piece for piece in problem.obstacles if obstacle_name(piece) not in names)
        world = replace(self, obstacles=kept, collision=collision)
        return replace(
            problem,
            obstacles=kept,
            checker=world.clearance,
            inner=world._inside,
            free_space=None,
            grow=None,
        )

    def problem(self, target: Pose, *, q_reference: Array | None = None, margin: float = 0.0) -> IKProblem:
        """The question: bring the tool to `target`, at least `margin` metres clear of everything.

        Answers are in the whole turns of joints that are nearest to where the robot starts (`IKProblem.q_near`). Its
        free space is this world's, and grows for all queries of this world.
        """
        return IKProblem(
            robot=self.robot.robot,
            target=target,
            obstacles=self.obstacles,
            cover=self.cover,
            free_space=self.free_space,
            grow=self.pool.grow,
            checker=self.clearance,
            tool_pose=self.tool_pose,
            q_reference=q_reference,
            q_near=self.robot.start,
            tolerances=Tolerances(safety_margin=margin),
            inner=self._inside,
            without=self.relaxed,
        )

    def _inside(self, problem: IKProblem) -> IKProblem:
        """The same question about spheres inside the robot among the obstacles that it really collides with."""
        model = inner_model(self.scene, self.robot, problem.obstacles, self.collision)
        return replace(
            problem,
            cover=model.cover,
            obstacles=model.obstacles,
            self_collision=model.self_pairs,
            free_space=None,
            grow=None,
            inner=None,
        )

    @property
    def clearance(self) -> ModelClearance:
        """Smallest signed distance on the compiled model: `world.clearance(q)` at `q` (n,)."""
        return ModelClearance(self.collision)

    def self_pairs(self, cover: SphereCover, known_free: ArrayLike | None = None) -> NDArray[np.int64]:
        """Spheres (p, 2) of a cover that must keep clear of each other: see `ModelClearance.self_pairs`."""
        return self.clearance.self_pairs(self.robot.robot, cover, known_free)

    def hand_clearance(self, target: Pose, ignored: Iterable[str] = ()) -> float:
        """How far the hand alone would be from all but what it holds at a tool pose, metres: cheap, before IK."""
        held = () if self.attached is None else (self.attached[0],)
        return hand_clearance(self.scene, self.robot, target, (*ignored, *held))

    def tool_pose(self, q: Array) -> Pose:
        """`T_world_tool` on the compiled model at `q` (n,)."""
        return self.collision.site_pose(self.robot.robot.default_tool, q)

    @property
    def free_space(self) -> FreeSpace:
        """What the pool holds now."""
        return self.pool.free_space

    def with_free_space_around(self, configurations: Iterable[Array]) -> PlanningWorld:
        """The same world with more free space around configurations (k, n): where the robot's spheres are, and near."""
        wanted, moving = list(configurations), self.cover.link > 0
        seeds = biased_seeds(self.robot.robot, self.cover, np.array(wanted), seed=self.seed)
        there = np.tile(self.cover.radius[moving], len(wanted))
        return self._grown(seeds[: len(there)], there)._grown(seeds[len(there) :], np.zeros_like(there))

    def with_free_space_along(self, way: Sequence[Pose]) -> PlanningWorld:
        """The same world with more free space around the hand, and what it holds, along tool poses.

        The rest of the robot, which tool poses leave a choice, gets its own when a planner asks.
        """
        hand = self.cover.link == self.robot.robot.tool().link
        centres = sphere_centres(self.cover.centre[hand], hand_places(self.robot.robot, way))
        return self._grown(centres.reshape(-1, 3), np.tile(self.cover.radius[hand], len(way)))

    def _grown(self, centres: Array, radii: Array) -> PlanningWorld:
        """The same world, whose free space holds more spheres, (k, 3) and (k,), and is its own."""
        pool = self.pool.among(self.obstacles)
        pool.grow(centres, radii)
        return replace(self, pool=pool)


def _geom_pairs(scene: Scene, thing: str, supports: Iterable[int]) -> list[tuple[int, int]]:
    """Every geom of an object with every support."""
    mine = np.isin(scene.model.geom_bodyid, list(scene.object(thing).body_ids))
    return [(int(geom), other) for geom in np.flatnonzero(mine) for other in supports]
