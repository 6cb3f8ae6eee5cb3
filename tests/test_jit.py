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
    for name in ("__init__", "clock", "errors", "jit"):
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


SUM = """
import numpy as np
@inner
def dot(a, b):
    total = 0.0
    for k in range(a.shape[0]):
        total += a[k] * b[k]
    return total
@inner
def swept(a, b, out):
    n = out.shape[0]
    for i in range(n):
        total = b[i]
        for j in range(n):
            if j != i:
                total -= a[i, j] * out[j]
        out[i] = total / a[i, i] + 1e-3 * np.sin(out[i]) * np.exp(-out[i] * out[i])
    for i in range(n):
        for j in range(i):
            out[i] += 1e-4 * np.arctan2(out[j], 1.0 + out[i] * out[i]) / (2.0 + dot(a[i], a[j]))
    return dot(out, out)
@kernel
def outer(a, b):
    out = np.zeros(b.shape[0])
    return swept(a, b, out) + swept(a, out, b) + swept(a[::1], b, out) * dot(a[0], b) + swept(a, b, out)
@kernel
def other(a, b):
    out = np.zeros(b.shape[0])
    return swept(a, b, out) - dot(a[0], b) + swept(a, out, b)
"""
"""Kernels that call the same functions, too large to be made part of either."""

NUMBERS = "a, b = 4 * np.eye(7) + np.random.default_rng(0).random((7, 7)), np.arange(7.0)"
ORDERS = f"""
import numpy as np; from workcell.kernels.sums import {{names}}
{NUMBERS}
found = dict((f.__name__, f(a, b.copy()).hex()) for f in ({{names}},))
print(*(found[name] for name in sorted(found)))
"""

SHARED = f"""
import numpy as np; from llvmlite.binding import Linkage; from workcell.kernels.sums import outer
{NUMBERS}
outer(a, b)
(compiled,) = outer.overloads.values()
own = [f for f in compiled.library._final_module.functions if not f.is_declaration]
print(*(f.name for f in own if f.linkage == Linkage.linkonce_odr and "workcell" in f.name))
"""


def test_answers_are_the_same_to_the_last_digit_whatever_was_compiled_or_loaded_before(tmp_path):
    """Cold and warm, alone and beside another kernel that calls into the same functions, in either order."""
    kernels = tmp_path / "workcell" / "kernels"
    kernels.mkdir(parents=True)
    for name in ("__init__", "clock", "errors", "jit"):
        shutil.copy(PACKAGE / f"{name}.py", kernels.parent)
    (kernels / "__init__.py").write_text("")
    (kernels / "sums.py").write_text(f"from workcell.jit import inner, kernel\n{SUM}")

    def run(program):
        command = [sys.executable, "-c", program]
        return subprocess.run(
            command, cwd=tmp_path, capture_output=True, text=True, check=True
        ).stdout.split()

    assert run(SHARED) == [], "copies in place of which another kernel's may be called"
    shutil.rmtree(kernels / "__pycache__")
    cold = run(ORDERS.format(names="other, outer"))
    for names in ("outer, other", "other, outer"):
        assert run(ORDERS.format(names=names)) == cold
    assert [value for name in ("other", "outer") for value in run(ORDERS.format(names=name))] == cold
