"""Ctrl-C ends every command within five seconds, in whatever it is caught, and with it all that it started."""

import os
import signal
import subprocess
import sys
import time
from pathlib import Path

import pytest

from workcell.cli import exit_codes, supervised

STUCK = """
import argparse, importlib, subprocess, sys
entry = importlib.import_module("workcell.cli.main")

def work(options):
    print("begun", flush=True)
    {work}
    return 0

class Parser:
    def parse_args(self, arguments):
        return argparse.Namespace(command=work)

entry.build_parser = Parser
entry.main()
"""
NATIVE = "import hashlib; hashlib.pbkdf2_hmac('sha256', b'x', b'y', 10**9)"
"""Code that doesn't look at signals, for hours."""
STARTER = (
    "subprocess.Popen([sys.executable, '-c', 'import signal, time; signal.signal(2, 1); time.sleep(600)']);"
    + NATIVE
)


def _hear(ignored: tuple[signal.Signals, ...]) -> None:
    """Signals as in a terminal's foreground, whatever the tests were started by, but for some."""
    for number in (signal.SIGINT, signal.SIGTERM, signal.SIGHUP):
        signal.signal(number, signal.SIG_IGN if number in ignored else signal.SIG_DFL)


def begun(work: str, ignored: tuple[signal.Signals, ...] = ()) -> subprocess.Popen[str]:
    process = subprocess.Popen(
        [sys.executable, "-c", STUCK.format(work=work)],
        stdout=subprocess.PIPE,
        stderr=subprocess.PIPE,
        text=True,
        start_new_session=True,
        preexec_fn=lambda: _hear(ignored),
    )
    assert process.stdout is not None
    assert process.stdout.readline() == "begun\n"
    return process


def alive(pid: int) -> bool:
    try:
        return Path(f"/proc/{pid}/stat").read_text().rpartition(")")[2].split()[0] != "Z"
    except OSError:
        return False


def gone(pids: list[int], within_s: float = 10.0) -> bool:
    """Whether all have ended; who was killed still has to get its turn to die."""
    until = time.monotonic() + within_s
    while any(alive(pid) for pid in pids) and time.monotonic() < until:
        time.sleep(0.02)
    return not any(alive(pid) for pid in pids)


@pytest.mark.parametrize(
    ("work", "patient"), [("import time; time.sleep(600)", False), (NATIVE, True), (STARTER, True)]
)
@pytest.mark.parametrize("whole_group", [False, True])
def test_an_interrupted_command_ends_with_130_and_all_that_it_started(work, patient, whole_group):
    process = begun(work)
    time.sleep(0.3)
    started = supervised._descendants(process.pid)
    assert started
    before = time.monotonic()
    (os.killpg if whole_group else os.kill)(process.pid, signal.SIGINT)
    told = process.communicate(timeout=30)[1]
    assert process.returncode == exit_codes.INTERRUPTED
    assert "workcell: interrupted" in told and "Traceback" not in told
    assert ("did not stop by itself" in told) == patient
    assert (
        time.monotonic() - before < supervised.PATIENCE_S + 5.0
    )  # a second where the machine has nothing else to do
    assert gone(started)


@pytest.mark.parametrize("number", [signal.SIGINT, signal.SIGHUP])
def test_what_it_was_started_to_ignore_is_ignored(number):
    process = begun("import time; time.sleep(5.5)", ignored=(number,))
    process.send_signal(number)
    told = process.communicate(timeout=30)[1]
    assert process.returncode == 0 and told == ""


@pytest.mark.parametrize("number", [signal.SIGTERM, signal.SIGKILL])
def test_a_command_that_is_killed_leaves_nobody_behind(number):
    process = begun(NATIVE)
    started = supervised._descendants(process.pid)
    process.send_signal(number)
    process.communicate(timeout=30)
    assert process.returncode == -number
    assert gone(started)


@pytest.mark.parametrize("code", [0, 1, 2, 3])
def test_the_exit_code_is_the_commands(code):
    process = begun(f"return {code}")
    process.communicate(timeout=30)
    assert process.returncode == code


def test_cleaning_up_is_not_interrupted_again():
    once = supervised._Once()
    with pytest.raises(KeyboardInterrupt):
        once(signal.SIGINT, None)
    once(signal.SIGINT, None)
