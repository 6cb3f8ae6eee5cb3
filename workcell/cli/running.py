"""`run` and `review`: do a task, and look at what happened."""

from __future__ import annotations

import argparse
from pathlib import Path
from typing import TYPE_CHECKING

from workcell.cli import exit_codes
from workcell.cli.output import check_outputs, console, print_json, print_table, tell

if TYPE_CHECKING:
    from workcell.record.read.review import Review


def run(options: argparse.Namespace) -> int:
    """Run a task; the story goes to standard output, or one JSON object with --json."""
    from workcell.task.run import run_task

    def silent(_: str) -> None:
        return

    result = run_task(
        options.task,
        robot=options.robot,
        planner=options.planner,
        controller=options.controller,
        seed=options.seed,
        out=options.out,
        trace=options.trace,
        view=options.view,
        say=silent if options.json else _say,
    )
    if options.json:
        print_json(result.summary)
    else:
        conditions = result.summary.get("conditions", {})
        rows = [
            (key, value)
            for key, value in result.summary.items()
            if key not in ("sentence", "conditions", "why")
        ]
        rows += [(name, "yes" if holds else "NO") for name, holds in conditions.items()]
        print_table(f"{result.summary['task']}: {result.sentence}", ["", "value"], rows)
        tell(f"recording {result.recording}")
        tell(f"summary   {result.summary_path}")
        tell(f"look at it: workcell review {result.recording} --png {result.recording.parent}")
    if result.achieved:
        return exit_codes.DONE
    return exit_codes.IMPOSSIBLE if result.impossible else exit_codes.NOT_ACHIEVED


def _say(text: str) -> None:
    tell(text, flush=True)


def review(options: argparse.Namespace) -> int:
    """Verdict, metrics and pictures of a recording, or what differs between two."""
    from workcell.record.read.review import review as read
    from workcell.record.show.terminal import review_table

    wanted = 2 if options.compare else 1
    if len(options.file) != wanted:
        options.parser.error(
            "--compare takes two recordings" if options.compare else "give one recording; two with --compare"
        )
    if options.compare:
        return _compare(options)
    result = read(Path(options.file[0]))
    sheet = Path(options.png) / "contact_sheet.png" if options.png else None
    check_outputs((sheet, options.html), options.file)
    written = _write_review(result, options)
    if options.json:
        print_json({**result.to_json(), "pictures": [str(path) for path in written]})
    else:
        console().print(review_table(result))
        for path in written:
            tell(f"wrote {path}")
    return exit_codes.DONE if result.achieved else exit_codes.NOT_ACHIEVED


def _write_review(result: Review, options: argparse.Namespace) -> list[Path]:
    from workcell.record.show.page import write_page
    from workcell.record.show.pictures import write_pictures

    written = write_pictures(result, Path(options.png)) if options.png else []
    return [*written, write_page(result, options.html)] if options.html else written


def _compare(options: argparse.Namespace) -> int:
    from workcell.record.read.compare import compare
    from workcell.record.read.review import review as read

    if options.png or options.html:
        options.parser.error("--png and --html draw one recording, not a comparison")
    first, second = (read(Path(path)) for path in options.file)
    comparison = compare(first, second)
    if options.json:
        print_json(comparison.to_json())
    else:
        console().print(comparison.table())
    return exit_codes.DONE if first.achieved and second.achieved else exit_codes.NOT_ACHIEVED
