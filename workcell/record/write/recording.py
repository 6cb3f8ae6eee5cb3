"""`Recording`: what a run writes while it happens, into one `.rrd` file that needs nothing to be understood."""

from __future__ import annotations

import time as clock
from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from dataclasses import dataclass, field
from pathlib import Path
from types import TracebackType
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from workcell.errors import InputError, OutputError
from workcell.files import to_json
from workcell.ik.mechanisms.problem import MechanismProblem
from workcell.ik.mechanisms.result import MechanismResult
from workcell.ik.observing import observed
from workcell.ik.problem import IKProblem
from workcell.ik.result import IKResult
from workcell.pose import Array
from workcell.record.write.live_log import LiveLog
from workcell.record.write.rrd import writing
from workcell.record.write.scene_log import CLOSURE_ERROR, SceneLog
from workcell.record.write.solver_log import SolverLog
from workcell.record.write.waypoints import Waypoint

if TYPE_CHECKING:
    from workcell.simulate.execution import Execution

LEVELS = ("INFO", "WARN", "ERROR")

_CHUNK_S = 0.7
_CHUNK_WALL_S = 0.8


@dataclass(slots=True)
class _Buffer:
    """Rows that are not in the file yet: poses at the frame rate, metrics at the rate they come in."""

    frame_times: list[float] = field(default_factory=list)
    frame_qpos: list[Array] = field(default_factory=list)
    metrics: dict[str, list[tuple[Array, Array]]] = field(default_factory=dict)


class Recording(SceneLog):
    """An `.rrd` file being written. Use it as a context manager.

    Rows are handed to the operating system at least once a simulated second, and about once a second of the clock, so
    that a killed process leaves a readable file.
    While it is open the file is `<name>.partial.rrd`; `close` writes the finished one to `path`. A run that ends with
    an exception keeps the partial file, with the failure as its last event: an earlier recording at `path` is intact.

    Args:
        path: where the finished recording is to lie; its folder is made.
        task: name of what is recorded.
        seed: of the run.
        planner: the solver that its configurations and ways are to be of, which a review holds it to; None: any.
        frame_rate: poses and joint positions a second of simulated time. Metrics are kept at their own rate.

    Raises:
        OutputError: by every method, when the file can't be written.
    """

    def __init__(
        self,
        path: str | Path,
        *,
        task: str,
        seed: int = 0,
        planner: str | None = None,
        frame_rate: float = 50.0,
    ) -> None:
        self.path = Path(path)
        self.partial_path = self.path.with_name(self.path.stem + ".partial.rrd")
        with writing(self.partial_path):
            self.path.parent.mkdir(parents=True, exist_ok=True)
        super().__init__(self.partial_path, task, seed, planner)
        self._solvers = SolverLog(self._writer)
        self._live = LiveLog(self._writer, self._step)
        self._period = 1.0 / frame_rate
        self._buffer = _Buffer()
        self._next_frame, self._last_time = -np.inf, 0.0
        self._last_row: Array | None = None
        self._flushed_at = clock.monotonic()
        self._has_result, self._open = False, True

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
        metrics = {"tracking_error": chunk.tracking_error_m, "tracking_error_rad": chunk.tracking_error_rad}
        if not chunk.looked_at_nothing:
            metrics |= {"clearance": np.nan_to_num(chunk.clearance, nan=np.inf)}
        if len(chunk) and len(chunk.closure_error) == len(chunk):
            metrics |= {CLOSURE_ERROR: chunk.closure_error}
        self.log_states(chunk.time, chunk.qpos, metrics)
        self.log_nearest(chunk.time, chunk.clearance_points)
        for frames in chunk.live:
            self._live.log(frames)
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

    @contextmanager
    def queries(self, what: str) -> Iterator[None]:
        """Records every query of inverse kinematics that this thread answers meanwhile, with its solver's stages.

        Where these are nested, a query counts for the innermost one. `what` says what is asked.
        """

        def answered(problem: object, result: object) -> None:
            when = (self._last_time, self._step(self._last_time))
            if isinstance(problem, MechanismProblem) and isinstance(result, MechanismResult):
                self._add_mechanism_waypoint(what, problem, result)
                self._solvers.add_mechanism(what, problem, result, when)
            elif isinstance(problem, IKProblem) and isinstance(result, IKResult):
                self._add_query(what, problem, result, when)
            if clock.monotonic() - self._flushed_at >= _CHUNK_WALL_S:
                self.flush()

        with observed(answered):
            yield
        self._locate()

    def _add_query(self, what: str, problem: IKProblem, result: IKResult, when: tuple[float, int]) -> None:
        solids = None
        if result.cuboids is not None and result.free_space is not None:
            solids = self._solids.numbers(result.free_space, result.cuboids)
        self._add_waypoint(what, problem, result, solids)
        self._solvers.add(what, problem, result, when, solids)

    def _add_mechanism_waypoint(self, what: str, problem: MechanismProblem, result: MechanismResult) -> None:
        """The values of the motors that were answered, to be found again when the mechanism gets there."""
        moving = self._mechanism
        if result.q is None or not result.solved:
            return
        bounded = problem.max_step is not None or problem.max_link_rotation is not None
        before = problem.q_reference if bounded and problem.q_reference is not None else result.q
        if moving is None:
            self._add_team_waypoint(what, problem, result, before)
            return
        if problem.mechanism.size != moving.mechanism.size:
            return
        here, there = moving.motor_values(np.array(result.q)), moving.motor_values(np.array(before))
        waypoint = Waypoint(what, result.solver, here, there, None, None)
        self._cuboids.add_mechanism_answer(moving.name, moving.motor_addresses, waypoint)

    def _add_team_waypoint(
        self, what: str, problem: MechanismProblem, result: MechanismResult, before: Array
    ) -> None:
        """What was answered for all arms that hold an object: a waypoint of each of them."""
        compiled = problem.mechanism.compiled
        if compiled is None or result.q is None:
            return
        known = set(compiled.addresses.tolist())
        here, there = compiled.qpos(np.array(result.q)), compiled.qpos(np.array(before))
        for robot in self._robots.values():
            at = robot.qpos_addresses
            if known.issuperset(at.tolist()):
                self._cuboids.add_answer(
                    robot, Waypoint(what, result.solver, here[at], there[at], None, None)
                )

    def _add_waypoint(
        self, what: str, problem: IKProblem, result: IKResult, solids: NDArray[np.int64] | None
    ) -> None:
        """What a query answered for one of the scene's robots, to be found again when the robot gets there."""
        robot = self._robot_of(problem.robot)
        if robot is None or result.q is None or not result.solved:
            return
        bounded = problem.max_step is not None or problem.max_link_rotation is not None
        before = problem.q_reference if bounded and problem.q_reference is not None else result.q
        waypoint = Waypoint(what, result.solver, result.q, before, problem.cover, solids)
        self._cuboids.add_answer(robot, waypoint)

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
        self._solvers.send()
        super().flush()
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
