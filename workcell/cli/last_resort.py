"""What nobody foresaw: one message, the details in a file, and a way to report it."""

from __future__ import annotations

import platform
import sys
import tempfile
import traceback
from collections.abc import Sequence
from importlib.metadata import PackageNotFoundError, version

_PACKAGES = ("workcell", "mujoco", "numpy", "numba", "clarabel", "rerun-sdk")


def unforeseen(error: BaseException, arguments: Sequence[str]) -> str:
    """The message about an error that no code expected; writes the traceback into a file of its own."""
    said = " ".join(f"{type(error).__name__}: {error}".split())
    short = said if len(said) <= 300 else f"{said[:297]}..."
    try:
        with tempfile.NamedTemporaryFile(
            "w",
            prefix="workcell-error-",
            suffix=".txt",
            delete=False,
            encoding="utf-8",
            errors="backslashreplace",
        ) as file:
            file.write(_report(error, arguments))
        place = f"the details are in {file.name}; please report it with that file"
    except OSError:
        place = "please report it, with the command"
    return f"this should not have happened ({short}): {place}"


def _report(error: BaseException, arguments: Sequence[str]) -> str:
    lines = [f"workcell {' '.join(map(repr, arguments))}", f"Python {sys.version}", platform.platform()]
    for name in _PACKAGES:
        try:
            lines.append(f"{name} {version(name)}")
        except PackageNotFoundError:
            lines.append(f"{name} is not installed")
    return "\n".join([*lines, "", *traceback.format_exception(error)])
