"""`SceneLog`: the scene in a recording, what stands still and the poses of what moves; `Recording` builds on it."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from importlib.metadata import PackageNotFoundError, version
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import ArrayLike

from workcell.errors import InputError
from workcell.files import to_json
from workcell.geometry.types import FreeSpace, Piece, SphereCover
from workcell.model.robot import Robot
from workcell.model.scene import Scene
from workcell.model.scene_mechanism import SceneMechanism
from workcell.model.scene_parts import Goal, SceneRobot
from workcell.pose import Array, Pose
from workcell.record.shapes import OBSTACLE_SPHERE_RGBA, ROBOT_SPHERE_RGBA, piece_shape
from workcell.record.write import scenery
from workcell.record.write.blueprint import make_blueprint
from workcell.record.write.cuboid_use import CuboidUse
from workcell.record.write.free_solids import FreeSolids
from workcell.record.write.mechanism_tracks import PLANS, below, described, frame_tracks, link_spheres
from workcell.record.write.rrd import RrdWriter, entity
from workcell.record.write.tracks import BodyPoses, Track

if TYPE_CHECKING:
    import mujoco

    from workcell.world.planning_world import PlanningWorld

FORMAT = 3
"""Version of the layout, stored in the manifest.

The first had no seals (see `seal.py`). The second did not say who planned (the manifest's `planner`, and in documents
of queries what was asked of continuity), and called cuboids in use in which links were by geometry alone.
"""

JOINT_POSITIONS, CLOSURE_ERROR = "joint_positions", "closure_error"

_PLAN_RGBA = (0.15, 0.45, 0.95, 1.0)
_TRACE_RGBA = (0.95, 0.55, 0.05, 1.0)
_NEAREST_RGBA = (0.90, 0.10, 0.15, 1.0)
_BLAME_RGBA = (0.90, 0.10, 0.10, 0.55)
_CLOSEST_RGBA = (0.95, 0.60, 0.10, 0.35)


class SceneLog:
    """Writes a scene's geometry once, and where its bodies are at given times.

    Args:
        path: the file to write.
        task, seed, planner: of the run, for the manifest.
    """

    def __init__(self, path: Path, task: str, seed: int, planner: str | None) -> None:
        self._writer = RrdWriter(path)
        self._manifest: dict[str, Any] = {
            "format": FORMAT,
            "workcell": _version(),
            "task": task,
            "seed": seed,
        }
        if planner is not None:
            self._manifest["planner"] = planner
        self._writer.log_document("manifest", to_json(self._manifest))
        self._tracks: dict[str, Track] = {}
        self._carriers: dict[int, str] = {}
        self._robots: dict[str, SceneRobot] = {}
        self._mechanism: SceneMechanism | None = None
        self._traces: dict[str, str] = {}
        self._poses: BodyPoses | None = None
        self._timestep = 0.002
        self._trace_ends: dict[str, Array] = {}
        self._covered: set[str] = set()
        self._solids = FreeSolids(self._writer)
        self._cuboids = CuboidUse(self._writer, self._solids)
        self._here: tuple[Array, Array] | None = None

    def flush(self) -> None:
        """Writes what has been logged so far."""
        self._writer.flush()

    def log_scene(self, scene: Scene) -> None:
        """The scene's geometry, its goals, and where everything is at the start."""
        owners = scenery.owners_of_bodies(scene)
        self.log_model(scene.model, owners, scene.initial_qpos())
        for robot in scene.robots.values():
            self._add_robot(robot, scene.initial_qpos())
        if scene.mechanism is not None:
            self._add_mechanism(scene.mechanism)
        for goal in scene.goals.values():
            self.log_goal(goal)
        self._manifest["robots"] = {name: _describe(robot) for name, robot in scene.robots.items()}
        if scene.mechanism is not None:
            self._manifest["robots"][scene.mechanism.name] = described(scene.mechanism)
        self._manifest |= {
            "objects": list(scene.objects),
            "obstacles": list(scene.obstacles),
            "goals": list(scene.goals),
        }
        self._writer.log_document("manifest", to_json(self._manifest))
        moving = [] if scene.mechanism is None else [scene.mechanism.name]
        names = [entity(name) for name in (*scene.robots, *moving)], [entity(name) for name in scene.objects]
        metrics = ["clearance", "tracking_error", *(f"{JOINT_POSITIONS}/{name}" for name in names[0])]
        if moving:
            metrics.insert(2, CLOSURE_ERROR)
        traces = list(self._traces.values())
        self._writer.send_blueprint(make_blueprint(*names, metrics, scenery.eye(scene), traces))
        self._send_frames(np.zeros(1), scene.initial_qpos()[None])
        self.flush()

    def log_model(self, model: mujoco.MjModel, owners: Mapping[int, str], qpos: ArrayLike) -> None:
        """Geometry of a compiled model: `owners` maps body ids to `robots/<name>` or `objects/<name>`; the rest are
        obstacles. Bodies that can't move get their pose at `qpos` (nq,) once; the others follow `log_states`."""
        self._poses = BodyPoses(model)
        self._timestep = float(model.opt.timestep)
        self._writer.log("world", *scenery.world_axes())
        self._writer.log_line_style("world/nearest", _NEAREST_RGBA, 0.0015)
        for layer in scenery.layers(model, owners):
            for shape in layer.shapes:
                self._writer.log_shape(f"{layer.path}/{entity(shape.name)}", shape, layer.carrier)
            if layer.carrier is not None:
                continue
            self._carriers[layer.body] = layer.path
            if layer.moves:
                self._tracks[layer.path] = Track(layer.path, layer.body, Pose.identity())
            else:
                self._writer.log_pose(layer.path, self._poses.pose(layer.body, np.asarray(qpos, dtype=float)))
        self._writer.log_document("manifest", to_json(self._manifest))

    def _add_robot(self, robot: SceneRobot, qpos: Array) -> None:
        """The tool's frame and trace, and the names of the joints' curves."""
        base = f"world/robots/{entity(robot.name)}"
        tool = robot.robot.tool()
        body = robot.link_body_ids[tool.link][0]
        self._robots[robot.name] = robot
        self._tracks[f"{base}/tool"] = self._link_track(
            f"{base}/tool", robot, tool.link, body, qpos, tool.T_link_tool
        )
        self._writer.log_axes(f"{base}/tool", 0.08)
        self._writer.log_line_style(f"{base}/trace", _TRACE_RGBA, 0.003)
        self._traces[f"{base}/tool"] = f"{base}/trace"
        self._writer.name_series(f"metrics/{JOINT_POSITIONS}/{entity(robot.name)}", robot.robot.joint_names)

    def _add_mechanism(self, moving: SceneMechanism) -> None:
        """The frames that are watched, their traces, and the names of the motors' curves."""
        self._mechanism = moving
        for track, trace in frame_tracks(moving):
            self._tracks[track.path] = track
            self._traces[track.path] = trace
            self._writer.log_axes(track.path, 0.02 if len(moving.frames) > 1 else 0.08)
            self._writer.log_line_style(trace, _TRACE_RGBA, 0.001 if len(moving.frames) > 1 else 0.003)
        self._writer.name_series(f"metrics/{JOINT_POSITIONS}/{entity(moving.name)}", moving.motor_names)

    def log_mechanism_cover(self, cover: SphereCover) -> None:
        """The spheres of the scene's mechanism, link by link; spheres in link frames. A first cover stays."""
        self._scene_logged("log_mechanism_cover")
        if self._mechanism is None or self._mechanism.name in self._covered:
            return
        for path, centres, radii, carrier in link_spheres(self._mechanism, cover, self._carriers):
            self._writer.log_spheres(path, centres, radii, ROBOT_SPHERE_RGBA, carrier)
        self._covered.add(self._mechanism.name)
        self.flush()

    def log_frame_plan(self, frame: str, positions: ArrayLike) -> None:
        """The planned way of a frame of the scene's mechanism: world positions (k, 3)."""
        if self._mechanism is not None:
            points = np.asarray(positions, dtype=float).reshape(-1, 3)
            width = 0.001 if len(self._mechanism.frames) > 1 else 0.0025
            self._writer.log_strip(below(self._mechanism, PLANS, frame), points, _PLAN_RGBA, width)
            self.flush()

    def _link_track(
        self, path: str, robot: SceneRobot, link: int, body: int, qpos: Array, offset: Pose
    ) -> Track:
        """A frame fixed to a link, expressed in a body that the link carries."""
        assert self._poses is not None
        here = robot.standing(self._poses.model, qpos).robot
        T_world_link = Pose.from_matrix(here.link_transforms(qpos[robot.qpos_addresses])[link])
        return Track(path, body, self._poses.pose(body, qpos).inverse() @ T_world_link @ offset)

    def _rigid(self, robot: SceneRobot, link: int) -> list[int]:
        """The bodies that are fixed to a link, not those that joints of a hand move on it."""
        assert self._poses is not None
        weld, bodies = self._poses.model.body_weldid, robot.link_body_ids[link]
        return [body for body in bodies if weld[body] == weld[bodies[0]]]

    def log_cover(self, robot: SceneRobot, cover: SphereCover, qpos: ArrayLike | None = None) -> None:
        """The robot's spheres, link by link. A second cover of the same links takes the place of the first.

        Args:
            robot: whose links the cover counts.
            cover: spheres in link frames.
            qpos: (nq,) any raw positions of the scene; the model's own by default.
        """
        self._scene_logged("log_cover")
        assert self._poses is not None
        reference = self._poses.qpos0 if qpos is None else np.asarray(qpos, dtype=float)
        for link in np.unique(cover.link):
            body = next((b for b in self._rigid(robot, int(link)) if b in self._carriers), None)
            if body is None:
                continue  # a link without anything to see has nothing to cover
            T_body_link = self._link_track(
                "", robot, int(link), body, reference, Pose.identity()
            ).T_body_entity
            path = f"world/robots/{entity(robot.name)}/spheres/{entity(robot.robot.link_names[link])}"
            mine = cover.link == link
            centres = T_body_link.apply(cover.centre[mine])
            self._writer.log_spheres(
                path, centres, cover.radius[mine], ROBOT_SPHERE_RGBA, self._carriers[body]
            )
        self._covered.add(robot.name)
        self.flush()

    def log_free_space(self, free_space: FreeSpace) -> None:
        """The cuboids, each with its number, and then the polytopes.

        Another free space adds to the first: its cuboids get the numbers that follow, those already there keep theirs.
        """
        before = len(self._solids)
        self._solids.add(free_space)
        if len(self._solids) > before:
            self.flush()

    def log_world(self, world: PlanningWorld) -> None:
        """What a planner sees of a scene that is in the recording, as far as it is not there yet.

        That is the cuboids that are not there yet, and the spheres of a robot that has none yet. The cuboids
        are free of that world's obstacles; what moves may enter them in another.
        """
        self.log_free_space(world.free_space)
        if world.robot.name not in self._covered:
            self.log_cover(world.robot, world.cover, world.scene.initial_qpos())

    def log_obstacle_cover(self, cover: SphereCover) -> None:
        """Spheres of obstacles, in the world frame."""
        self._writer.log_spheres(
            "world/obstacle_spheres/all", cover.centre, cover.radius, OBSTACLE_SPHERE_RGBA, "world"
        )
        self.flush()

    def log_blame(
        self, pieces: Sequence[Piece], robot: Robot, cover: SphereCover, closest: Array | None
    ) -> None:
        """Why a query has no solution: the obstacles in the way, and the robot as near to the target as it gets.

        Args:
            pieces: the obstacles, in the world frame.
            robot, cover: who asked; spheres in link frames.
            closest: (n,) the configuration nearest to the target; None: unknown.
        """
        for piece in pieces:
            shape = piece_shape(piece, np.array(_BLAME_RGBA), grown=0.002)
            self._writer.log_shape(f"world/why/{entity('blocked_by', piece.name)}", shape)
        if closest is not None:
            moving = cover.link > 0
            centres = cover.centres_world(robot.link_transforms(closest))[moving]
            path = f"world/why/{entity('closest', robot.name)}"
            self._writer.log_spheres(path, centres, cover.radius[moving], _CLOSEST_RGBA, "world")
        self.flush()

    def log_goal(self, goal: Goal) -> None:
        """A named goal: axes and a label."""
        self._writer.log_frame(f"world/goals/{entity(goal.name)}", goal.pose, 0.10, goal.name)

    def log_plan(self, robot_name: str, tool_positions: ArrayLike) -> None:
        """The planned way of a robot's tool: world positions (k, 3)."""
        points = np.asarray(tool_positions, dtype=float).reshape(-1, 3)
        self._writer.log_strip(f"world/robots/{entity(robot_name)}/plan", points, _PLAN_RGBA, 0.0025)
        self.flush()

    # ---- rows --------------------------------------------------------------------------------------------------

    def _step(self, time: ArrayLike) -> Any:
        step = np.round(np.asarray(time, dtype=float) / self._timestep).astype(np.int64)
        return step if step.ndim else int(step)

    def _send_frames(self, times: Array, qpos: Array) -> None:
        assert self._poses is not None
        indexes = (times, self._step(times))
        positions, quats = self._poses(qpos)
        for path, track in self._tracks.items():
            where, turned = track.poses(positions, quats)
            self._writer.send_poses(path, indexes, where, turned)
            if path in self._traces:
                self._send_trace(self._traces[path], indexes, where)
        for name, robot in self._robots.items():
            self._send_metric(f"{JOINT_POSITIONS}/{entity(name)}", times, qpos[:, robot.qpos_addresses])
        if self._mechanism is not None:
            values = qpos[:, self._mechanism.motor_addresses]
            self._send_metric(f"{JOINT_POSITIONS}/{entity(self._mechanism.name)}", times, values)
        self._here = times[-1:], qpos[-1:]
        self._cuboids.send(indexes, qpos)

    def _locate(self) -> None:
        """Write which cuboids decided where the robots are: queries answered since they came there may tell."""
        if self._here is not None:
            times, qpos = self._here
            self._cuboids.send((times, self._step(times)), qpos)

    def _robot_of(self, robot: Robot) -> SceneRobot | None:
        """The robot of the scene that a query was about: of those with the same joints, the one that stands there."""
        alike = [own for own in self._robots.values() if own.robot.joint_names == robot.joint_names]
        base = robot.T_world_base.matrix
        return min(
            alike, key=lambda own: float(np.abs(own.robot.T_world_base.matrix - base).max()), default=None
        )

    def _send_trace(self, path: str, indexes: tuple[Array, Any], where: Array) -> None:
        """The stretch of the tool's way in each frame, joined to the frame before."""
        before = self._trace_ends.get(path, where[0])
        self._writer.send_segments(path, indexes, np.concatenate([before[None], where[:-1]]), where)
        self._trace_ends[path] = where[-1]

    def _send_metric(self, name: str, times: Array, values: Array) -> None:
        column = values[:, 0] if values.shape[1] == 1 else values
        self._writer.send_scalars(f"metrics/{name}", (times, self._step(times)), column)

    def _scene_logged(self, method: str) -> None:
        if self._poses is None:
            raise InputError(
                f"{method} needs the scene first", where="Recording", remedy="call log_scene or log_model"
            )


def _version() -> str:
    try:
        return version("workcell")
    except PackageNotFoundError:
        return "unknown"


def _describe(robot: SceneRobot) -> dict[str, Any]:
    """What a review says about a robot."""
    chain = robot.robot
    return {
        "joints": chain.joint_names,
        "lower": chain.lower,
        "upper": chain.upper,
        "velocity": chain.velocity,
        "tool": chain.default_tool,
    }
