"""JSON files written whole or not at all."""

from __future__ import annotations

import errno
import json
import math
import os
import stat
import tempfile
from collections.abc import Mapping
from pathlib import Path
from typing import Any

from workcell.errors import OutputError

MOST_NESTED = 16
"""Levels of lists and objects in what is read strictly."""


def to_json(values: Mapping[str, Any]) -> str:
    """JSON text of a dictionary: numpy arrays become lists, NaN and infinities null, paths text."""
    return json.dumps(plain(values), indent=2, allow_nan=False) + "\n"


def write_json_atomic(path: str | Path, values: Mapping[str, Any]) -> Path:
    """Writes a JSON file; a reader sees the old one or the new one, never half of one.

    Raises:
        OutputError: the folder or the file can't be written, or the disk is full; an earlier file is intact.
    """
    path, text = Path(path), to_json(values)
    temporary: str | None = None
    try:
        target = replaceable(path)
        target.parent.mkdir(parents=True, exist_ok=True)
        handle, temporary = tempfile.mkstemp(dir=target.parent, prefix=f".{target.name}.", suffix=".tmp")
        with os.fdopen(handle, "w", encoding="utf-8") as file:
            os.fchmod(file.fileno(), 0o666 & ~_umask())
            file.write(text)
            file.flush()
            os.fsync(file.fileno())
        Path(temporary).replace(target)
    except BaseException as error:
        if temporary is not None:
            Path(temporary).unlink(missing_ok=True)
        if not isinstance(error, OSError):
            raise
        raise _not_written(path, error) from None
    return path


def replaceable(path: Path) -> Path:
    """The file that takes the place of `path`: where a link leads, so that the link stays.

    Raises:
        OSError: a folder, a device or a pipe stands there, which a rename would destroy.
    """
    if path.is_dir():
        raise IsADirectoryError(errno.EISDIR, os.strerror(errno.EISDIR))
    if path.exists() and not path.is_file():
        raise OSError(errno.EINVAL, "a device or a pipe stands there, not a plain file")
    return resolved(path) if path.is_symlink() else path


def regular_bytes(path: Path) -> bytes:
    """All bytes of a plain file.

    Raises:
        OSError: it can't be read, or a folder, a device or a pipe stands there, which might never end.
    """
    # opened without waiting, so that a pipe that nobody writes to doesn't hold us up
    flags = os.O_RDONLY | getattr(os, "O_NONBLOCK", 0) | getattr(os, "O_CLOEXEC", 0)
    try:
        handle = os.open(path, flags)
    except ValueError:
        raise OSError(errno.EINVAL, "no file can have this name") from None
    try:
        mode = os.fstat(handle).st_mode
        if stat.S_ISDIR(mode):
            raise IsADirectoryError(errno.EISDIR, os.strerror(errno.EISDIR))
        if not stat.S_ISREG(mode):
            raise OSError(errno.EINVAL, "a device or a pipe stands there, not a plain file")
        with os.fdopen(handle, "rb", closefd=False) as file:
            return file.read()
    finally:
        os.close(handle)


def regular_text(path: Path) -> str:
    """The text of a plain file in UTF-8, without the mark that some editors put first, its lines ended by newlines.

    Raises:
        OSError: as `regular_bytes`. UnicodeDecodeError: it is not such a text.
    """
    return regular_bytes(path).decode("utf-8-sig").replace("\r\n", "\n").replace("\r", "\n")


def resolved(path: Path) -> Path:
    """The absolute path, links followed.

    Raises:
        OSError: its links lead in a circle, or no file can have this name.
    """
    try:
        return path.resolve()
    except ValueError:
        raise OSError(errno.EINVAL, "no file can have this name") from None
    except RuntimeError:
        raise OSError(errno.ELOOP, os.strerror(errno.ELOOP), str(path)) from None


def expanded(path: Path) -> Path:
    """The path with a leading `~` as somebody's home; as it stands where nobody is of that name."""
    try:
        return path.expanduser()
    except RuntimeError:
        return path


def check_writable(path: str | Path) -> None:
    """Raise OutputError now, rather than after the work, when a file can't be written there."""
    path = Path(path)
    try:
        target = replaceable(path)
        target.parent.mkdir(parents=True, exist_ok=True)
        with tempfile.TemporaryFile(dir=target.parent, prefix=f".{target.name}."):
            pass
    except OSError as error:
        raise _not_written(path, error) from None


def parse_json(text: str) -> Any:
    """The value of a JSON text, with no key twice in an object, and nested no deeper than is sane.

    Raises:
        ValueError: it is no such text; `json.JSONDecodeError` where the grammar is broken.
    """
    try:
        value = json.loads(text, object_pairs_hook=_once)
    except json.JSONDecodeError:
        raise
    except RecursionError:
        raise ValueError("is nested too deeply") from None
    except ValueError as error:
        if not str(error).startswith("has the key"):
            raise ValueError("holds a number of too many digits") from None
        raise
    if _deeper(value, MOST_NESTED):
        raise ValueError("is nested too deeply")
    return value


def _once(pairs: list[tuple[str, Any]]) -> dict[str, Any]:
    found = dict(pairs)
    if len(found) != len(pairs):
        names = [name for name, _ in pairs]
        twice = next(name for k, name in enumerate(names) if name in names[:k])
        raise ValueError(f"has the key {ascii(twice)[:60]} twice")
    return found


def _deeper(value: Any, levels: int) -> bool:
    if not isinstance(value, (dict, list)):
        return False
    inner = value.values() if isinstance(value, dict) else value
    return levels == 0 or any(_deeper(item, levels - 1) for item in inner if isinstance(item, (dict, list)))


def _not_written(path: Path, error: OSError) -> OutputError:
    return OutputError(
        f"the file can't be written: {error.strerror or error}",
        where=path,
        remedy="name a file in a folder that is writable and has room",
    )


def _umask() -> int:
    mask = os.umask(0)
    os.umask(mask)
    return mask


def plain(value: Any) -> Any:
    """Plain values that JSON can hold: arrays as lists, NaN and infinities as None, sets sorted, the rest as text."""
    if isinstance(value, Mapping):
        return {str(key): plain(item) for key, item in value.items()}
    if isinstance(value, (list, tuple, set, frozenset)):
        return [plain(item) for item in (sorted(value) if isinstance(value, (set, frozenset)) else value)]
    if hasattr(value, "tolist"):
        return plain(value.tolist())
    if isinstance(value, float):
        return value if math.isfinite(value) else None
    if value is None or isinstance(value, (bool, int, str)):
        return value
    return str(value)
