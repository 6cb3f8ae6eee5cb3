"""`run_task`: a task script found, run, recorded and summed up, whatever happens in it."""

from __future__ import annotations

import time
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from workcell.compile_ahead import PLANNING, SAMPLING, TRACKING, compile_ahead, compiling_seconds
from workcell.errors import InputError, UnknownNameError
from workcell.files import check_writable, expanded, write_json_atomic
from workcell.ik.result import Status
from workcell.jit import announce_compiling
from workcell.model.loading.assets import find_task
from workcell.model.overlap import mechanism_overlap, start_overlap
from workcell.model.scene import Scene, scene_spec
from workcell.motion.live.stream import GoalStream
from workcell.motion.live.stream_file import read_stream
from workcell.motion.tool_paths.planners import check_planner
from workcell.record.write.recording import Recording
from workcell.simulate.controller import CONTROLLERS
from workcell.simulate.live.view import LiveView, check_screen
from workcell.task.job import Job
from workcell.task.script import TaskFailedError, load_script, run_script
from workcell.task.story import NOTHING_CHECKED


@dataclass(frozen=True, slots=True)
class JobResult:
    """How a run ended, and where its files are."""

    achieved: bool
    status: str
    sentence: str
    summary: dict[str, Any]
    recording: Path
    summary_path: Path

    @property
    def impossible(self) -> bool:
        """Whether the run ended with a proof that the task can't be done."""
        return self.status in {status.value for status in Status if status.is_impossible}


def run_task(
    task: str | Path,
    *,
    robot: str | None = None,
    planner: str = "ikspark",
    controller: str = "computed_torque",
    seed: int = 0,
    out: str | Path | None = None,
    trace: str | Path | None = None,
    view: bool = False,
    say: Callable[[str], None] = print,
) -> JobResult:
    """Run a task script and leave `<task>.rrd` and `<task>.json` in `out` (default: `runs/<task>`).

    Whatever happens, Ctrl-C included, what was recorded until then stays readable. `trace` is a file of recorded poses
    in place of the task's own (see docs/streams.md). With `view`, a task whose tools follow goals opens a window, in
    which their targets can be dragged.

    Raises:
        WorkcellError: bad input, a start in collision among it; OutputError: the folder can't be written.
        ScriptError: the script itself failed, with its line.
    """
    check_planner(planner)
    if view:
        check_screen()
    if controller not in CONTROLLERS:
        raise UnknownNameError("controller", controller, CONTROLLERS)
    began = time.perf_counter()
    compile_ahead(TRACKING, PLANNING, SAMPLING)
    path = find_task(task)
    script = load_script(path)
    scene = Scene.load(path, robot=robot, seed=seed).drivable()
    _check_starts(scene)
    stream = _stream_of(scene, trace)
    folder = Path(out) if out is not None else Path("runs") / path.stem
    name = scene.name
    summary = _summary_of(scene, planner, controller, seed)
    recording_path, summary_path = folder / f"{name}.rrd", folder / f"{name}.json"
    check_writable(recording_path)
    check_writable(summary_path)

    opened: list[LiveView] = []

    def window(shown: Scene) -> LiveView:
        opened.append(LiveView(shown, scene_spec(path, robot, seed)))
        return opened[-1]

    recording = Recording(recording_path, task=name, seed=seed, planner=planner)
    job = Job(
        scene, planner, controller, seed, recording, say, summary, began, stream, window if view else None
    )
    compiled_before = compiling_seconds()
    announce_compiling(lambda: say("compiling kernels: once on this machine, a minute or two"))
    try:
        with recording, recording.queries("task script"):
            recording.log_scene(scene)
            try:
                run_script(script, job)
                sentence = "The task was achieved."
                if summary.get("nothing_checked"):
                    sentence += f" Collisions were not checked: {NOTHING_CHECKED}."
                summary.update(achieved=True, status="ACHIEVED", sentence=sentence)
            except TaskFailedError as failure:
                summary.update(achieved=False, status=failure.status, sentence=failure.sentence)
                job.say(f"{failure.status}: {failure.sentence}", level="ERROR")
            if view and not opened:
                job.say("no window was opened: nothing in this task followed goals", level="WARN")
            summary["compiling_s"] = compiling_seconds() - compiled_before
            summary["wall_s"] = time.perf_counter() - began
            recording.set_result(summary)
    except BaseException:
        say(f"stopped; what was recorded until then: {recording.partial_path}")
        raise
    finally:
        announce_compiling(None)
    write_json_atomic(summary_path, summary)
    return JobResult(
        bool(summary["achieved"]),
        str(summary["status"]),
        str(summary["sentence"]),
        summary,
        recording_path,
        summary_path,
    )


def _summary_of(scene: Scene, planner: str, controller: str, seed: int) -> dict[str, Any]:
    """What a run says of itself, as long as it has not ended."""
    return {
        "task": scene.name,
        "robot": _whose(scene),
        "planner": planner,
        "controller": controller,
        "seed": seed,
        "achieved": False,
        "status": "INTERRUPTED",
        "sentence": "The run was interrupted.",
        "planning_s": 0.0,
        "min_clearance_m": None,
        "max_tracking_error_m": None,
    }


def _stream_of(scene: Scene, trace: str | Path | None) -> GoalStream | None:
    """The poses that a task is to follow, from the file that its table names or the one in its place."""
    own = scene.task.get("trace")
    if own is None and trace is not None:
        raise InputError(
            f"the task {scene.name} follows no recorded poses", where="--trace", remedy="such as teleop"
        )
    if own is None:
        return None
    if not isinstance(own, str) or not own:
        raise InputError("is no file's name", where=f"{scene.path}: [task] trace")
    path = expanded(Path(trace)) if trace is not None else scene.path.parent / expanded(Path(own))
    return read_stream(path).from_zero()


def _whose(scene: Scene) -> str | list[str]:
    """Who moves in a scene, by name."""
    if scene.mechanism is not None:
        return scene.mechanism.name
    return scene.robot().robot.name if len(scene.robots) == 1 else sorted(scene.robots)


def _check_starts(scene: Scene) -> None:
    """Raise InputError, with the pair and the depth, for what stands in something before anything moves."""
    if scene.mechanism is not None and (told := mechanism_overlap(scene.mechanism)):
        raise InputError(
            f"the start is in collision: {told}",
            where=f"{scene.path}: mechanism {scene.mechanism.name!r} start",
            remedy='give a clear start; if they are meant to overlap: <contact><exclude body1="" body2=""/></contact>',
        )
    for name in scene.robots:
        if overlap := start_overlap(scene, name):
            what, remedy = overlap
            raise InputError(
                f"the start is in collision: {what}",
                where=f"{scene.path}: robot {name!r} start",
                remedy=f"{remedy}; `workcell check` looks at the start alone",
            )
