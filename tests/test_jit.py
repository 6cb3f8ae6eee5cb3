"""When compiled kernels on disk go stale."""

from __future__ import annotations

from pathlib import Path

import workcell
from workcell import jit

_PACKAGE = Path(workcell.__file__).parent


def test_a_kernel_depends_on_every_module_that_it_calls_into():
    named = {name for name, _, _ in jit._stamp(_PACKAGE / "geometry/kernels/robot.py")}
    assert {"kernels/robot.py", "kernels/shapes.py", "kernels/distance.py", "kernels/chain.py"} <= named
    assert "workcell/jit.py" in named
    assert "ik/solve.py" not in named


def test_the_disk_cache_carries_that_stamp():
    from workcell.geometry.kernels import robot

    file = robot.smallest_gaps._cache._cache_file
    assert file._source_stamp == jit._stamp(_PACKAGE / "geometry/kernels/robot.py")


def test_the_clock_counts_compiling_and_says_so_once():
    from numba import njit

    from workcell.jit import announce_compiling, compile_seconds

    said = []
    announce_compiling(lambda: said.append("compiling"))
    before = compile_seconds()
    inside = njit(lambda x: x + 1)
    both = njit(lambda x: inside(x) + 2)
    assert both(1) == 4
    spent = compile_seconds() - before
    assert spent > 0 and said == ["compiling"]
    assert both(2) == 5
    assert compile_seconds() - before == spent
