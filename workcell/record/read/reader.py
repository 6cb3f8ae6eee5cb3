"""Reading an `.rrd` file back from the file alone, damaged ones as far as they go."""

from __future__ import annotations

import tempfile
from collections.abc import Iterator
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from workcell.errors import RecordingError
from workcell.files import regular_bytes
from workcell.pose import Array
from workcell.record.read.child import Decoded, UnreadableError, decode
from workcell.record.read.vouched import Vouched, may_be_seal, vouched
from workcell.record.write import seal
from workcell.record.write.rrd_frames import DATA, MAGIC, STORE_INFO, Frames, split_frames


@dataclass(slots=True)
class Entity:
    """What one entity path holds, by component (`Transform3D:translation`): the static row, and rows over time."""

    static: dict[str, Any] = field(default_factory=dict)
    _pieces: dict[str, list[tuple[Array, Any]]] = field(default_factory=dict)

    def add(self, component: str, times: Array | None, column: Any) -> None:
        """One Arrow column of a chunk; `times` is None for static data."""
        kept = column.is_valid().to_numpy(zero_copy_only=False)
        if not kept.any():
            return
        if times is None:
            self.static[component] = _plain(column[int(np.flatnonzero(kept)[-1])].values)
        else:
            self._pieces.setdefault(component, []).append((times[kept], column.drop_null()))

    def components(self) -> list[str]:
        """Names of everything the entity holds."""
        return sorted({*self.static, *self._pieces})

    def has(self, component: str) -> bool:
        """Whether the component changes over time."""
        return component in self._pieces

    def rows(self) -> int:
        """Rows over time of the component that has most."""
        return max((sum(len(times) for times, _ in pieces) for pieces in self._pieces.values()), default=0)

    def over_time(self, component: str) -> tuple[Array, list[Any]]:
        """Times (T,) in order and the value of each row."""
        times, values = self._sorted(component)
        return times, [_plain(value.values) for value in values]

    def numbers(self, component: str) -> tuple[Array, NDArray[Any]]:
        """Times (T,) and values (T, k) of a component of numbers; rows that are shorter than others end with nan."""
        pieces = self._pieces.get(component, [])
        if not pieces:
            return np.zeros(0), np.zeros((0, 1))
        times = np.concatenate([piece[0] for piece in pieces])
        rows = [_rows(column) for _, column in pieces]
        width = max(row.shape[1] for row in rows)
        values = np.concatenate([_widened(row, width) for row in rows])
        order = np.argsort(times, kind="stable")
        return times[order], values[order]

    def _sorted(self, component: str) -> tuple[Array, list[Any]]:
        pieces = self._pieces.get(component, [])
        if not pieces:
            return np.zeros(0), []
        times = np.concatenate([piece[0] for piece in pieces])
        values = [value for _, column in pieces for value in column]
        order = np.argsort(times, kind="stable")
        return times[order], [values[k] for k in order]


@dataclass(frozen=True, slots=True)
class Contents:
    """Everything in a recording.

    Attributes:
        path: the file.
        version: of Rerun that wrote it, `0.41.0`.
        application: who wrote it; ours is `workcell`.
        entities: by path without the leading slash.
        has_blueprint: whether the file says how to show itself.
        sealed: whether seals in the file vouch for it, but for what is missing; older recordings have none.
        missing: what could not be read, in words; empty for a whole file.
    """

    path: Path
    version: str
    application: str
    entities: dict[str, Entity]
    has_blueprint: bool
    sealed: bool
    missing: tuple[str, ...]

    def below(self, prefix: str) -> dict[str, Entity]:
        """Entities at or below a path."""
        return {p: e for p, e in self.entities.items() if p == prefix or p.startswith(prefix + "/")}


def read(path: str | Path) -> Contents:
    """Reads a recording.

    Raises:
        RecordingError: there is no such file, it is not an `.rrd`, or nothing in it can be read.
    """
    path = Path(path)
    try:
        data = regular_bytes(path)
    except OSError as error:
        raise RecordingError(
            f"the recording can't be opened: {error.strerror}",
            where=path,
            remedy="give the path of an .rrd file",
        ) from None
    if data[:4] != MAGIC:
        start = "an empty file" if not data else f"it starts with {data[:4]!r} instead of {MAGIC!r}"
        raise RecordingError(
            f"this is not an .rrd recording: {start}", where=path, remedy="give the path of an .rrd file"
        )
    version = ".".join(str(byte) for byte in data[4:7]) if len(data) > 6 else "of an unknown version"
    whole = split_frames(data)
    with tempfile.TemporaryDirectory() as folder:
        found, said = _found(path, Path(folder) / "part.rrd", whole)
    parts = [part for _, part in found if part is not None]
    missing = [*said.damage, *_lost(found, whole, len(data))]
    application = next((part.application for part in parts if part.application is not None), None)
    if application is None or not any(part.pieces for part in parts):
        raise RecordingError(
            "nothing in this recording can be read: " + ("; ".join(missing) or "it holds no data"),
            where=path,
            remedy=f"it was written by Rerun {version}, this is Rerun {rerun_version()}; record the run again",
        )
    if not whole.indexed:
        missing.insert(
            0,
            "the file was not finished: the run was stopped before it closed its recording, or the end is cut off",
        )
    entities: dict[str, Entity] = {}
    counts: dict[str, int] = {}
    for piece in (piece for part in parts for piece in part.pieces if piece.path != seal.ENTITY):
        entity = entities.setdefault(piece.path, Entity())
        for name, column in piece.columns.items():
            entity.add(name, piece.times, column)
        if piece.times is not None:
            counts[piece.path] = counts.get(piece.path, 0) + len(piece.times)
    missing += [
        f"{rows - counts.get(entity, 0)} of {rows} rows of {entity}"
        for entity, rows in said.rows.items()
        if counts.get(entity, 0) != rows
    ]
    if said.sealed and said.unknown:
        missing.append(f"no seal vouches for {len(said.unknown)} of its blocks")
    blueprint = any(part.has_blueprint for part in parts)
    return Contents(path, version, application, entities, blueprint, said.sealed, tuple(missing))


def rerun_version() -> str:
    """The version of Rerun that reads."""
    from importlib.metadata import version

    return version("rerun-sdk")


Found = list[tuple[int, Decoded | None]]
"""Numbers of blocks, and what they hold, or None where they can't be read."""


def _found(path: Path, scratch: Path, whole: Frames) -> tuple[Found, Vouched]:
    """What can be read of a file, and what its seals say of it.

    Blocks that are not as they were written are not shown to Rerun at all, where seals tell.
    """
    said = vouched(whole, _seal_texts(scratch, whole))
    try:
        if not said.sealed or (said.finished and not said.damage):
            return [(len(whole.frames), decode(path))], said
    except UnreadableError:
        pass
    found: Found = []
    head = _head(whole)
    for blocks in (said.good, said.unknown):
        found += _readable(scratch, head, [frame for kind, frame in blocks if kind == DATA])
    return found, said


def _head(whole: Frames) -> bytes:
    """What says whose the blocks are: at the beginning, so that what was added later takes nothing over."""
    first = next((k for k, (kind, _) in enumerate(whole.frames) if kind == DATA), 0)
    stores = [frame for kind, frame in whole.frames[:first] if kind == STORE_INFO]
    return whole.header + b"".join(stores or [frame for kind, frame in whole.frames if kind == STORE_INFO])


def _seal_texts(scratch: Path, whole: Frames) -> list[str | None]:
    """The texts of the blocks that may be seals, None for those that can't be read."""
    head = _head(whole)
    blocks = [block for block in whole.frames if may_be_seal(block)]
    together = _texts(scratch, head + b"".join(frame for _, frame in blocks))
    if len(together) == len(blocks):
        return together
    apart = [_texts(scratch, head + frame) for _, frame in blocks]
    return [texts[0] if len(texts) == 1 else None for texts in apart]


def _texts(scratch: Path, data: bytes) -> list[str | None]:
    scratch.write_bytes(data)
    try:
        pieces = decode(scratch).pieces
    except UnreadableError:
        return []
    columns = [piece.columns.get("TextDocument:text") for piece in pieces]
    return [str(column[0][0]) if column is not None and len(column) == 1 else None for column in columns]


def _readable(scratch: Path, head: bytes, bodies: list[bytes]) -> Iterator[tuple[int, Decoded | None]]:
    """Reads blocks together; where that fails, each half apart."""
    if not bodies:
        return
    scratch.write_bytes(head + b"".join(bodies))
    try:
        yield len(bodies), decode(scratch)
        return
    except UnreadableError:
        if len(bodies) == 1:
            yield 1, None
            return
    middle = len(bodies) // 2
    yield from _readable(scratch, head, bodies[:middle])
    yield from _readable(scratch, head, bodies[middle:])


def _lost(found: Found, whole: Frames, size: int) -> list[str]:
    """What Rerun's reader could make nothing of, in words."""
    words = [f"the last {whole.rest} of {size} bytes are cut off or damaged"] if whole.rest else []
    lost, all_of_them = sum(count for count, part in found if part is None), sum(count for count, _ in found)
    return [*words, f"{lost} of {all_of_them} blocks of data are damaged"] if lost else words


def _rows(column: Any) -> NDArray[Any]:
    """A column of lists as rows (T, k)."""
    flat, lengths = np.asarray(_plain(column.flatten())), column.value_lengths().to_numpy()
    longest = int(lengths.max(initial=0))
    if np.all(lengths == longest):
        return flat.reshape(len(lengths), -1)
    rows = np.full((len(lengths), longest, *flat.shape[1:]), np.nan)
    rows[np.arange(longest) < lengths[:, None]] = flat
    return rows.reshape(len(lengths), -1)


def _widened(rows: NDArray[Any], width: int) -> NDArray[Any]:
    """Rows (T, k) with nan behind them."""
    if rows.shape[1] == width:
        return rows
    return np.hstack([rows, np.full((len(rows), width - rows.shape[1]), np.nan)])


def _plain(array: Any) -> Any:
    """An Arrow array as numpy, shaped by its fixed-size lists; variable lists and text as Python lists."""
    import pyarrow as pa

    kind = array.type
    if pa.types.is_fixed_size_list(kind):
        return np.asarray(_plain(array.flatten())).reshape(len(array), kind.list_size)
    if pa.types.is_list(kind):
        return [_plain(item.values) for item in array]
    if pa.types.is_string(kind) or pa.types.is_large_string(kind):
        return array.to_pylist()
    return array.to_numpy(zero_copy_only=False)
