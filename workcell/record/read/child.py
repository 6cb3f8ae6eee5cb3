"""Rerun's reader in a process of its own: native code that aborts on a damaged file ends that process alone.

The child is asked for one file after another; the process that asks starts it when it first needs it, again when it has
died, and it ends when nobody listens any more.
"""

from __future__ import annotations

import os
import pickle
import struct
import subprocess
import sys
import threading
import warnings
from dataclasses import dataclass
from pathlib import Path
from typing import IO, Any

import numpy as np

from workcell.pose import Array

_LENGTH = struct.Struct("<q")


@dataclass(frozen=True, slots=True)
class Piece:
    """Some rows of one entity: `times` (T,) in seconds, or None for static data; Arrow columns by component."""

    path: str
    times: Array | None
    columns: dict[str, Any]


@dataclass(frozen=True, slots=True)
class Decoded:
    """What a file holds: who wrote it (None where it names nobody), whether it has a blueprint, and its rows."""

    application: str | None
    has_blueprint: bool
    pieces: list[Piece]


class UnreadableError(Exception):
    """Rerun's reader refused a file, or died of it."""


class _Child:
    """The process, while it lives; one at a time is asked."""

    def __init__(self) -> None:
        self._lock = threading.Lock()
        self._process: subprocess.Popen[bytes] | None = None
        self._owner = 0

    def ask(self, path: Path) -> Decoded:
        with self._lock:
            process = self._running()
            assert process.stdin is not None and process.stdout is not None
            try:
                process.stdin.write(os.fsencode(path.absolute()).hex().encode() + b"\n")
                process.stdin.flush()
                answer = _received(process.stdout)
            except (OSError, EOFError):
                code = process.wait()
                self._process = None
                raise UnreadableError(f"Rerun's reader broke off (exit {code})") from None
            except BaseException:
                self.end()  # interrupted half-way: what it still sends would be taken for the next answer
                raise
        if isinstance(answer, str):
            raise UnreadableError(answer)
        assert isinstance(answer, Decoded)
        return answer

    def _running(self) -> subprocess.Popen[bytes]:
        if self._process is None or self._owner != os.getpid() or self._process.poll() is not None:
            root = str(Path(__file__).resolve().parents[3])
            paths = os.pathsep.join(filter(None, [root, os.environ.get("PYTHONPATH")]))
            self._process = subprocess.Popen(
                [sys.executable, "-m", __name__],
                stdin=subprocess.PIPE,
                stdout=subprocess.PIPE,
                stderr=subprocess.DEVNULL,
                env={**os.environ, "PYTHONPATH": paths},
                start_new_session=True,  # Ctrl-C is for the process that asks
            )
            self._owner = os.getpid()
        return self._process

    def end(self) -> None:
        if self._process is not None and self._owner == os.getpid():
            self._process.kill()
            self._process.wait()
        self._process = None


_CHILD = _Child()


def decode(path: Path) -> Decoded:
    """What Rerun's reader finds in a file; raises UnreadableError."""
    return _CHILD.ask(path)


def _received(stream: IO[bytes]) -> Any:
    size = _LENGTH.unpack(_exactly(stream, _LENGTH.size))[0]
    return pickle.loads(_exactly(stream, size))


def _exactly(stream: IO[bytes], size: int) -> bytes:
    data = stream.read(size)
    if len(data) < size:
        raise EOFError
    return data


def _decoded(path: Path) -> Decoded:
    """In the child: everything, or an exception."""
    from workcell.record.write.rrd import TIME, rerun

    rerun()
    from rerun.chunk import RrdReader

    with warnings.catch_warnings():
        warnings.simplefilter("ignore")  # a file without an index is called a legacy file
        reader = RrdReader(path)
        stores = reader.recordings()
        if not stores:
            return Decoded(None, False, [])
        pieces = []
        for chunk in reader.stream(store=stores[0]):
            batch = chunk.to_record_batch()
            times = None
            if not chunk.is_static:
                if TIME not in batch.schema.names:
                    continue
                times = batch.column(TIME).cast("int64").to_numpy(zero_copy_only=False) / 1e9
            indexes = {*chunk.timeline_names, "rerun.controls.RowId"}
            columns = {name: batch.column(name) for name in batch.schema.names if name not in indexes}
            pieces.append(Piece(chunk.entity_path.strip("/"), times, columns))
        return Decoded(stores[0].application_id, bool(reader.blueprints()), pieces)


def _serve() -> None:
    """Answers requests until nobody asks any more; what native code prints goes nowhere."""
    answers = os.fdopen(os.dup(1), "wb")
    os.dup2(2, 1)
    np.seterr(all="ignore")
    for line in sys.stdin.buffer:
        try:
            answer: Decoded | str = _decoded(Path(os.fsdecode(bytes.fromhex(line.decode()))))
        except BaseException as error:  # native code panics with exceptions of its own kinds
            answer = f"{type(error).__name__}: {error}"
        data = pickle.dumps(answer, protocol=5)
        answers.write(_LENGTH.pack(len(data)))
        answers.write(data)
        answers.flush()


if __name__ == "__main__":
    # under its own name, so that what it pickles is known by that name
    from workcell.record.read import child

    child._serve()
