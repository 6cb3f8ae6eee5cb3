"""How kernels are compiled. Importing this module imports numba: only modules of kernels do so, and they are imported
when first used.

numba compiles on the first call and caches to disk: in `__pycache__` beside the sources, or in the user's cache folder
where that is read-only; `NUMBA_CACHE_DIR` overrides both.
"""

from __future__ import annotations

import functools
import re
import sys
from collections.abc import Callable
from pathlib import Path
from typing import Any, TypeVar

from numba import njit
from numba.core import event

Function = TypeVar("Function", bound=Callable[..., object])

# Everything but "no NaN, no infinity": a step that breaks down must be seen as one.
_FAST = {"contract", "reassoc", "nsz", "arcp"}
_ENTRY = {"nogil": True}
_INNER = {"no_cpython_wrapper": True, "no_cfunc_wrapper": True}
_PACKAGE = Path(__file__).parent
_IMPORT = re.compile(r"^(?:from|import) workcell\.([\w.]+)", re.MULTILINE)


class _Clock(event.TimingListener):  # type: ignore[misc]
    """Adds up what numba spends on compiling, nested calls once; says so when it begins for the first time."""

    announce: Callable[[], object] | None = None

    def on_start(self, started: Any) -> None:
        announce, self.announce = self.announce, None
        if announce is not None:
            announce()
        super().on_start(started)


_clock = _Clock()
event.register("numba:compile", _clock)


def compile_seconds() -> float:
    """Wall seconds that this process has spent on compiling kernels so far; loading them from the cache is none of it."""
    return float(_clock.duration) if _clock.done else 0.0


def announce_compiling(announce: Callable[[], object] | None) -> None:
    """Call `announce` once, when something is compiled next; None: no more."""
    _clock.announce = announce


def kernel(function: Function) -> Function:
    """Compile an entry point on first use, cached on disk, without the interpreter's lock."""
    compiled: Function = _compiled(function, fastmath=_FAST, **_ENTRY)
    return compiled


def inner(function: Function) -> Function:
    """Compile what only other kernels call: without the wrappers for Python and C, which cost compile time."""
    compiled: Function = _compiled(function, fastmath=_FAST, **_INNER)
    return compiled


def exact_kernel(function: Function) -> Function:
    """`kernel` whose operations stay as they are written: for bounds that are proofs."""
    compiled: Function = _compiled(function, **_ENTRY)
    return compiled


def exact_inner(function: Function) -> Function:
    """`inner` whose operations stay as they are written."""
    compiled: Function = _compiled(function, **_INNER)
    return compiled


def _compiled(function: Any, **options: object) -> Any:
    options_for_all = {"error_model": "numpy", **options}
    try:
        return _stamped(njit(cache=True, **options_for_all)(function), function.__module__)
    except RuntimeError:
        # Neither the package's folder nor the user's cache can be written to: compile in every process.
        return njit(**options_for_all)(function)


def _stamped(compiled: Any, module: str) -> Any:
    """Let a cached kernel go stale with every module that its own imports, directly or not: numba looks at the kernel's
    own file only, not at those it calls into. There is no public way to say so; without the attribute numba's own rule
    holds.
    """
    cache_file: Any = getattr(getattr(compiled, "_cache", None), "_cache_file", None)
    file = getattr(sys.modules.get(module), "__file__", None)
    if hasattr(cache_file, "_source_stamp") and file is not None:
        cache_file._source_stamp = _stamp(Path(file))
    return compiled


@functools.cache
def _stamp(file: Path) -> tuple[tuple[str, float, int], ...]:
    """Name, time and size of a module, of this one, and of all modules of the package that it imports at any depth."""
    found: set[Path] = set()
    waiting = [file, Path(__file__)]
    while waiting:
        source = waiting.pop()
        if source not in found:
            found.add(source)
            waiting += _imports(source)
    stats = [(source.relative_to(source.parents[1]), source.stat()) for source in sorted(found)]
    return tuple((str(name), stat.st_mtime, stat.st_size) for name, stat in stats)


@functools.cache
def _imports(file: Path) -> tuple[Path, ...]:
    """Files of the package that a module imports at its top level."""
    paths = (
        _PACKAGE.joinpath(*name.split(".")) for name in _IMPORT.findall(file.read_text(encoding="utf-8"))
    )
    return tuple(
        source
        for path in paths
        for source in (sorted(path.glob("*.py")) if path.is_dir() else [path.with_suffix(".py")])
    )
