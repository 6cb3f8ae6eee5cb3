"""Ctrl-C that is obeyed whatever the command is doing: a small process waits for the one that works.

Compiled code and libraries don't look at signals, some for minutes. So the command works in a child process; where that
does not stop within a few seconds of being asked to, this process ends it and says so. What it had written stays.
"""

from __future__ import annotations

import contextlib
import os
import signal
import sys
import time
from pathlib import Path
from types import FrameType

from workcell.cli import exit_codes

PATIENCE_S = 4.0
"""Seconds that an interrupted command has to stop by itself."""

_FORWARDED = (signal.SIGINT, signal.SIGTERM, signal.SIGHUP)
_BY_USER = 0
"""`si_code` of a signal that a process sent, and not the terminal to everybody."""
_GROUP_S = 0.3
"""Seconds until such an interruption is passed on: often the whole group has got it, the child too."""
_DEATH_SIGNAL = 1
"""`PR_SET_PDEATHSIG` of Linux."""


def supervised() -> None:
    """Returns in a child process, which does the work; this one waits and ends as the child does.

    Where a process can't be doubled, nothing happens. Signals that the command was started to ignore, as by `nohup` or
    in a shell's background, are ignored.
    """
    import threading

    if not hasattr(os, "fork") or not hasattr(signal, "sigtimedwait") or threading.active_count() > 1:
        return
    obeyed = {number for number in _FORWARDED if signal.getsignal(number) is not signal.SIG_IGN}
    watched = {*obeyed, signal.SIGCHLD}
    before = signal.pthread_sigmask(signal.SIG_BLOCK, watched)
    supervisor = os.getpid()
    child = os.fork()
    if child == 0:
        _die_with(supervisor)
        if signal.getsignal(signal.SIGINT) is signal.default_int_handler:
            signal.signal(signal.SIGINT, _Once())
        signal.pthread_sigmask(signal.SIG_SETMASK, before)
        return
    _end_as(_waited_for(child, watched))


class _Once:
    """Raises KeyboardInterrupt at the first signal; cleaning up is not interrupted by those that follow at once."""

    def __init__(self) -> None:
        self._until = -1.0

    def __call__(self, number: int, frame: FrameType | None) -> None:
        if time.monotonic() > self._until:
            self._until = time.monotonic() + PATIENCE_S
            raise KeyboardInterrupt


def _die_with(supervisor: int) -> None:
    """End when the process that waits is killed; only Linux can."""
    import ctypes

    with contextlib.suppress(OSError, AttributeError):
        ctypes.CDLL(None).prctl(_DEATH_SIGNAL, signal.SIGKILL)
        if os.getppid() != supervisor:
            os._exit(exit_codes.INTERRUPTED)


def _waited_for(child: int, watched: set[signal.Signals]) -> int:
    """The child's wait status; it is ended where it doesn't stop in time after an interruption."""
    deadline = forward = float("inf")
    while True:
        found, status = os.waitpid(child, os.WNOHANG)
        if found == child:
            interrupted = (
                deadline < float("inf") and os.WIFSIGNALED(status) and os.WTERMSIG(status) == signal.SIGINT
            )
            return exit_codes.INTERRUPTED << 8 if interrupted else status
        if time.monotonic() >= forward:
            forward = float("inf")
            _send(child, signal.SIGINT)
        left = min(deadline, forward, time.monotonic() + 60.0) - time.monotonic()
        if time.monotonic() >= deadline:
            _end(child)
            os.waitpid(child, 0)
            print(
                f"workcell: interrupted; it did not stop by itself within {PATIENCE_S:.0f} s, and was ended; "
                "files already written are intact",
                file=sys.stderr,
                flush=True,
            )
            return exit_codes.INTERRUPTED << 8
        told = signal.sigtimedwait(watched, max(left, 0.0))
        if told is None or told.si_signo == signal.SIGCHLD:
            continue
        if told.si_signo != signal.SIGINT:
            _send(child, told.si_signo)
        elif told.si_code == _BY_USER:
            forward = min(forward, time.monotonic() + _GROUP_S)
        deadline = min(deadline, time.monotonic() + PATIENCE_S)


def _end(child: int) -> None:
    """Kill a process and those that it has started."""
    for process in (child, *_descendants(child)):
        _send(process, signal.SIGKILL)


def _send(process: int, number: int) -> None:
    with contextlib.suppress(ProcessLookupError, PermissionError):
        os.kill(process, number)


def _descendants(of: int) -> list[int]:
    """What a process has started, and those in turn; empty where the system doesn't tell."""
    parents: dict[int, list[int]] = {}
    for entry in Path("/proc").glob("[0-9]*/stat"):
        with contextlib.suppress(OSError, ValueError, IndexError):
            parent = int(entry.read_text(errors="replace").rpartition(")")[2].split()[1])
            parents.setdefault(parent, []).append(int(entry.parent.name))
    found, at = list(parents.get(of, [])), 0
    while at < len(found):
        found += parents.get(found[at], [])
        at += 1
    return found


def _end_as(status: int) -> None:
    """With the child's exit code, or by the signal that ended it."""
    if os.WIFSIGNALED(status):
        number = os.WTERMSIG(status)
        with contextlib.suppress(OSError, ValueError):
            signal.signal(number, signal.SIG_DFL)
        signal.pthread_sigmask(signal.SIG_UNBLOCK, {number})
        os.kill(os.getpid(), number)
    os._exit(os.waitstatus_to_exitcode(status) & 0xFF)
