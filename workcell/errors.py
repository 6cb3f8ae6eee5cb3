"""The errors workcell raises: each says what was wrong, where, and what would be valid.

Not finding a solution is never an error: it is a result with a `Status` (see `workcell.ik.result`).
"""

from __future__ import annotations

import difflib
from collections.abc import Iterable
from pathlib import Path


class WorkcellError(Exception):
    """Base class: a message for the user, where it happened, and a remedy.

    Args:
        message: what was wrong, in one sentence.
        where: file and element, or the argument's name.
        remedy: what would be valid, or what to do.
    """

    def __init__(self, message: str, *, where: str | Path | None = None, remedy: str | None = None) -> None:
        self.message = message
        self.where = None if where is None else str(where)
        self.remedy = remedy
        text = message if self.where is None else f"{self.where}: {message}"
        super().__init__(text if remedy is None else f"{text} ({remedy})")


class InputError(WorkcellError):
    """An argument or a file holds a value that makes no sense (NaN, wrong shape, wrong type, out of range)."""


class ModelError(WorkcellError):
    """A robot, object, cell or task file can't be used; `where` names the file and the element."""


class UnknownNameError(WorkcellError):
    """A robot, task, goal, site, solver ... of that name does not exist; the message lists those that do."""

    def __init__(
        self, kind: str, name: str, known: Iterable[str], *, where: str | Path | None = None
    ) -> None:
        self.kind, self.name, self.known = kind, name, sorted(known)
        close = difflib.get_close_matches(name, self.known, n=3, cutoff=0.5)
        hint = f"did you mean {' or '.join(close)}? " if close else ""
        listed = f"known: {', '.join(self.known)}" if self.known else "there are none"
        super().__init__(f"there is no {kind} named {name!r}", where=where, remedy=hint + listed)


class OutputError(WorkcellError):
    """A result can't be written (read-only folder, full disk); what was there before is intact."""


class RecordingError(WorkcellError):
    """A recording can't be read: not an .rrd, damaged, or from something else."""


class ScriptError(WorkcellError):
    """A task script failed by a mistake of its own; `where` names its file and line."""


class NotSolvedError(WorkcellError):
    """Raised by `IKResult.unwrap()` when there is no verified configuration."""
