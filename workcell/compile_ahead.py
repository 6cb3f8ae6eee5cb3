"""Kernels compiled in a second process while this one gets on with what needs none of them.

On a machine's first run most of the time goes into compiling. Who knows what will be needed later says so with
`compile_ahead`; who needs it calls `wait_for` first, which returns at once where nothing is on its way.
"""

from __future__ import annotations

import atexit
import importlib
import os
import subprocess
import sys
import threading
import time
from collections.abc import Sequence

TRACKING = "workcell.motion.tool_paths.tracker"
PLANNING = "workcell.motion.plans.compiled"
SAMPLING = "workcell.ik.hjcd.solver"
DECIDING = "workcell.ik.branch.solver"
"""Modules with a function `prepare_kernels()`, which calls what it compiles once, and `kernels_ready()`, which is
quick."""


class _Ahead:
    """The other process, which does one module after the other, and how many it has done."""

    def __init__(self, modules: Sequence[str]) -> None:
        self._modules, self._done, self._ended = tuple(modules), 0, False
        self._changed = threading.Condition()
        # -P: what lies in the folder where the user stands is not to be imported
        command = [sys.executable, "-P", "-m", "workcell.compile_ahead", *modules]
        self._process = subprocess.Popen(command, stdout=subprocess.PIPE, stderr=subprocess.DEVNULL)
        threading.Thread(target=self._listen, daemon=True).start()
        atexit.register(self.stop)

    def wait_for(self, module: str) -> None:
        """Until `module` is done, if it has been begun; what is further back is better compiled here."""
        if module not in self._modules:
            return
        index = self._modules.index(module)
        with self._changed:
            if index == self._done:
                self._changed.wait_for(lambda: self._done > index or self._ended)

    def _listen(self) -> None:
        assert self._process.stdout is not None
        for _ in self._process.stdout:
            with self._changed:
                self._done += 1
                self._changed.notify_all()
        with self._changed:
            self._ended = True
            self._changed.notify_all()

    @property
    def at_work(self) -> bool:
        """Whether it has not come to its end."""
        with self._changed:
            return not self._ended

    def stop(self) -> None:
        """End it; what it has compiled is kept."""
        self._process.terminate()
        self._process.wait()


class _State:
    ahead: _Ahead | None = None
    waited: float = 0.0


def cores() -> int:
    """How many cores this process may use, where the system tells; else how many there are."""
    return len(os.sched_getaffinity(0)) if hasattr(os, "sched_getaffinity") else os.cpu_count() or 1


def compile_ahead(*modules: str) -> None:
    """Begin to compile what these modules need, one after the other, but for those that have been compiled before."""
    missing = [module for module in modules if not importlib.import_module(module).kernels_ready()]
    if missing and _State.ahead is None and cores() > 1:
        _State.ahead = _Ahead(missing)


def wait_for(module: str) -> None:
    """Until the other process has compiled what `module` needs, if that is what it is at."""
    if _State.ahead is not None:
        began = time.perf_counter()
        _State.ahead.wait_for(module)
        _State.waited += time.perf_counter() - began


def under_way() -> bool:
    """Whether the other process is at work."""
    return _State.ahead is not None and _State.ahead.at_work


def stop() -> None:
    """End the other process, if there is one; what it has compiled is kept, and another may be begun."""
    if _State.ahead is not None:
        _State.ahead.stop()
        _State.ahead = None


def compiling_seconds() -> float:
    """Wall seconds that compiling has cost this process: its own kernels, and waiting for those of the other one."""
    from workcell.jit import compile_seconds

    return compile_seconds() + _State.waited


def _compile(modules: Sequence[str]) -> None:
    for name in modules:
        module = importlib.import_module(name)
        if not module.kernels_ready():
            module.prepare_kernels()
        print(name, flush=True)


if __name__ == "__main__":
    _compile(sys.argv[1:])
