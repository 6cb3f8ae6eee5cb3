"""Tables and JSON on the terminal."""

from __future__ import annotations

import contextlib
import json
import math
import os
import sys
import unicodedata
from collections.abc import Iterable, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any

from workcell.errors import InputError

if TYPE_CHECKING:
    from rich.console import Console, ConsoleOptions, RenderableType

_PIPE_WIDTH = 1000
"""Columns where no terminal sets them: another program reads whole lines."""


def printable(text: str, *, keep: str = "\n\t") -> str:
    """Text for a terminal: control characters, which could move its cursor or colour it, as escapes.

    Args:
        text: may hold names out of files.
        keep: control characters that may stay.
    """
    if text.isprintable():
        return text
    return "".join(
        letter if letter.isprintable() or letter in keep or not _controls(letter) else _escaped(letter)
        for letter in text
    )


def _controls(letter: str) -> bool:
    """Control, surrogate and direction-changing characters."""
    return unicodedata.category(letter) in ("Cc", "Cf", "Cs", "Zl", "Zp")


def _escaped(letter: str) -> str:
    return letter.encode("unicode_escape", "surrogatepass").decode("ascii")


def tell(line: str, *, flush: bool = False) -> None:
    """A line on standard output, printable whatever names it holds."""
    print(printable(line), flush=flush)


def print_json(value: object) -> None:
    """One JSON document on standard output; numpy values become plain ones, NaN becomes null."""
    from workcell.files import plain

    print(json.dumps(plain(value), indent=2))


def check_outputs(outputs: Iterable[str | Path | None], inputs: Iterable[str | Path | None] = ()) -> None:
    """Before the work: each file can be written, and none is an input or another output.

    Raises:
        OutputError: a file can't be written there; InputError: it would overwrite what is read, or another one.
    """
    from workcell.files import check_writable, resolved

    taken = [resolved(Path(name)) for name in inputs if name and Path(name).is_file()]
    for path in [Path(name) for name in outputs if name]:
        if resolved(path) in taken:
            raise InputError(
                "the output would overwrite what this command reads or writes",
                where=path,
                remedy="another name",
            )
        check_writable(path)
        taken.append(resolved(path))


def console() -> Console:
    """Standard output: as wide as the terminal (or COLUMNS), without folding lines in a pipe."""
    from rich.console import Console
    from rich.segment import Segment

    class Screen(Console):
        def on_broken_pipe(self) -> None:
            raise BrokenPipeError  # rich would end the command as if it had failed

        def render(
            self, renderable: RenderableType, options: ConsoleOptions | None = None
        ) -> Iterable[Segment]:
            for part in super().render(renderable, options):
                yield part if part.control else Segment(printable(part.text), part.style)

    screen = Screen()
    return screen if screen.is_terminal or "COLUMNS" in os.environ else Screen(width=_PIPE_WIDTH)


def print_table(title: str, header: Sequence[str], rows: Iterable[Sequence[object]]) -> None:
    """A table under its title; numbers to the right."""
    from rich import box
    from rich.table import Table
    from rich.text import Text

    table = Table(box=box.SIMPLE_HEAD, pad_edge=False)
    listed = [list(row) for row in rows]
    for column, name in enumerate(header):
        numeric = bool(listed) and all(
            row[column] is None or isinstance(row[column], int | float) for row in listed
        )
        table.add_column(name, justify="right" if numeric else "left", overflow="fold")
    for row in listed:
        table.add_row(*(Text(printable(_cell(value), keep="")) for value in row))
    screen = console()
    screen.print(printable(title, keep=""), style="italic", markup=False, highlight=False)
    screen.print(table)


def _cell(value: object) -> str:
    if value is None:
        return "-"
    if isinstance(value, float):
        return "-" if not math.isfinite(value) else f"{value:.4g}"
    return str(value)


def progress_bar(description: str, total: int, parts: Sequence[str] = ()) -> Any:
    """A progress bar on a terminal's standard error; silent in a pipe. Use as a context manager; call `.step()`.

    Args:
        description: what is done.
        total: how many steps it takes.
        parts: names of the steps, where they have any; the one that is under way is shown.
    """
    return _Progress(description, total, parts)


def busy(description: str) -> Any:
    """The same for something of which nobody knows how long it takes: how long it has taken."""
    return _Progress(description, None) if sys.stderr.isatty() else contextlib.nullcontext()


class _Progress:
    def __init__(self, description: str, total: int | None, parts: Sequence[str] = ()) -> None:
        from rich import progress as rich
        from rich.console import Console

        console = Console(stderr=True)
        columns: list[rich.ProgressColumn] = [
            rich.TextColumn("{task.description}", markup=False),
            rich.BarColumn(),
            rich.TimeElapsedColumn(),
        ]
        if total is not None:
            columns += [rich.MofNCompleteColumn(), rich.TimeRemainingColumn()]
        self._progress = rich.Progress(
            *columns, console=console, transient=True, disable=not console.is_terminal
        )
        self._what, self._parts, self._done = printable(description, keep=""), parts, 0
        self._task = self._progress.add_task(self._words(), total=total)

    def __enter__(self) -> _Progress:
        self._progress.start()
        return self

    def __exit__(self, *_: object) -> None:
        self._progress.stop()

    def step(self, count: int = 1) -> None:
        """Advance by `count`."""
        self._done += count
        self._progress.update(self._task, advance=count, description=self._words())

    def _words(self) -> str:
        part = self._parts[self._done] if self._done < len(self._parts) else ""
        return f"{self._what}: {part}" if part else self._what
