"""What all commands' grammars share: a command with its example, and the options that mean the same everywhere."""

from __future__ import annotations

import argparse
import importlib
from collections.abc import Callable
from typing import TypeAlias

from workcell.cli import values

Command = Callable[[argparse.Namespace], int]
Commands: TypeAlias = "argparse._SubParsersAction[argparse.ArgumentParser]"


class _Help(argparse.HelpFormatter):
    """Examples stay on one line, to be pasted."""

    def _fill_text(self, text: str, width: int, indent: str) -> str:
        return text if text.startswith("example: ") else super()._fill_text(text, width, indent)


def late(module: str, function: str) -> Command:
    """A command that imports its module only when it runs."""

    def call(options: argparse.Namespace) -> int:
        code: int = getattr(importlib.import_module(f"workcell.cli.{module}"), function)(options)
        return code

    return call


def command(
    commands: Commands,
    name: str,
    help_text: str,
    example: str,
    run: Command,
) -> argparse.ArgumentParser:
    """A command's own parser, with an example that can be pasted."""
    parser = commands.add_parser(
        name,
        help=help_text,
        description=help_text[0].upper() + help_text[1:] + ".",
        epilog=f"example: workcell {example}",
        formatter_class=_Help,
    )
    parser.set_defaults(command=run, parser=parser)
    return parser


def json_option(parser: argparse.ArgumentParser) -> None:
    """`--json`."""
    parser.add_argument("--json", action="store_true", help="print one JSON object instead of text")


def seed_option(parser: argparse.ArgumentParser) -> None:
    """`--seed`."""
    parser.add_argument(
        "--seed", type=values.count, default=0, metavar="N", help="same seed, same answer (default: 0)"
    )


def jobs_option(parser: argparse.ArgumentParser) -> None:
    """`--jobs`."""
    parser.add_argument(
        "--jobs", type=values.positive_int, default=1, metavar="N", help="processes (default: 1)"
    )


def budget_option(parser: argparse.ArgumentParser) -> None:
    """`--budget-s`."""
    parser.add_argument(
        "--budget-s", type=values.seconds, default=5.0, metavar="S", help="CPU seconds a problem (default: 5)"
    )
