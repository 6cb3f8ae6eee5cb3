"""Reading an `.rrd` file back from the file alone, damaged ones as far as they go."""

from __future__ import annotations

import tempfile
import warnings
from collections.abc import Iterator
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from workcell.errors import RecordingError
from workcell.pose import Array
from workcell.record.write.rrd import TIME, rerun
from workcell.record.write.rrd_frames import DATA, MAGIC, STORE_INFO, split_frames


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
        """Times (T,) and values (T, ...) of a component whose rows all have one length."""
        pieces = self._pieces.get(component, [])
        if not pieces:
            return np.zeros(0), np.zeros((0, 1))
        times = np.concatenate([piece[0] for piece in pieces])
        columns = [np.asarray(_plain(piece[1].flatten())) for piece in pieces]
        values = np.concatenate([c.reshape(len(p[0]), -1) for c, p in zip(columns, pieces, strict=True)])
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
        missing: what could not be read, in words; empty for a whole file.
    """

    path: Path
    version: str
    application: str
    entities: dict[str, Entity]
    has_blueprint: bool
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
        data = path.read_bytes()
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
    missing: list[str] = []
    try:
        store, blueprint, chunks = _read_whole(path)
    except Exception:  # every damage surfaces as another exception of the reader's native code
        store, blueprint, chunks = _salvage(data, missing)
    if store is None:
        raise RecordingError(
            "nothing in this recording can be read: " + ("; ".join(missing) or "it holds no data"),
            where=path,
            remedy=f"it was written by Rerun {version}, this is Rerun {rerun().__version__}; record the run again",
        )
    if not split_frames(data).indexed:
        missing.insert(
            0,
            "the file was not finished: the run was stopped before it closed its recording, or the end is cut off",
        )
    entities: dict[str, Entity] = {}
    for chunk in chunks:
        _add(entities, chunk)
    return Contents(path, version, store, entities, blueprint, tuple(missing))


def _read_whole(path: Path) -> tuple[str | None, bool, list[Any]]:
    """(application, has a blueprint, chunks), all of them, or an exception."""
    rerun()
    from rerun.chunk import RrdReader

    with warnings.catch_warnings():
        warnings.simplefilter("ignore")  # a file without an index is called a legacy file
        reader = RrdReader(path)
        stores = reader.recordings()
        if not stores:
            return None, False, []
        batches = [(chunk, chunk.to_record_batch()) for chunk in reader.stream(store=stores[0])]
        return stores[0].application_id, bool(reader.blueprints()), batches


def _salvage(data: bytes, missing: list[str]) -> tuple[str | None, bool, list[Any]]:
    """What the whole frames of a damaged file hold."""
    whole = split_frames(data)
    if whole.rest:
        missing.append(f"the last {whole.rest} of {len(data)} bytes are cut off or damaged")
    head = whole.header + b"".join(frame for kind, frame in whole.frames if kind == STORE_INFO)
    bodies = [frame for kind, frame in whole.frames if kind == DATA]
    with tempfile.TemporaryDirectory() as folder:
        scratch = Path(folder) / "part.rrd"
        parts = list(_readable_parts(scratch, head, bodies))
    damaged = sum(count for count, part in parts if part is None)
    if damaged:
        missing.append(f"{damaged} of {len(bodies)} blocks of data are damaged")
    good = [part for _, part in parts if part is not None]
    chunks = [chunk for part in good for chunk in part[2]]
    application = next((part[0] for part in good if part[0] is not None), None)
    return (application if chunks else None), any(part[1] for part in good), chunks


def _readable_parts(scratch: Path, head: bytes, bodies: list[bytes]) -> Iterator[tuple[int, Any]]:
    """Reads blocks together; where that fails, each half apart. Yields (blocks, what they hold or None)."""
    if not bodies:
        return
    scratch.write_bytes(head + b"".join(bodies))
    try:
        yield len(bodies), _read_whole(scratch)
        return
    except Exception:
        if len(bodies) == 1:
            yield 1, None
            return
    middle = len(bodies) // 2
    yield from _readable_parts(scratch, head, bodies[:middle])
    yield from _readable_parts(scratch, head, bodies[middle:])


def _add(entities: dict[str, Entity], chunk: Any) -> None:
    header, batch = chunk
    entity = entities.setdefault(header.entity_path.strip("/"), Entity())
    times = None
    if not header.is_static:
        if TIME not in batch.schema.names:
            return
        times = batch.column(TIME).cast("int64").to_numpy(zero_copy_only=False) / 1e9
    indexes = {*header.timeline_names, "rerun.controls.RowId"}
    for name in batch.schema.names:
        if name not in indexes:
            entity.add(name, times, batch.column(name))


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
