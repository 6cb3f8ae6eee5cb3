"""When compiled kernels on disk go stale."""

from __future__ import annotations

import shutil
import subprocess
import sys
from pathlib import Path

import pytest

import workcell
from workcell import jit

PACKAGE = Path(workcell.__file__).parent

MODULES = {
    "bottom": "@inner\ndef one(x):\n    return x + 1.0",
    "middle": "from workcell.kernels.bottom import one\n@inner\ndef two(x):\n    return one(x) + 1.0",
    "top": "from workcell.kernels.middle import two\n@kernel\ndef three(x):\n    return two(x) + 1.0",
    "aside": "",
}
"""Kernels that call each other across modules, as the package's own do, and a module that none of them imports."""

ASK = """
from workcell.jit import is_compiled
from workcell.kernels.top import three
print(is_compiled(three), three(0.0) if {call} else "")
"""


def ask(folder, call):
    """Whether the kernel at the top was compiled before, and what it returns if called: in a process of its own."""
    command = [sys.executable, "-c", ASK.format(call=call)]
    done = subprocess.run(command, cwd=folder, capture_output=True, text=True, check=True)
    return done.stdout.split()


@pytest.fixture(scope="module")
def compiled(tmp_path_factory):
    """A folder with a package of that name in which the kernel at the top has been compiled."""
    folder = tmp_path_factory.mktemp("compiled")
    kernels = folder / "workcell" / "kernels"
    kernels.mkdir(parents=True)
    for name in ("__init__", "errors", "jit"):
        shutil.copy(PACKAGE / f"{name}.py", kernels.parent)
    for name, text in {"__init__": "", **MODULES}.items():
        (kernels / f"{name}.py").write_text(f"from workcell.jit import inner, kernel\n{text}\n")
    assert ask(folder, call=True) == ["False", "3.0"]
    return folder


@pytest.mark.parametrize(
    ("edited", "stale", "result"),
    [("kernels/aside.py", False, []), ("kernels/bottom.py", True, ["12.0"]), ("jit.py", True, [])],
)
def test_a_kernel_goes_stale_with_every_module_that_it_calls_into(compiled, tmp_path, edited, stale, result):
    """And with the module that says how kernels are compiled, but with no other."""
    shutil.copytree(compiled, tmp_path, dirs_exist_ok=True)
    file = tmp_path / "workcell" / edited
    file.write_text(file.read_text().replace("x + 1.0", "x + 10.0") + "\n# edited\n")
    assert ask(tmp_path, call=bool(result)) == [str(not stale), *result]


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
