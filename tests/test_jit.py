"""When compiled kernels on disk go stale."""

from __future__ import annotations

from pathlib import Path

import workcell
from workcell import jit

_PACKAGE = Path(workcell.__file__).parent


def test_a_kernel_depends_on_every_module_that_it_calls_into():
    named = {name for name, _, _ in jit._stamp(_PACKAGE / "kernels/sphere_gaps.py")}
    assert {"kernels/sphere_gaps.py", "kernels/shapes.py", "kernels/distance.py", "kernels/chain.py"} <= named
    assert "workcell/jit.py" in named
    assert "ik/solve.py" not in named


def test_the_disk_cache_carries_that_stamp():
    from workcell.kernels import sphere_gaps

    file = sphere_gaps.smallest_gaps._cache._cache_file
    assert file._source_stamp == jit._stamp(_PACKAGE / "kernels/sphere_gaps.py")


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


def test_two_processes_that_compile_at_once_never_mix_up_overloads(tmp_path):
    def file(stamp=1):
        return jit.KernelFile(str(tmp_path), "kernels.shrink-1.py311", stamp)

    first, second = file(), file()
    first.save("float64(float64)", b"one")
    second.save("int64(int64)", b"two")
    # each decided on its file's name before it knew of the other's
    interleaved = file()
    interleaved._load_index = dict
    interleaved.save("float32(float32)", b"three")
    found = {key: file().load(key) for key in ("float64(float64)", "int64(int64)", "float32(float32)")}
    assert found["float32(float32)"] == b"three"
    assert found["float64(float64)"] in (b"one", None) and found["int64(int64)"] in (b"two", None)


def test_what_is_stale_is_neither_called_nor_kept(tmp_path):
    jit.KernelFile(str(tmp_path), "kernels.shrink-1.py311", 1).save("float64(float64)", b"old")
    edited = jit.KernelFile(str(tmp_path), "kernels.shrink-1.py311", 2)
    assert edited.load("float64(float64)") is None and not edited.holds_any
    edited.save("int64(int64)", b"new")
    assert edited.load("int64(int64)") == b"new" and edited.holds_any
    assert len(list(tmp_path.glob("*.nbc"))) == 1


def test_a_file_that_is_gone_is_compiled_again(tmp_path):
    kept = jit.KernelFile(str(tmp_path), "kernels.shrink-1.py311", 1)
    kept.save("float64(float64)", b"one")
    next(tmp_path.glob("*.nbc")).unlink()
    assert kept.load("float64(float64)") is None
