"""Sphere covers on disk: made once, by content. Results are the same with and without it, and it never fails.

An entry is `covers/KEY.npz` (the arrays, no pickle) beside `covers/KEY.json` (format, key, count, checksum of the
arrays). The key is a hash of all that a cover depends on: the pieces, the overshoot, and the source of this folder.
Entries are written under another name and then renamed; one whose checksum, key or shapes don't fit is reported in
one line and made anew. The folder may be deleted at any time.
"""

from __future__ import annotations

import functools
import hashlib
import json
import logging
import os
import tempfile
from collections.abc import Callable, Sequence
from pathlib import Path

import numpy as np

from workcell.geometry.types import Piece
from workcell.pose import Array, read_only

FORMAT = "workcell sphere cover 1"
"""Of the entries; part of their key."""

FOLDER_VARIABLE = "WORKCELL_CACHE_DIR"
"""Environment variable that names the folder; empty: nothing is read or written."""

_NAMES = ("centre", "radius", "overshoot")
_log = logging.getLogger(__name__)

Arrays = tuple[Array, Array, Array]
"""Centres (m, 3), radii (m,) and overshoots (m,) of a cover, in metres."""


class _DamagedEntryError(Exception):
    """An entry that is not what its name says; the message says how."""


def cached_cover(
    pieces: Sequence[Piece], overshoot: float, make: Callable[[], Arrays], purpose: str = "outer"
) -> Arrays:
    """The cover of these pieces from disk, or else what `make` returns, which is then kept there.

    `overshoot` is whatever number the cover was made for; `purpose` tells what it is a number of.

    A damaged or foreign entry is reported as a warning of this module's logger, and replaced. A folder that can't be
    read or written is the same as none.
    """
    folder = cache_folder()
    if folder is None:
        return make()
    key = content_key(pieces, overshoot, purpose)
    entry = folder / "covers" / f"{key}.json"
    try:
        return _load(entry, key)
    except _DamagedEntryError as damage:
        _log.warning("the cached sphere cover %s is damaged (%s) and is made anew", entry, damage)
    except OSError:
        pass
    arrays = make()
    try:
        _store(entry, key, arrays)
    except OSError as error:
        _log.debug("the sphere cover was not kept in %s: %s", entry.parent, error)
    return arrays


def cache_folder() -> Path | None:
    """WORKCELL_CACHE_DIR, or `workcell` in XDG_CACHE_HOME or `~/.cache`; None where caching is off or has no home."""
    chosen = os.environ.get(FOLDER_VARIABLE)
    if chosen is not None:
        return Path(chosen) if chosen else None
    shared = os.environ.get("XDG_CACHE_HOME", "")
    if Path(shared).is_absolute():
        return Path(shared) / "workcell"
    try:
        return Path.home() / ".cache" / "workcell"
    except RuntimeError:
        return None


def content_key(pieces: Sequence[Piece], overshoot: float, purpose: str = "outer") -> str:
    """Hash of what a cover depends on: kinds, sizes, poses and vertices in their order, overshoot, format, source."""
    digest = hashlib.sha256(f"{FORMAT} {purpose} {_source_digest()} {len(pieces)}".encode())
    digest.update(np.float64(overshoot).tobytes())
    for piece in pieces:
        vertices = np.zeros((0, 3)) if piece.vertices is None else piece.vertices
        digest.update(f"{piece.kind} {len(piece.size)} {len(vertices)}".encode())
        for values in (piece.size, piece.pose.position, piece.pose.quat_wxyz, vertices):
            digest.update(np.ascontiguousarray(values, dtype=np.float64).tobytes())
    return digest.hexdigest()


@functools.cache
def _source_digest() -> str:
    """Hash of the modules that covers are made by, so that a cover made by other code is never taken for this one's."""
    digest, here = hashlib.sha256(), Path(__file__).parent
    for path in (*sorted(here.glob("*.py")), *sorted(here.parent.glob("*.py"))):
        digest.update(path.name.encode() + path.read_bytes())
    return digest.hexdigest()


def _load(entry: Path, key: str) -> Arrays:
    """Raises OSError where there is no entry, _DamagedEntryError where there is a wrong one."""
    text = entry.read_bytes()
    try:
        note = json.loads(text)
    except ValueError:
        raise _DamagedEntryError("its note is not JSON") from None
    if not isinstance(note, dict) or note.get("format") != FORMAT or note.get("key") != key:
        raise _DamagedEntryError("it belongs to something else")
    try:
        with np.load(entry.with_suffix(".npz"), allow_pickle=False) as file:
            centre, radius, overshoot = (file[name] for name in _NAMES)
    except FileNotFoundError:
        raise _DamagedEntryError("its arrays are missing") from None
    except OSError:
        raise
    except Exception:  # bytes that are no archive of arrays can fail in any way
        raise _DamagedEntryError("its arrays can't be read") from None
    arrays = centre, radius, overshoot
    shapes = [(radius.size, 3), (radius.size,), (radius.size,)]
    if any(a.dtype != np.float64 or a.shape != shape for a, shape in zip(arrays, shapes, strict=True)):
        raise _DamagedEntryError("its arrays have wrong shapes")
    if note.get("sha256") != _checksum(arrays):
        raise _DamagedEntryError("its checksum does not fit")
    return read_only(centre), read_only(radius), read_only(overshoot)


def _store(entry: Path, key: str, arrays: Arrays) -> None:
    """Arrays first, then the note that says that they are there. Raises OSError."""
    entry.parent.mkdir(parents=True, exist_ok=True)
    note = {"format": FORMAT, "key": key, "spheres": len(arrays[1]), "sha256": _checksum(arrays)}
    centre, radius, overshoot = arrays
    _write(
        entry.with_suffix(".npz"),
        lambda file: np.savez(file, centre=centre, radius=radius, overshoot=overshoot),
    )
    _write(entry, lambda file: file.write(json.dumps(note, indent=2).encode() + b"\n"))


def _write(path: Path, fill: Callable[[tempfile._TemporaryFileWrapper[bytes]], object]) -> None:
    file = tempfile.NamedTemporaryFile(dir=path.parent, prefix=f".{path.name}.", delete=False)  # noqa: SIM115
    try:
        with file:
            fill(file)
        Path(file.name).replace(path)
    except BaseException:
        Path(file.name).unlink(missing_ok=True)
        raise


def _checksum(arrays: Arrays) -> str:
    digest = hashlib.sha256()
    for array in arrays:
        digest.update(f"{array.shape}".encode() + np.ascontiguousarray(array).tobytes())
    return digest.hexdigest()
