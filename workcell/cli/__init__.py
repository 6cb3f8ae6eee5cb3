"""The `workcell` command: one function a subcommand, one clear message for whatever goes wrong."""

from workcell.cli.main import main

__all__ = ["main"]
