"""Writing `.rrd` files with Rerun.

The only place, with `reader.py`, that knows its archetypes and its xyzw order.
"""

from __future__ import annotations

import os
import uuid
import warnings
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from workcell.errors import OutputError
from workcell.pose import Array, Pose, to_xyzw
from workcell.record.shapes import Shape
from workcell.record.write import seal
from workcell.record.write.archetypes import archetype_of, colour_bytes
from workcell.record.write.rrd_frames import DATA, STORE_INFO, split_frames, with_block

APPLICATION = "workcell"
TIME, STEP, SOLVER_STEP = "sim_time", "step", "solver_step"


def rerun() -> Any:
    """The rerun module, told to leave error messages to us."""
    os.environ.setdefault("RUST_LOG", "off")
    import rerun as rr

    return rr


def entity(*parts: str) -> str:
    """An entity path of names, each escaped, so that a name with a slash or a space stays one part."""
    rr = rerun()
    return "/".join(rr.escape_entity_path_part(part) for part in parts)


def frame_of(path: str) -> str:
    """The name that Rerun gives the coordinate frame of an entity."""
    return f"tf#/{path}"


@contextmanager
def writing(path: Path) -> Iterator[None]:
    """Turns the operating system's refusals into an OutputError that names the file."""
    try:
        yield
    except OSError as error:
        raise OutputError(
            f"the recording can't be written: {error.strerror or error}",
            where=path,
            remedy="choose a folder that is writable and has room, with --out",
        ) from None


class RrdWriter:
    """One open `.rrd` file. Everything logged before a `flush` is on disk after it.

    Rerun encodes and this class writes, so that a disk that is full is noticed at once and by name. Until `finish`
    the file has no index: it is readable to the last flush, whatever becomes of the process. Each flush ends with a
    seal (see `seal.py`), and so does the finished file.

    Args:
        path: the file; an existing one is replaced.

    Raises:
        OutputError: by `__init__`, `flush` and `finish`, when the file can't be written.
    """

    def __init__(self, path: Path) -> None:
        rr = rerun()
        self.path, self._rr = path, rr
        self._recording_id = str(uuid.uuid4())
        self._stream = rr.RecordingStream(APPLICATION, recording_id=self._recording_id)
        self._stream.set_log_time_enabled(False)
        self._stream.set_log_tick_enabled(False)
        self._encoded = self._stream.binary_stream()
        self._blueprint: Any = None
        self._announced: set[bytes] = set()
        self._chain: seal.Chain | None = None
        with writing(path):
            self._file = path.open("wb", buffering=0)

    def send_blueprint(self, blueprint: Any) -> None:
        """How the viewer is to show the recording."""
        self._blueprint = blueprint
        self._stream.send_blueprint(blueprint, make_active=True, make_default=True)

    def flush(self) -> None:
        """Hands everything logged so far to the operating system."""
        part = split_frames(self._encoded.read(flush=True) or b"")
        if not part.frames:
            return
        pieces = []
        if self._chain is None:
            self._chain = seal.Chain.begin(part.header)
            pieces.append(part.header)
        blocks = [frame for kind, frame in part.frames if self._is_news(kind, frame)]
        if blocks:
            for block in blocks:
                self._chain.add(block)
            pieces += [*blocks, self._chain.sealed(lambda text: _sealing(self._stream, self._encoded, text))]
        self._write(b"".join(pieces))

    def _is_news(self, kind: int, frame: bytes) -> bool:
        """Every part says again what it belongs to."""
        known = kind == STORE_INFO and frame in self._announced
        if kind == STORE_INFO:
            self._announced.add(frame)
        return not known

    def _write(self, data: bytes) -> None:
        with writing(self.path):
            view = memoryview(data)
            while view:
                view = view[self._file.write(view) or 0 :]

    def finish(self, path: Path) -> None:
        """Writes the whole recording, its rows gathered into few blocks and with an index, to `path` at once."""
        self.flush()
        data = self._gathered()
        with writing(path):
            self._file.close()
            temporary = path.with_name(f".{path.name}.tmp")
            try:
                with temporary.open("wb") as file:
                    file.write(data)
                    file.flush()
                    os.fsync(file.fileno())
                temporary.replace(path)
            finally:
                temporary.unlink(missing_ok=True)
            if path != self.path:
                self.path.unlink()

    def _gathered(self) -> bytes:
        from rerun.chunk import RrdReader

        with warnings.catch_warnings():
            warnings.simplefilter("ignore")  # a file without an index is called a legacy file
            chunks = RrdReader(self.path).stream().collect().stream().to_chunks()
        chunks = [chunk for chunk in chunks if chunk.entity_path.strip("/") != seal.ENTITY]
        stream = self._rr.RecordingStream(APPLICATION, recording_id=self._recording_id, send_properties=False)
        encoded = stream.binary_stream()
        if self._blueprint is not None:
            stream.send_blueprint(self._blueprint, make_active=True, make_default=True)
        stream.send_chunks(chunks)
        data: bytes = encoded.read(flush=True)
        whole = split_frames(data)
        chain = seal.Chain.begin(whole.header)
        for _, block in whole.frames:
            chain.add(block)
        rows: dict[str, int] = {}
        for chunk in chunks:
            if not chunk.is_static:
                path = chunk.entity_path.strip("/")
                rows[path] = rows.get(path, 0) + chunk.num_rows
        index = seal.digest(whole.index_alone)
        block = chain.sealed(lambda text: _sealing(stream, encoded, text), index=index, rows=rows)
        stream.disconnect()
        return with_block(data, block)

    def log(self, path: str, *archetypes: Any) -> None:
        """Static data: true at all times."""
        self._stream.log(path, *archetypes, static=True)

    def log_pose(self, path: str, pose: Pose, carrier: str | None = None) -> None:
        """A transform from the entity to its parent, or to the entity `carrier`, that never changes."""
        self.log(path, self._transform(pose, carrier))

    def _transform(self, pose: Pose, carrier: str | None) -> Any:
        frame = None if carrier is None else frame_of(carrier)
        quaternion = to_xyzw(pose.quat_wxyz)
        return self._rr.Transform3D(translation=pose.position, quaternion=quaternion, parent_frame=frame)

    def log_shape(self, path: str, shape: Shape, carrier: str | None = None) -> None:
        """A solid, with its place in the parent entity or in `carrier`."""
        self.log(path, self._transform(shape.pose, carrier), archetype_of(self._rr, shape))

    def log_spheres(
        self, path: str, centres: Array, radii: Array, rgba: Sequence[float], carrier: str
    ) -> None:
        """Spheres (m, 3), (m,) in the frame of the entity `carrier`, which they follow."""
        self.log(path, self._rr.CoordinateFrame(frame_of(carrier)))
        half = np.repeat(np.asarray(radii, dtype=float)[:, None], 3, axis=1)
        colour = colour_bytes(rgba)
        fill = self._rr.components.FillMode.TransparentFillMajorWireframe
        self.log(
            path,
            self._rr.Ellipsoids3D(
                half_sizes=half, centers=centres, colors=[colour] * len(half), fill_mode=fill
            ),
        )

    def log_box(self, path: str, lower: Array, upper: Array, rgba: Sequence[float]) -> None:
        """One translucent axis-aligned box."""
        fill = self._rr.components.FillMode.TransparentFillMajorWireframe
        boxes = self._rr.Boxes3D(
            half_sizes=[(upper - lower) / 2],
            centers=[(upper + lower) / 2],
            colors=[colour_bytes(rgba)],
            fill_mode=fill,
        )
        self.log(path, boxes)

    def log_frame(self, path: str, pose: Pose, length: float, label: str) -> None:
        """Coordinate axes with a name beside them."""
        self.log_pose(path, pose)
        self.log(path, self._rr.TransformAxes3D(length))
        point = self._rr.Points3D(
            [[0, 0, 0]], radii=[length / 8], colors=[colour_bytes(GOAL_RGBA)], labels=[label]
        )
        self.log(path, point)

    def log_axes(self, path: str, length: float) -> None:
        """Coordinate axes at an entity whose transform is sent apart."""
        self.log(path, self._rr.TransformAxes3D(length))

    def log_strip(self, path: str, points: Array, rgba: Sequence[float], radius: float) -> None:
        """A line through points (k, 3)."""
        self.log(path, self._rr.LineStrips3D([points], colors=[colour_bytes(rgba)], radii=[radius]))

    def log_document(self, path: str, text: str, media_type: str = "application/json") -> None:
        """A text document."""
        self.log(path, self._rr.TextDocument(text, media_type=media_type))

    def log_property(self, name: str, values: dict[str, Any]) -> None:
        """Properties of the recording, which the viewer lists beside its name."""
        plain = {key: _encodable(value) if isinstance(value, str) else value for key, value in values.items()}
        self._stream.send_property(name, self._rr.AnyValues(**plain))

    def name_series(self, path: str, names: Sequence[str]) -> None:
        """Names of the lines that `send_scalars` draws."""
        self.log(path, self._rr.SeriesLines(names=list(names)))

    def send_poses(self, path: str, indexes: Indexes, positions: Array, quats_wxyz: Array) -> None:
        """Transforms (T, 3), (T, 4) of an entity over time."""
        columns = self._rr.Transform3D.columns(translation=positions, quaternion=to_xyzw(quats_wxyz))
        self._send(path, indexes, columns)

    def send_scalars(self, path: str, indexes: Indexes, values: Array) -> None:
        """One or more numbers over time: (T,) or (T, k)."""
        self._send(path, indexes, self._rr.Scalars.columns(scalars=values))

    def send_segments(self, path: str, indexes: Indexes, starts: Array, ends: Array) -> None:
        """One line segment for each time: (T, 3) and (T, 3)."""
        strips = np.stack([starts, ends], axis=1)
        self._send(path, indexes, self._rr.LineStrips3D.columns(strips=strips))

    def log_line_style(self, path: str, rgba: Sequence[float], radius: float) -> None:
        """Colour and thickness of the segments that `send_segments` draws."""
        self.log(path, self._rr.LineStrips3D.from_fields(colors=[colour_bytes(rgba)], radii=[radius]))

    def log_text(self, path: str, time: float, step: int, text: str, level: str) -> None:
        """One line of the event log."""
        self._stream.set_time(TIME, duration=time)
        self._stream.set_time(STEP, sequence=step)
        self._stream.log(path, self._rr.TextLog(_encodable(text), level=level))
        self._stream.reset_time()

    def log_box_style(self, path: str, rgba: Sequence[float], radius: float) -> None:
        """Colour and thickness of the edges of the boxes that `send_boxes` draws, and of the lines of `send_strips`."""
        edges = self._rr.components.FillMode.MajorWireframe
        style = self._rr.Boxes3D.from_fields(colors=[colour_bytes(rgba)], radii=[radius], fill_mode=edges)
        self.log(path, style)
        self.log_line_style(path, rgba, radius)

    def log_numbers(self, path: str, **values: int) -> None:
        """Numbers that no view draws, by name."""
        self.log(path, self._rr.AnyValues(**values))

    def send_boxes(
        self, path: str, indexes: Indexes, boxes: Sequence[tuple[Array, Array, list[str]]]
    ) -> None:
        """For each time some boxes, in place of those before: lower corners (k, 3), upper corners (k, 3), k labels."""
        lower, upper = (np.concatenate([row[side] for row in boxes]).reshape(-1, 3) for side in (0, 1))
        labels = [label for row in boxes for label in row[2]]
        columns = self._rr.Boxes3D.columns(
            half_sizes=(upper - lower) / 2, centers=(upper + lower) / 2, labels=labels
        )
        self._send(path, indexes, columns.partition([len(row[2]) for row in boxes]))

    def send_strips(self, path: str, indexes: Indexes, rows: Sequence[Sequence[tuple[Array, str]]]) -> None:
        """For each time some lines through points (k, 3) with labels, in place of those before."""
        lines, labels = [line for row in rows for line, _ in row], [label for row in rows for _, label in row]
        columns = self._rr.LineStrips3D.columns(strips=lines, labels=labels)
        self._send(path, indexes, columns.partition([len(row) for row in rows]))

    def send_lists(self, path: str, indexes: Indexes, **values: Sequence[Sequence[int]]) -> None:
        """Whole numbers over time, as many as it may be, that no view draws, by name."""
        for name, rows in values.items():
            flat = np.array([value for row in rows for value in row], dtype=np.int64)
            columns = self._rr.AnyValues.columns(**{name: flat})
            self._send(path, indexes, columns.partition([len(row) for row in rows]))

    def send_numbers(self, path: str, indexes: Indexes, **values: Sequence[int]) -> None:
        """Numbers over time that no view draws, by name."""
        self._send(path, indexes, self._rr.AnyValues.columns(**values))

    def send_texts(self, path: str, indexes: Indexes, texts: Sequence[str], level: str) -> None:
        """Lines of a log."""
        self._send(path, indexes, self._rr.TextLog.columns(text=texts, level=[level] * len(texts)))

    def send_documents(self, path: str, indexes: Indexes, texts: Sequence[str]) -> None:
        """JSON documents, each at its time."""
        kinds = ["application/json"] * len(texts)
        self._send(path, indexes, self._rr.TextDocument.columns(text=texts, media_type=kinds))

    def _send(self, path: str, indexes: Indexes, columns: Any) -> None:
        rr = self._rr
        index = [rr.TimeColumn(TIME, duration=indexes[0]), rr.TimeColumn(STEP, sequence=indexes[1])]
        if len(indexes) == 3:
            index.append(rr.TimeColumn(SOLVER_STEP, sequence=indexes[2]))
        self._stream.send_columns(path, indexes=index, columns=columns)


def _encodable(text: str) -> str:
    """The text with halves of characters, which no file can hold, as escapes."""
    return text.encode("utf-8", "backslashreplace").decode("utf-8")


def _sealing(stream: Any, encoded: Any, text: str) -> bytes:
    """The one block of a text document at the entity of seals."""
    stream.log(seal.ENTITY, rerun().TextDocument(text, media_type="application/json"), static=True)
    part = split_frames(encoded.read(flush=True) or b"")
    blocks = [frame for kind, frame in part.frames if kind == DATA]
    assert len(blocks) == 1
    return blocks[0]


Indexes = tuple[Array, NDArray[np.int64]] | tuple[Array, NDArray[np.int64], NDArray[np.int64]]
"""Simulated seconds (T,) and step numbers (T,) of rows, and for what solvers tell the numbers (T,) of their stages."""

GOAL_RGBA = (0.95, 0.35, 0.10, 1.0)
