"""Compiling ahead in a second process, with modules that only pretend to compile."""

from __future__ import annotations

import os
import sys

import pytest

from workcell import compile_ahead

_MODULE = """
import pathlib, time
made = pathlib.Path(__file__).with_suffix(".made")
def kernels_ready():
    return made.exists()
def prepare_kernels():
    {work}
    made.write_text("by the process " + str(__import__("os").getpid()))
"""

needs_two_cores = pytest.mark.skipif(compile_ahead.cores() < 2, reason="only where a core is to spare")


@pytest.fixture
def pretended(tmp_path, monkeypatch):
    """Makes modules of the given names and work; nothing is on its way before or after."""
    monkeypatch.setenv("PYTHONPATH", str(tmp_path))
    monkeypatch.syspath_prepend(str(tmp_path))
    compile_ahead.stop()

    def make(**work):
        for name, line in work.items():
            (tmp_path / f"{name}.py").write_text(_MODULE.format(work=line))
            sys.modules.pop(name, None)
        return tmp_path

    yield make
    compile_ahead.stop()


@needs_two_cores
def test_what_is_on_its_way_is_waited_for(pretended):
    folder = pretended(pretend_slow="time.sleep(0.5)")
    compile_ahead.compile_ahead("pretend_slow")
    before = compile_ahead.compiling_seconds()
    compile_ahead.wait_for("pretend_slow")
    assert (folder / "pretend_slow.made").read_text() != f"by the process {os.getpid()}"
    assert compile_ahead.compiling_seconds() > before


@needs_two_cores
def test_what_waits_its_turn_is_not_waited_for(pretended):
    folder = pretended(pretend_endless="time.sleep(1000)", pretend_next="pass")
    compile_ahead.compile_ahead("pretend_endless", "pretend_next")
    compile_ahead.wait_for("pretend_next")
    assert compile_ahead.under_way() and not (folder / "pretend_next.made").exists()


@needs_two_cores
def test_a_process_that_dies_keeps_nobody_waiting(pretended):
    folder = pretended(pretend_broken="raise SystemExit(1)", pretend_after="pass")
    compile_ahead.compile_ahead("pretend_broken", "pretend_after")
    compile_ahead.wait_for("pretend_broken")
    compile_ahead.wait_for("pretend_after")
    assert not compile_ahead.under_way()
    assert not list(folder.glob("*.made"))


def test_what_was_compiled_before_starts_nothing(pretended, monkeypatch):
    monkeypatch.setattr("subprocess.Popen", lambda *_, **__: pytest.fail("a process was begun"))
    folder = pretended(pretend_ready="pass")
    (folder / "pretend_ready.made").write_text("before")
    compile_ahead.compile_ahead("pretend_ready")
    assert not compile_ahead.under_way()
    assert (folder / "pretend_ready.made").read_text() == "before"


def test_without_anything_on_its_way_nobody_waits(pretended):
    before = compile_ahead.compiling_seconds()
    compile_ahead.wait_for(compile_ahead.DECIDING)
    assert compile_ahead.compiling_seconds() == before and not compile_ahead.under_way()


@pytest.mark.parametrize(
    "name", [compile_ahead.TRACKING, compile_ahead.PLANNING, compile_ahead.SAMPLING, compile_ahead.DECIDING]
)
def test_the_modules_named_here_keep_the_agreement(name):
    import importlib

    module = importlib.import_module(name)
    assert isinstance(module.kernels_ready(), bool)
    assert callable(module.prepare_kernels)
