"""`Recording`: what a run writes while it happens, into one `.rrd` file that needs nothing else to be understood."""

from __future__ import annotations

import time as clock
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from importlib.metadata import PackageNotFoundError, version
from pathlib import Path
from types import TracebackType
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import ArrayLike

from workcell.errors import InputError, OutputError
from workcell.geometry.types import FreeSpace, Piece, SphereCover
from workcell.model.robot import Robot
from workcell.model.scene import Goal, Scene, SceneRobot
from workcell.pose import Array, Pose
from workcell.record import scenery
from workcell.record.blueprint import make_blueprint
from workcell.record.rrd import RrdWriter, entity, writing
from workcell.record.shapes import piece_shape, polytope_shape
from workcell.record.summary import to_json
from workcell.record.tracks import BodyPoses, Track

if TYPE_CHECKING:
    import mujoco

    from workcell.simulate.execution import Execution

FORMAT = 1
"""Version of the entity layout, stored in the manifest."""

LEVELS = ("INFO", "WARN", "ERROR")
JOINT_POSITIONS = "joint_positions"

_CHUNK_S = 0.45
_CHUNK_WALL_S = 0.8
_PLAN_RGBA = (0.15, 0.45, 0.95, 1.0)
_TRACE_RGBA = (0.95, 0.55, 0.05, 1.0)
_SPHERE_RGBA = (0.20, 0.60, 0.85, 0.35)
_NEAREST_RGBA = (0.90, 0.10, 0.15, 1.0)
_OBSTACLE_RGBA = (0.36, 0.42, 0.48, 0.25)
_BLAME_RGBA = (0.90, 0.10, 0.10, 0.55)
_CLOSEST_RGBA = (0.95, 0.60, 0.10, 0.35)
_FREE_RGBA = (0.25, 0.75, 0.35, 0.12)


@dataclass(slots=True)
class _Buffer:
    """Rows that are not in the file yet: poses at the frame rate, metrics at the rate they come in."""

    frame_times: list[float] = field(default_factory=list)
    frame_qpos: list[Array] = field(default_factory=list)
    times: list[Array] = field(default_factory=list)
    metrics: dict[str, list[tuple[Array, Array]]] = field(default_factory=dict)


class Recording:
    """An `.rrd` file being written. Use it as a context manager.

    Rows are handed to the operating system twice a simulated second, and at least about once a second of the clock, so that
    a killed process leaves a readable file.
    While it is open the file is `<name>.partial.rrd`; `close` writes the finished one to `path`. A run that ends with
    an exception keeps the partial file, with the failure as its last event: an earlier recording at `path` is intact.

    Args:
        path: where the finished recording is to lie; its folder is made.
        task: name of what is recorded.
        seed: of the run.
        frame_rate: poses and joint positions a second of simulated time. Metrics are kept at their own rate.

    Raises:
        OutputError: by every method, when the file can't be written.
    """

    def __init__(self, path: str | Path, *, task: str, seed: int = 0, frame_rate: float = 50.0) -> None:
        self.path = Path(path)
        self.partial_path = self.path.with_name(self.path.stem + ".partial.rrd")
        with writing(self.partial_path):
            self.path.parent.mkdir(parents=True, exist_ok=True)
        self._writer = RrdWriter(self.partial_path)
        self._manifest: dict[str, Any] = {
            "format": FORMAT,
            "workcell": _version(),
            "task": task,
            "seed": seed,
        }
        self._period = 1.0 / frame_rate
        self._tracks: dict[str, Track] = {}
        self._carriers: dict[int, str] = {}
        self._robots: dict[str, SceneRobot] = {}
        self._poses: BodyPoses | None = None
        self._timestep = 0.002
        self._buffer = _Buffer()
        self._next_frame, self._last_time = -np.inf, 0.0
        self._last_row: Array | None = None
        self._trace_ends: dict[str, Array] = {}
        self._flushed_at = clock.monotonic()
        self._has_result, self._open = False, True

    # ---- what stands still -------------------------------------------------------------------------------------

    def log_scene(self, scene: Scene) -> None:
        """The scene's geometry, its goals, and where everything is at the start."""
        owners = scenery.owners_of_bodies(scene)
        self.log_model(scene.model, owners, scene.initial_qpos())
        for robot in scene.robots.values():
            self._add_robot(robot, scene.initial_qpos())
        for goal in scene.goals.values():
            self.log_goal(goal)
        self._manifest["robots"] = {name: _describe(robot) for name, robot in scene.robots.items()}
        self._manifest |= {
            "objects": list(scene.objects),
            "obstacles": list(scene.obstacles),
            "goals": list(scene.goals),
        }
        self._writer.log_document("manifest", to_json(self._manifest))
        names = [entity(name) for name in scene.robots], [entity(name) for name in scene.objects]
        metrics = ("clearance", "tracking_error", *(f"{JOINT_POSITIONS}/{name}" for name in names[0]))
        self._writer.send_blueprint(make_blueprint(*names, metrics, scenery.eye(scene)))
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
        self._writer.name_series(f"metrics/{JOINT_POSITIONS}/{entity(robot.name)}", robot.robot.joint_names)

    def _link_track(
        self, path: str, robot: SceneRobot, link: int, body: int, qpos: Array, offset: Pose
    ) -> Track:
        """A frame fixed to a link, expressed in a body that the link carries."""
        assert self._poses is not None
        T_world_link = Pose.from_matrix(robot.robot.link_transforms(qpos[robot.qpos_addresses])[link])
        return Track(path, body, self._poses.pose(body, qpos).inverse() @ T_world_link @ offset)

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
            body = next((b for b in robot.link_body_ids[link] if b in self._carriers), None)
            if body is None:
                continue  # a link without anything to see has nothing to cover
            T_body_link = self._link_track(
                "", robot, int(link), body, reference, Pose.identity()
            ).T_body_entity
            path = f"world/robots/{entity(robot.name)}/spheres/{entity(robot.robot.link_names[link])}"
            mine = cover.link == link
            centres = T_body_link.apply(cover.centre[mine])
            self._writer.log_spheres(path, centres, cover.radius[mine], _SPHERE_RGBA, self._carriers[body])
        self.flush()

    def log_free_space(self, free_space: FreeSpace) -> None:
        """The cuboids, each with its number, and then the polytopes."""
        for index, (lower, upper) in enumerate(zip(free_space.lower, free_space.upper, strict=True)):
            self._writer.log_box(f"world/free_space/{index}", lower, upper, _FREE_RGBA)
        for index, polytope in enumerate(free_space.polytopes, start=len(free_space)):
            shape = polytope_shape(polytope, np.array(_FREE_RGBA))
            self._writer.log_shape(f"world/free_space/{index}", shape)
        self.flush()

    def log_obstacle_cover(self, cover: SphereCover) -> None:
        """Spheres of obstacles, in the world frame."""
        self._writer.log_spheres(
            "world/obstacle_spheres/all", cover.centre, cover.radius, _OBSTACLE_RGBA, "world"
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

    # ---- what happens ------------------------------------------------------------------------------------------

    def log_states(
        self, times: ArrayLike, qpos: ArrayLike, metrics: Mapping[str, ArrayLike] | None = None
    ) -> None:
        """Some steps of the simulation, in order.

        Args:
            times: (T,) or one number, simulated seconds, not decreasing.
            qpos: (T, nq) or (nq,), raw positions.
            metrics: by name, (T,) or (T, k) each: `clearance` and `tracking_error` in metres, and any others.
        """
        self._scene_logged("log_states")
        t = np.atleast_1d(np.asarray(times, dtype=float))
        rows = np.asarray(qpos, dtype=float).reshape(len(t), -1)
        for k, now in enumerate(t):
            if now >= self._next_frame - 1e-9:
                self._buffer.frame_times.append(float(now))
                self._buffer.frame_qpos.append(np.array(rows[k]))
                self._next_frame = now + self._period
        for name, values in (metrics or {}).items():
            column = np.array(values, dtype=float).reshape(len(t), -1)
            self._buffer.metrics.setdefault(name, []).append((np.array(t), column))
        if len(t):
            self._last_time, self._last_row = float(t[-1]), np.array(rows[-1])
        frames = self._buffer.frame_times
        if frames and (
            frames[-1] - frames[0] >= _CHUNK_S or clock.monotonic() - self._flushed_at >= _CHUNK_WALL_S
        ):
            self.flush()

    def log_execution(self, chunk: Execution) -> None:
        """Consecutive rows of a simulation, with their events and contacts: what `Simulation` hands out."""
        metrics = {
            "clearance": chunk.clearance,
            "tracking_error": chunk.tracking_error_m,
            "tracking_error_rad": chunk.tracking_error_rad,
        }
        self.log_states(chunk.time, chunk.qpos, metrics)
        self.log_nearest(chunk.time, chunk.clearance_points)
        for event in chunk.events:
            self.event(event.time, event.text, event.level)
        for contact in chunk.contacts:
            text = f"unintended contact: {' and '.join(contact.pair)}, {1e3 * contact.depth:.2f} mm deep"
            self.event(contact.time, text, "ERROR")

    def log_nearest(self, times: ArrayLike, points: ArrayLike) -> None:
        """The two points that are closest at each time (T,), (T, 2, 3), drawn as a line between them."""
        t, ends = (
            np.atleast_1d(np.asarray(times, dtype=float)),
            np.asarray(points, dtype=float).reshape(-1, 2, 3),
        )
        known = np.isfinite(ends).all(axis=(1, 2))
        if known.any():
            indexes = (t[known], self._step(t[known]))
            self._writer.send_segments("world/nearest", indexes, ends[known, 0], ends[known, 1])

    def event(self, time: float, text: str, level: str = "INFO") -> None:
        """One line of the event log, at simulated seconds; levels: INFO, WARN, ERROR."""
        if level not in LEVELS:
            raise InputError(f"there is no event level {level!r}", where="level", remedy=", ".join(LEVELS))
        self._writer.log_text("log", time, self._step(time), text, level)
        self._writer.flush()

    def set_result(self, result: Mapping[str, Any]) -> None:
        """The run's summary: kept in the recording, so that a review needs no other file."""
        self._writer.log_document("result", to_json(result))
        plain = {str(k): v for k, v in result.items() if isinstance(v, (bool, int, float, str))}
        self._writer.log_property("run", self._properties() | plain)
        self._has_result = True

    def _properties(self) -> dict[str, Any]:
        return {key: self._manifest[key] for key in ("format", "workcell", "task", "seed")}

    # ---- the file ----------------------------------------------------------------------------------------------

    def flush(self) -> None:
        """Writes what has been logged so far."""
        buffer, self._buffer = self._buffer, _Buffer()
        if buffer.frame_times:
            self._send_frames(np.array(buffer.frame_times), np.array(buffer.frame_qpos))
        for name, pieces in buffer.metrics.items():
            times = np.concatenate([piece[0] for piece in pieces])
            self._send_metric(name, times, np.concatenate([piece[1] for piece in pieces]))
        self._writer.flush()
        self._flushed_at = clock.monotonic()

    def close(self) -> Path:
        """Finishes the file and gives it its name; returns it."""
        if self._open:
            self._add_last_frame()
            self.flush()
            self._open = False
            self._writer.finish(self.path)
        return self.path

    def fail(self, reason: str, status: str = "ERROR") -> Path:
        """Finishes the file with the reason as its last event, and leaves it at `partial_path`; returns that."""
        if self._open:
            self._open = False
            try:
                self._add_last_frame()
                self.flush()
                self.event(self._last_time, reason, "ERROR")
                if not self._has_result:
                    self.set_result({"achieved": False, "status": status, "message": reason})
                self._writer.finish(self.partial_path)
            except OutputError:
                pass  # the disk is what failed: what reached it stays readable
        return self.partial_path

    def __enter__(self) -> Recording:
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        if error is None:
            self.close()
        elif isinstance(error, KeyboardInterrupt):
            self.fail("the run was interrupted", "INTERRUPTED")
        else:
            self.fail(f"the run stopped: {error}")

    def _add_last_frame(self) -> None:
        """The last state is in the file whatever the frame rate."""
        if self._last_row is not None and self._last_time > self._next_frame - self._period + 1e-9:
            self._buffer.frame_times.append(self._last_time)
            self._buffer.frame_qpos.append(self._last_row)

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
            if path.endswith("/tool"):
                self._send_trace(path.removesuffix("tool") + "trace", indexes, where)
        for name, robot in self._robots.items():
            self._send_metric(f"{JOINT_POSITIONS}/{entity(name)}", times, qpos[:, robot.qpos_addresses])

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
        "tool": chain.default_tool,
    }
