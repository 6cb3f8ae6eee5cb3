"""A run's story: what a task script says, measures and judges, on the terminal, in recording and summary."""

from __future__ import annotations

import time
from collections.abc import Callable, Iterator, Mapping
from contextlib import contextmanager
from dataclasses import dataclass, field
from typing import Any, NoReturn

import numpy as np

from workcell.compile_ahead import compiling_seconds
from workcell.model.scene import Scene
from workcell.motion.path import Path
from workcell.pose import Array
from workcell.record.read.checks import MOST_MISSED
from workcell.record.write.recording import Recording
from workcell.simulate.execution import Execution
from workcell.simulate.frames import summary_of
from workcell.simulate.runner import Runner
from workcell.simulate.simulation import Simulation
from workcell.task.script import TaskFailedError
from workcell.world.planning_world import PlanningWorld

NOTHING_CHECKED = "there is no collision geometry that could meet"


@dataclass(slots=True)
class Story:
    """A run of a task as far as it is told: on the terminal, in the recording, in the summary.

    Attributes:
        scene: the compiled scene of the task file.
        recording: the open `.rrd`.
        tell: where lines of the story go.
        summary: what `DIR/<task>.json` will hold.
        began: `time.perf_counter()` when the run began.
        sim_time: seconds simulated so far, the time of the events that are logged.
        ways: tool positions (k, 3) of the plans logged so far, by the robot's name.
        trying: whether what happens now is a try, which is not told (see `quietly`).
    """

    scene: Scene
    recording: Recording
    tell: Callable[[str], None]
    summary: dict[str, Any]
    began: float
    sim_time: float = 0.0
    ways: dict[str, list[Array]] = field(default_factory=dict)
    trying: bool = False

    def say(self, text: str, level: str = "INFO") -> None:
        """One line of the story, on the terminal and in the recording's log."""
        if self.trying:
            return
        self.recording.event(self.sim_time, text, level)
        self.tell(f"[{time.perf_counter() - self.began:6.2f} s] {text}")

    @contextmanager
    def quietly(self) -> Iterator[None]:
        """Nothing that is said meanwhile is told: it is about a try."""
        already, self.trying = self.trying, True
        try:
            yield
        finally:
            self.trying = already

    @contextmanager
    def asking(self, what: str, *worlds: PlanningWorld) -> Iterator[None]:
        """Records what the planner sees in `worlds`, then, under `what`, the queries of inverse kinematics made."""
        for world in worlds:
            self.recording.log_world(world)
        with self.recording.queries(what):
            yield

    @contextmanager
    def phase(self, name: str) -> Iterator[None]:
        """Time a phase; the summary gets `<name>_s`, summed over those of one name, without compiling of kernels."""
        start = time.perf_counter() - compiling_seconds()
        try:
            yield
        finally:
            key = f"{name}_s"
            self.summary[key] = self.summary.get(key, 0.0) + time.perf_counter() - compiling_seconds() - start

    def fail(self, status: str, sentence: str) -> NoReturn:
        """End the task as not achieved."""
        raise TaskFailedError(status, sentence)

    def log_world(self, world: PlanningWorld) -> None:
        """Sphere cover and free space into the recording, their numbers into the story."""
        self.recording.log_cover(world.robot, world.cover, self.scene.initial_qpos())
        self.recording.log_free_space(world.free_space)
        self.say(
            f"{self.scene.name}: {len(world.obstacles)} obstacle pieces, {len(world.cover)} robot spheres, "
            f"{len(world.free_space)} free-space cuboids"
        )
        if world.clearance.checks.nothing:
            self.say(f"{world.robot.name}: what is planned is {world.clearance.checks.words}", "WARN")

    @staticmethod
    def if_looked_at(world: PlanningWorld, words: str) -> str:
        """What a proof of clearance in a world says; where nothing in it could meet, that nothing was checked."""
        checks = world.clearance.checks
        return checks.words if checks.nothing else words

    def log_plan(self, path: Path) -> None:
        """A planned way of the tool into the recording, after those that were planned for this robot before."""
        self.log_way(path.robot.name, path.robot.fk_transform(path.configurations))

    def log_way(self, robot: str, tools: Array) -> None:
        """Tool poses (k, 4, 4) into the recording, behind those that were logged for this robot before."""
        self.ways.setdefault(robot, []).append(tools[:, :3, 3])
        self.recording.log_plan(robot, np.concatenate(self.ways[robot]))

    def log_frame_way(self, frame: str, points: Array) -> None:
        """Where a mechanism's frame is to go (k, 3), behind what was logged for this frame before."""
        self.ways.setdefault(frame, []).append(points)
        self.recording.log_frame_plan(frame, np.concatenate(self.ways[frame]))

    def tool_trace(self, simulation: Simulation, begin: float, end: float) -> Array:
        """(k, 3) where the tool was, in the world, between two moments of the simulation (seconds)."""
        rows = simulation.result()
        points: Array = rows.tool_position[(rows.time >= begin) & (rows.time <= end)]
        return points

    def log_chunk(self, chunk: Execution) -> None:
        """Rows of a simulation into the recording, their events into the story: what `Simulation` hands out."""
        self.recording.log_execution(chunk)
        if len(chunk):
            self.sim_time = float(chunk.time[-1])
        for event in chunk.events:
            self.tell(f"[{time.perf_counter() - self.began:6.2f} s] at {event.time:5.2f} s: {event.text}")

    def judge(self, simulation: Runner, conditions: Mapping[str, bool]) -> None:
        """Write what the simulation measured into the summary; the task fails unless every condition holds.

        Beside the given conditions: the run was not stopped, nothing touched that should not, clearance stayed at
        or above zero, robots that moved at once are proved clear of each other, and a mechanism's ties held.
        """
        execution = simulation.result()
        pair, looked = execution.min_clearance_pair, not execution.looked_at_nothing
        if not looked:
            self.summary["nothing_checked"] = True
            self.say(f"{NOTHING_CHECKED}: neither contacts nor clearance were looked at", "WARN")
        self.summary.update(
            simulated_s=simulation.time,
            min_clearance_m=execution.min_clearance if looked else None,
            min_clearance_pair=list(pair),
            max_tracking_error_m=float(execution.tracking_error_m.max(initial=0.0)),
            unintended_contacts=len(execution.contacts),
        )
        if execution.live:
            self.summary |= summary_of(execution.live)
        if len(execution.closure_error):
            self.summary["max_closure_error_m"] = float(execution.closure_error.max())
        if execution.stop is not None:
            self.fail(
                execution.stop.reason.value, f"{execution.stop.reason.sentence} {execution.stop.detail}"
            )
        checks: dict[str, bool] = {}
        if looked:
            checks["no unintended contact"] = not execution.contacts
            checks["clearance never below zero"] = execution.min_clearance >= 0.0
        if execution.live:
            checks["no joint jumped"] = not self.summary["live_jumps"]
        if len(execution.closure_error):
            checks["its ties held"] = float(execution.closure_error.max()) <= MOST_MISSED
        if simulation.unproved:
            checks["all that moved at once is proved clear of each other"] = False
        checks |= conditions
        self.summary["conditions"] = checks
        missed = [name for name, holds in checks.items() if not holds]
        if missed:
            because = f" {'; '.join(simulation.unproved)}." if simulation.unproved else ""
            self.fail("FAILED", f"The job was executed, but: not {'; not '.join(missed)}.{because}")
