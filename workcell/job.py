"""`Job`: one run of a task: its scene, its seed, its recording, its summary file, and the story it tells while it runs."""

from __future__ import annotations

import importlib.util
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any, NoReturn

from workcell.errors import ModelError, UnknownNameError
from workcell.ik.result import IKResult, Status
from workcell.model.data import find_task
from workcell.model.scene import Scene

if TYPE_CHECKING:
    from workcell.record.recording import Recording

PLANNERS = ("ikspark", "auto")


class TaskFailedError(Exception):
    """Ends a task early with a status; `run_task` turns it into the summary, never into a traceback."""

    def __init__(self, status: str, sentence: str) -> None:
        self.status, self.sentence = status, sentence
        super().__init__(f"{status}: {sentence}")


@dataclass(slots=True)
class Job:
    """What a task script gets.

    Attributes:
        scene: the compiled scene of the task file.
        planner: name of the solver for configurations and paths.
        seed: same seed, same plan.
        recording: the open `.rrd`.
        tell: where lines of the story go.
        summary: what `DIR/<task>.json` will hold.
        began: `time.perf_counter()` when the run began.
        sim_time: seconds simulated so far, the time of the events that are logged.
    """

    scene: Scene
    planner: str
    seed: int
    recording: Recording
    tell: Callable[[str], None]
    summary: dict[str, Any]
    began: float
    sim_time: float = 0.0

    def say(self, text: str, level: str = "INFO") -> None:
        """One line of the story, on the terminal and in the recording's log."""
        self.recording.event(self.sim_time, text, level)
        self.tell(f"[{time.perf_counter() - self.began:6.2f} s] {text}")

    @contextmanager
    def phase(self, name: str) -> Iterator[None]:
        """Time a phase; the summary gets `<name>_s`, summed over phases of one name."""
        start = time.perf_counter()
        try:
            yield
        finally:
            key = f"{name}_s"
            self.summary[key] = self.summary.get(key, 0.0) + time.perf_counter() - start

    def require(self, result: IKResult, what: str) -> IKResult:
        """The result when solved; otherwise the task ends with its status."""
        if not result.solved:
            because = f" ({'; '.join(result.rejected[:2])})" if result.rejected else ""
            self.fail(result.status.value, f"{what}: {result.status.sentence}{because}")
        return result

    def fail(self, status: str, sentence: str) -> NoReturn:
        """End the task as not achieved."""
        raise TaskFailedError(status, sentence)


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
        return self.status in {status.value for status in Status if status.is_proof}


def run_task(
    task: str | Path,
    *,
    robot: str | None = None,
    planner: str = "ikspark",
    seed: int = 0,
    out: str | Path | None = None,
    say: Callable[[str], None] = print,
) -> JobResult:
    """Run a task script and leave `<task>.rrd` and `<task>.json` in `out` (default: `runs/<task>`).

    Whatever happens, Ctrl-C included, what was recorded until then stays readable.

    Raises:
        WorkcellError: bad input; OutputError: the folder can't be written.
    """
    from workcell.record.recording import Recording
    from workcell.record.summary import write_json_atomic

    if planner not in PLANNERS:
        raise UnknownNameError("planner", planner, PLANNERS)
    began = time.perf_counter()
    path = find_task(task)
    script = _load_script(path)
    scene = Scene.load(path, robot=robot)
    folder = Path(out) if out is not None else Path("runs") / path.stem
    name = scene.name
    summary: dict[str, Any] = {
        "task": name,
        "robot": scene.robot().robot.name if len(scene.robots) == 1 else sorted(scene.robots),
        "planner": planner,
        "seed": seed,
        "achieved": False,
        "status": "INTERRUPTED",
        "sentence": "The run was interrupted.",
    }
    recording_path, summary_path = folder / f"{name}.rrd", folder / f"{name}.json"
    recording = Recording(recording_path, task=name, seed=seed)
    job = Job(scene, planner, seed, recording, say, summary, began)
    try:
        with recording:
            recording.log_scene(scene)
            try:
                script(job)
                summary.update(achieved=True, status="ACHIEVED", sentence="The task was achieved.")
            except TaskFailedError as failure:
                summary.update(achieved=False, status=failure.status, sentence=failure.sentence)
                job.say(f"{failure.status}: {failure.sentence}", level="ERROR")
            summary["wall_s"] = time.perf_counter() - began
            recording.set_result(summary)
    except BaseException:
        say(f"stopped; what was recorded until then: {recording.partial_path}")
        raise
    write_json_atomic(summary_path, summary)
    return JobResult(
        bool(summary["achieved"]),
        str(summary["status"]),
        str(summary["sentence"]),
        summary,
        recording_path,
        summary_path,
    )


def _load_script(task_file: Path) -> Callable[[Job], None]:
    """The function `run(job)` of the script beside a task file."""
    path = task_file.with_suffix(".py")
    if not path.is_file():
        raise ModelError(
            "the task has no script beside it",
            where=task_file,
            remedy=f"write {path.name} with a function run(job)",
        )
    spec = importlib.util.spec_from_file_location(f"workcell_task_{path.stem}", path)
    if spec is None or spec.loader is None:
        raise ModelError("this script can't be loaded", where=path)
    module = importlib.util.module_from_spec(spec)
    try:
        spec.loader.exec_module(module)
    except SyntaxError as error:
        raise ModelError(
            f"this script is not valid Python: {error.msg}", where=f"{path}:{error.lineno}"
        ) from None
    script = getattr(module, "run", None)
    if not callable(script):
        raise ModelError("the script has no function run(job)", where=path)
    return script  # type: ignore[no-any-return]
