"""Task scripts: found beside their task file, loaded, called; their mistakes become one message each."""

from __future__ import annotations

import importlib.util
import traceback
from pathlib import Path
from types import CodeType
from typing import Protocol

from workcell.errors import ModelError, ScriptError, WorkcellError


class Script(Protocol):
    """`run(job)` of a task script."""

    __code__: CodeType

    def __call__(self, job: object, /) -> None:
        """Do the task."""


class TaskFailedError(Exception):
    """Ends a task early with a status; `run_task` turns it into the summary, never into a traceback."""

    def __init__(self, status: str, sentence: str) -> None:
        self.status, self.sentence = status, sentence
        super().__init__(f"{status}: {sentence}")


def load_script(task_file: Path) -> Script:
    """The function `run(job)` of the script beside a task file.

    Raises:
        ModelError: there is none, or it can't be loaded; ScriptError: it fails while it is loaded.
    """
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
    except ImportError as error:
        raise ModelError(f"this script can't import what it needs: {error}", where=path) from None
    except (KeyboardInterrupt, WorkcellError):
        raise
    except BaseException as error:  # SystemExit too: a script doesn't end the command
        raise _script_error(error, path) from error
    script = getattr(module, "run", None)
    if not callable(script):
        raise ModelError("the script has no function run(job)", where=path)
    return script  # type: ignore[no-any-return]


def run_script(script: Script, job: object) -> None:
    """Call a script; what it raises by mistake becomes one message with its file and line.

    Raises:
        ScriptError: an exception that is none of workcell's own; those pass as they are.
    """
    try:
        script(job)
    except (WorkcellError, TaskFailedError, KeyboardInterrupt):
        raise
    except BaseException as error:
        code = getattr(script, "__code__", None)
        raise _script_error(error, Path("script" if code is None else code.co_filename)) from error


def _script_error(error: BaseException, path: Path) -> ScriptError:
    """The script's own line is the last one of its file on the way to the error."""
    frames = [frame for frame in traceback.extract_tb(error.__traceback__) if frame.filename == str(path)]
    line = f":{frames[-1].lineno}" if frames else ""
    code = f", at: {frames[-1].line}" if frames and frames[-1].line else ""
    return ScriptError(
        f"{type(error).__name__}: {error}{code}", where=f"{path}{line}", remedy="mend the script"
    )
