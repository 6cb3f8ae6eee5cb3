"""Lines of an output file, one a problem: made in one process or several, written as they come."""

from __future__ import annotations

import contextlib
import json
import multiprocessing
import os
import signal
from collections.abc import Iterator
from concurrent.futures import ProcessPoolExecutor
from concurrent.futures.process import BrokenProcessPool
from multiprocessing.reduction import ForkingPickler
from pathlib import Path
from types import MappingProxyType
from typing import Any, Protocol, TextIO

from workcell.errors import OutputError, WorkcellError
from workcell.files import replaceable

_ONE_THREAD = ("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS", "MKL_NUM_THREADS")


class Task(Protocol):
    """What a worker process needs; it must survive pickling."""

    def __len__(self) -> int:
        """Number of lines."""
        ...

    def line(self, index: int) -> dict[str, Any]:
        """The JSON object of one line."""
        ...


_worker_task: Task | None = None


def _start_worker(task: Task) -> None:
    global _worker_task
    # Ctrl-C reaches every process of the terminal; the parent alone answers it
    signal.signal(signal.SIGINT, signal.SIG_IGN)
    _worker_task = task


def _reduce_mapping(mapping: MappingProxyType[str, Any]) -> tuple[Any, ...]:
    """Read-only mappings can't be pickled by themselves."""
    return _restore_mapping, (dict(mapping),)


def _restore_mapping(values: dict[str, Any]) -> MappingProxyType[str, Any]:
    return MappingProxyType(values)


def _worker_line(index: int) -> dict[str, Any]:
    assert _worker_task is not None
    return _worker_task.line(index)


def run_lines(task: Task, jobs: int) -> Iterator[dict[str, Any]]:
    """All lines in order, made by `jobs` processes."""
    if jobs <= 1 or len(task) <= 1:
        yield from (task.line(index) for index in range(len(task)))
        return
    ForkingPickler.register(MappingProxyType, _reduce_mapping)
    others = set(multiprocessing.active_children())
    with _single_threaded():
        pool = ProcessPoolExecutor(
            jobs, multiprocessing.get_context("spawn"), initializer=_start_worker, initargs=(task,)
        )
        try:
            with _without_interrupts():
                lines = pool.map(_worker_line, range(len(task)))
            yield from lines
        except BrokenProcessPool:
            raise WorkcellError(
                "a worker process died", where="jobs", remedy="use fewer processes: memory may be short"
            ) from None
        except BaseException:
            for process in set(multiprocessing.active_children()) - others:
                process.terminate()
            raise
        finally:
            pool.shutdown(wait=True, cancel_futures=True)


@contextlib.contextmanager
def _without_interrupts() -> Iterator[None]:
    """Ctrl-C waits until all processes are started, which would else complain of it; they never see it themselves."""
    before = signal.pthread_sigmask(signal.SIG_BLOCK, {signal.SIGINT})
    try:
        yield
    finally:
        signal.pthread_sigmask(signal.SIG_SETMASK, before)


@contextlib.contextmanager
def _single_threaded() -> Iterator[None]:
    """Processes started inside use one BLAS thread each."""
    before = {name: os.environ.get(name) for name in _ONE_THREAD}
    os.environ.update(dict.fromkeys(_ONE_THREAD, "1"))
    try:
        yield
    finally:
        for name, value in before.items():
            if value is None:
                del os.environ[name]
            else:
                os.environ[name] = value


@contextlib.contextmanager
def output_file(out: Path | None) -> Iterator[TextIO | None]:
    """The open partial file, which takes its name when everything went well.

    Raises:
        OutputError: it can't be written there, or what stands there is no plain file.
    """
    if out is None:
        yield None
        return
    try:
        target = replaceable(out)
        partial = target.with_name(target.name + ".partial")
        target.parent.mkdir(parents=True, exist_ok=True)
        file = partial.open("w", encoding="utf-8")
    except OSError as error:
        raise OutputError(
            f"can't be written: {error.strerror}", where=out, remedy="choose a writable folder with --out"
        ) from None
    try:
        yield file
        file.close()
        partial.replace(target)
    except KeyboardInterrupt:
        raise KeyboardInterrupt(f"interrupted; the answers so far are in {partial}") from None
    except OSError as error:
        raise OutputError(
            f"can't be written: {error.strerror}", where=out, remedy=f"the answers so far are in {partial}"
        ) from None
    finally:
        # what is still buffered can't be written to a full disk when it is closed either
        with contextlib.suppress(OSError):
            file.close()


def write_line(file: TextIO, line: dict[str, Any]) -> None:
    """Write a line so that it is in the file at once."""
    file.write(json.dumps(line) + "\n")
    file.flush()
