"""How kernels are compiled; importing this module imports numba.

Only modules of kernels do so, and they are imported when first used.

numba compiles on the first call and caches to disk: in `__pycache__` beside the sources, or in the user's cache folder
where that is read-only; `NUMBA_CACHE_DIR` overrides both.
"""

from __future__ import annotations

import contextlib
import functools
import glob
import hashlib
import re
import sys
import time
from collections.abc import Callable
from pathlib import Path
from typing import Any, TypeVar

from llvmlite.binding import Linkage
from numba import njit
from numba.core import event, types
from numba.core.caching import IndexDataCacheFile
from numba.core.codegen import CPUCodeLibrary, JITCodeLibrary
from numba.core.compiler import Compiler
from numba.core.compiler_machinery import FunctionPass, register_pass
from numba.core.typed_passes import NopythonTypeInference
from numba.experimental import structref

from workcell.clock import leave_out

Function = TypeVar("Function", bound=Callable[..., object])

# Everything but "no NaN, no infinity": a step that breaks down must be seen as one.
_FAST = {"contract", "reassoc", "nsz", "arcp"}
_ENTRY = {"nogil": True}
_INNER = {"no_cpython_wrapper": True, "no_cfunc_wrapper": True}
_PACKAGE = Path(__file__).parent
_IMPORT = re.compile(r"^(?:from|import) workcell\.([\w.]+)", re.MULTILINE)


class _Clock(event.TimingListener):  # type: ignore[misc]
    """Adds up what numba spends on compiling, nested calls once; says so when it begins for the first time.

    The clock of budgets leaves it out.
    """

    announce: Callable[[], object] | None = None
    _cpu = 0.0

    def on_start(self, started: Any) -> None:
        announce, self.announce = self.announce, None
        if announce is not None:
            announce()
        if self._depth == 0:
            self._cpu = time.process_time()
        super().on_start(started)

    def on_end(self, ended: Any) -> None:
        super().on_end(ended)
        if self._depth == 0:
            leave_out(time.process_time() - self._cpu)


def _with_copies_of_its_own(finalize: Callable[[Any], None]) -> Callable[[Any], None]:
    """Let a compiled kernel call its own copies of the functions that it calls, whatever else is loaded.

    numba marks these copies so that the first of a name that a process loads serves all kernels. They were optimised
    each in its place and round differently, so that the last digits of an answer would depend on what was compiled,
    loaded or called before.
    """

    @functools.wraps(finalize)
    def finalized(library: Any) -> None:
        module = library._final_module
        own = [function for function in module.functions if not function.is_declaration]
        if any("workcell" in function.name for function in own):
            exported = [function for function in own if function.linkage == Linkage.external]
            # what others link in is a copy with the marks, as numba makes it
            library._shared_module = module.clone()
            for function in exported:
                library._shared_module.get_function(function.name).linkage = Linkage.linkonce_odr
            for function in own:
                if function.linkage == Linkage.linkonce_odr:
                    function.linkage = Linkage.internal
        finalize(library)

    return finalized


CPUCodeLibrary._finalize_final_module = _with_copies_of_its_own(CPUCodeLibrary._finalize_final_module)


class _LeanLibrary(JITCodeLibrary):  # type: ignore[misc]
    """The code of a function that only becomes part of kernels: it is linked, but not translated."""

    class _Nowhere:
        """Where the environment of a function goes that is never called by itself."""

        @staticmethod
        def set_env(name: str, env: object) -> None:
            """Nothing is there to be told."""

    @property
    def codegen(self) -> _Nowhere:
        """See numba."""
        return self._Nowhere()

    def get_pointer_to_function(self, name: str) -> int:
        """None: it has no address."""
        self._ensure_finalized()
        return 0

    def _optimize_final_module(self) -> None:
        """Nothing: kernels do that, once, with all they call."""

    def _finalize_final_module(self) -> None:
        self._finalized = True


@register_pass(mutates_CFG=False, analysis_only=True)
class _LeanLowering(FunctionPass):  # type: ignore[misc]
    """Gives a function its lean library."""

    _name = "lean_lowering"

    def __init__(self) -> None:
        super().__init__()

    def run_pass(self, state: Any) -> bool:
        """See numba."""
        state.library = _LeanLibrary(state.targetctx.codegen(), state.func_id.func_qualname)
        return False


class _LeanCompiler(Compiler):  # type: ignore[misc]
    """numba's compiler, up to the code that kernels link in."""

    def define_pipelines(self) -> Any:
        """See numba."""
        pipelines = super().define_pipelines()
        for pipeline in pipelines:
            pipeline.add_pass_after(_LeanLowering, NopythonTypeInference)
            pipeline.finalize()
        return pipelines


_LEAN = {**_INNER, "_nrt": False, "pipeline_class": _LeanCompiler}

_clock = _Clock()
event.register("numba:compile", _clock)


def compile_seconds() -> float:
    """Wall seconds that this process has spent on compiling kernels; loading them from the cache is none of it."""
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


def lean(function: Function) -> Function:
    """`inner` that makes no arrays and is translated as part of kernels only: for deep nests that take many arrays.

    Arrays are not counted, and it is neither optimised nor cached by itself.
    """
    compiled: Function = njit(error_model="numpy", fastmath=_FAST, **_LEAN)(function)
    return compiled


def inlined(function: Function) -> Function:
    """`lean` that becomes part of its callers in any case: for what does little."""
    compiled: Function = njit(error_model="numpy", fastmath=_FAST, forceinline=True, **_LEAN)(function)
    return compiled


class Bundle(structref.StructRefProxy):  # type: ignore[misc]
    """What a kernel takes as one argument, made by a kernel: each array of a tuple costs a call half a microsecond.

    Subclasses name their fields by annotations.
    """


class BundleType(types.StructRef):  # type: ignore[misc,name-defined]
    """The type of a bundle in kernels; a subclass for each."""


def bundled(kind: type[BundleType], bundle: type[Bundle]) -> None:
    """Make a bundle known to kernels, which may construct it and read its fields."""
    structref.register(kind)
    structref.define_proxy(bundle, kind, list(bundle.__annotations__))


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
    """Let a cached kernel go stale with every module that its own imports, directly or not.

    numba looks at the kernel's own file only, not at those it calls into. There is no public way to say so;
    without the attribute numba's own rule holds.
    """
    known: Any = getattr(getattr(compiled, "_cache", None), "_cache_file", None)
    file = getattr(sys.modules.get(module), "__file__", None)
    if isinstance(known, IndexDataCacheFile) and file is not None:
        base = known._index_name.removesuffix(".nbi")
        compiled._cache._cache_file = KernelFile(known._cache_path, base, _stamp(Path(file)))
    return compiled


class KernelFile(IndexDataCacheFile):  # type: ignore[misc]
    """A kernel's file in the cache, for several processes that compile at the same time.

    numba's own numbers the overloads of a kernel, so that two processes may give one number to two of them, and one
    would be called in place of the other. Here a file is named after what is in it, and is whole before the index
    names it.
    """

    def save(self, key: object, data: object) -> None:
        """Keep a compiled overload."""
        content = hashlib.sha256(repr((key, self._source_stamp)).encode()).hexdigest()[:16]
        name = self._index_name.replace(".nbi", f".{content}.nbc")
        self._save_data(name, data)
        overloads = self._load_index()
        if not overloads:
            self._remove_stale()
        self._save_index({**overloads, key: name})

    def _remove_stale(self) -> None:
        """Remove what an earlier version of the kernel left: the files that are older than its index."""
        index, base = Path(self._index_path), self._index_name.removesuffix(".nbi")
        with contextlib.suppress(FileNotFoundError):  # another process may do the same
            made = index.stat().st_mtime
            for file in index.parent.glob(f"{glob.escape(base)}.*.nbc"):
                if file.stat().st_mtime < made:
                    file.unlink(missing_ok=True)

    @property
    def holds_any(self) -> bool:
        """Whether an overload was kept that is not stale."""
        return bool(self._load_index())


def is_compiled(function: object) -> bool:
    """Whether a kernel is in the cache already, for some types; True where that can't be told."""
    file = getattr(getattr(function, "_cache", None), "_cache_file", None)
    return file.holds_any if isinstance(file, KernelFile) else True


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
