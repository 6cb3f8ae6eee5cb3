"""`run` and `review`: do a task, and look at what happened."""

from __future__ import annotations

import argparse
from pathlib import Path

from workcell.cli import exit_codes
from workcell.cli.output import print_json, print_table


def run(options: argparse.Namespace) -> int:
    """Run a task; the story goes to standard output, or one JSON object with --json."""
    from workcell.job import run_task

    def silent(_: str) -> None:
        return

    result = run_task(
        options.task,
        robot=options.robot,
        planner=options.planner,
        seed=options.seed,
        out=options.out,
        say=silent if options.json else _say,
    )
    if options.json:
        print_json(result.summary)
    else:
        conditions = result.summary.get("conditions", {})
        rows = [
            (key, value) for key, value in result.summary.items() if key not in ("sentence", "conditions")
        ]
        rows += [(name, "yes" if holds else "NO") for name, holds in conditions.items()]
        print_table(f"{result.summary['task']}: {result.sentence}", ["", "value"], rows)
        print(f"recording {result.recording}")
        print(f"summary   {result.summary_path}")
        print(f"look at it: workcell review {result.recording} --png {result.recording.parent}")
    if result.achieved:
        return exit_codes.DONE
    return exit_codes.IMPOSSIBLE if result.impossible else exit_codes.NOT_ACHIEVED


def _say(text: str) -> None:
    print(text, flush=True)


def review(options: argparse.Namespace) -> int:
    """Verdict, metrics and pictures of a recording."""
    from rich.console import Console

    from workcell.record.pictures import write_pictures
    from workcell.record.review import review as read

    result = read(Path(options.file))
    pictures = write_pictures(result, Path(options.png)) if options.png else []
    if options.json:
        print_json({**result.to_json(), "pictures": [str(path) for path in pictures]})
    else:
        Console().print(result.table())
        for path in pictures:
            print(f"wrote {path}")
    return exit_codes.DONE if result.achieved else exit_codes.NOT_ACHIEVED
