"""Tables and JSON on the terminal."""

from __future__ import annotations

import json
import math
from collections.abc import Iterable, Sequence
from typing import Any


def print_json(value: object) -> None:
    """One JSON document on standard output; numpy values become plain ones, NaN becomes null."""
    from workcell.record.summary import plain

    print(json.dumps(plain(value), indent=2))


def print_table(title: str, header: Sequence[str], rows: Iterable[Sequence[object]]) -> None:
    """A table; numbers to the right."""
    from rich import box
    from rich.console import Console
    from rich.table import Table

    table = Table(title=title, title_justify="left", box=box.SIMPLE_HEAD, pad_edge=False)
    listed = [list(row) for row in rows]
    for column, name in enumerate(header):
        numeric = bool(listed) and all(
            row[column] is None or isinstance(row[column], int | float) for row in listed
        )
        table.add_column(name, justify="right" if numeric else "left", overflow="fold")
    for row in listed:
        table.add_row(*(_cell(value) for value in row))
    Console(soft_wrap=False).print(table)


def _cell(value: object) -> str:
    if value is None:
        return "-"
    if isinstance(value, float):
        return "-" if not math.isfinite(value) else f"{value:.4g}"
    return str(value)


def progress_bar(description: str, total: int) -> Any:
    """A progress bar on a terminal's standard error; silent in a pipe. Use as a context manager; call `.step()`."""
    return _Progress(description, total)


class _Progress:
    def __init__(self, description: str, total: int) -> None:
        from rich.console import Console
        from rich.progress import BarColumn, MofNCompleteColumn, Progress, TextColumn, TimeRemainingColumn

        console = Console(stderr=True)
        columns = (TextColumn("{task.description}"), BarColumn(), MofNCompleteColumn(), TimeRemainingColumn())
        self._progress = Progress(*columns, console=console, transient=True, disable=not console.is_terminal)
        self._task = self._progress.add_task(description, total=total)

    def __enter__(self) -> _Progress:
        self._progress.start()
        return self

    def __exit__(self, *_: object) -> None:
        self._progress.stop()

    def step(self, count: int = 1) -> None:
        """Advance by `count`."""
        self._progress.advance(self._task, count)
