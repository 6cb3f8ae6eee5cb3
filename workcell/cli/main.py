"""Entry point: parse, dispatch, and turn every foreseeable failure into one message and an exit code."""

from __future__ import annotations

import contextlib
import io
import os
import sys
from collections.abc import Sequence
from pathlib import Path
from typing import NoReturn

from workcell.cli import exit_codes
from workcell.cli.last_resort import unforeseen
from workcell.cli.output import printable
from workcell.cli.parser import build_parser
from workcell.cli.supervised import supervised
from workcell.errors import WorkcellError


def main(arguments: Sequence[str] | None = None) -> NoReturn:
    """Run the command line; always ends in SystemExit with one of `exit_codes`.

    Args:
        arguments: the command's own; None: those of this process, which is then supervised (`workcell.cli.supervised`).
    """
    _open_streams()
    if arguments is None:
        supervised()
    try:
        options = build_parser().parse_args(arguments)
        os.environ.setdefault("MUJOCO_GL", _headless_backend())
        code = options.command(options)
        sys.stdout.flush()
    except WorkcellError as error:
        code = _complain(str(error), exit_codes.BAD_INPUT)
    except KeyboardInterrupt as stop:
        message = str(stop) or "interrupted; files already written are intact"
        code = _complain(message, exit_codes.INTERRUPTED)
    except BrokenPipeError:
        os.dup2(os.open(os.devnull, os.O_WRONLY), sys.stdout.fileno())
        code = exit_codes.DONE
    except OSError as error:
        code = _complain(_os_error(error), exit_codes.BAD_INPUT)
    except MemoryError:
        code = _complain("there is not enough memory for this", exit_codes.BAD_INPUT)
    except Exception as error:
        given = sys.argv[1:] if arguments is None else arguments
        code = _complain(unforeseen(error, given), exit_codes.UNFORESEEN)
    raise SystemExit(code)


def _open_streams() -> None:
    """Started with standard streams closed: nothing is shown, and no file that is opened takes their place."""
    for descriptor, name in enumerate(("stdin", "stdout", "stderr")):
        if getattr(sys, name) is None:
            while os.open(os.devnull, os.O_RDWR) < descriptor:
                pass  # the lowest free one is taken each time
            setattr(sys, name, Path(os.devnull).open("r" if name == "stdin" else "w", encoding="utf-8"))  # noqa: SIM115
    for stream in (sys.stdout, sys.stderr):
        if isinstance(stream, io.TextIOWrapper):
            stream.reconfigure(errors="backslashreplace")  # names in files may hold what no terminal can show


def _complain(message: str, code: int) -> int:
    with contextlib.suppress(OSError, ValueError):  # nobody may be listening
        print(f"workcell: {printable(message)}", file=sys.stderr, flush=True)
    return code


def _os_error(error: OSError) -> str:
    reason = error.strerror or str(error)
    return f"{error.filename}: {reason}" if error.filename else reason


def _headless_backend() -> str:
    """EGL where its library can be found, OSMesa otherwise; pictures are skipped with the reason if neither works."""
    import ctypes.util

    return "egl" if ctypes.util.find_library("EGL") else "osmesa"
