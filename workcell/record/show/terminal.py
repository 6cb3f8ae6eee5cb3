"""A review as text for a terminal."""

from __future__ import annotations

from typing import TYPE_CHECKING

from workcell.record.read.cuboids import CUBOID_HEAD
from workcell.record.read.metrics import label_of, unit_of
from workcell.record.read.paths import names_of
from workcell.record.read.queries import own_cuboids, stage_rows
from workcell.record.read.ways import WAY_HEAD

if TYPE_CHECKING:
    from rich.console import Group, RenderableType
    from rich.table import Table

    from workcell.record.read.metrics import MetricRow
    from workcell.record.read.review import Review

_STYLES = {"achieved": "bold green", "not achieved": "bold red", "incomplete": "bold yellow"}
_LEVELS = {"INFO": "", "WARN": "yellow", "ERROR": "red"}


def review_table(review: Review) -> Group:
    """Verdict, checks, metrics, events, contents and what is missing, one below the other."""
    from rich.console import Group
    from rich.markup import escape
    from rich.text import Text

    head = Text.assemble(
        (f"{review.task}: ", "bold"), (review.verdict, _STYLES[review.verdict]), f"  {review.reason}"
    )
    facts = [
        f"{key} {review.result[key]}"
        for key in ("robot", "planner", "seed", "status")
        if key in review.result
    ]
    parts: list[RenderableType] = [
        head,
        Text(", ".join([*facts, f"{review.duration:.2f} s simulated"]), style="dim"),
    ]
    for check in review.checks:
        mark, style = ("ok", "green") if check.passed else ("FAILED", "red")
        parts.append(Text.assemble(("  " + mark.ljust(7), style), f"{check.name}: {check.finding}"))
    if review.metrics:
        parts.append(_metrics_table(review))
    if review.cuboid_words or review.cuboids:
        parts += _cuboids(review)
    if review.queries:
        parts += [*_ways(review), *_solvers(review)]
    if review.events:
        parts.append(Text("Events", style="bold"))
        for line in review.events:
            parts.append(
                Text(f"  {line.time:8.2f} s  {line.level:5}  {line.text}", style=_LEVELS.get(line.level, ""))
            )
    parts.append(Text.from_markup(f"[bold]Contents[/bold]  {escape(_contents(review))}"))
    for item in review.missing:
        parts.append(Text(f"  missing: {item}", style="yellow"))
    return Group(*parts)


def _metrics_table(review: Review) -> Table:
    from rich.table import Table

    table = Table(title=None, box=None, pad_edge=True, header_style="bold")
    table.add_column("metric")
    for column in ("min", "at s", "max", "at s", "mean", "final"):
        table.add_column(column, justify="right")
    for row in review.metrics:
        table.add_row(*_cells(row))
    return table


def _cells(row: MetricRow) -> tuple[str, ...]:
    scale, unit = unit_of(row.name)
    values = [f"{scale * value:.3f}" for value in (row.minimum, row.maximum, row.mean, row.final)]
    name = f"{label_of(row.name)} [dim]{unit}[/dim]" if scale != 1.0 else row.name
    at_low, at_high = f"{row.time_of_minimum:.2f}", f"{row.time_of_maximum:.2f}"
    return (name, values[0], at_low, values[1], at_high, values[2], values[3])


def _cuboids(review: Review) -> list[RenderableType]:
    """Which cuboids decided where each link could be."""
    from rich.table import Table
    from rich.text import Text

    head = Text.assemble((f"Cuboids in use (of {review.free_cuboids})", "bold"), f"  {review.cuboid_words}")
    if not review.cuboids:
        return [head]
    table = Table(title=None, box=None, pad_edge=True, header_style="bold")
    for name in ("link", *CUBOID_HEAD):
        table.add_column(name, overflow="fold")
    several = len({row.robot for row in review.cuboids}) > 1
    for row in review.cuboids:
        table.add_row(f"{row.robot}/{row.link}" if several else row.link, *row.cells)
    return [head, table]


def _ways(review: Review) -> list[RenderableType]:
    """Who answered the queries of each way, and how near they came to the bounds on continuity."""
    from rich.table import Table
    from rich.text import Text

    table = Table(title=None, box=None, pad_edge=True, header_style="bold")
    for name in WAY_HEAD:
        words = name in ("way", "solved by")
        table.add_column(name, justify="left" if words else "right", overflow="fold", no_wrap=not words)
    for row in review.ways:
        table.add_row(*map(Text, row.cells))
    head = Text.assemble(("Who planned", "bold"), f"  {review.ways_said}")
    return [head, table]


def _solvers(review: Review) -> list[RenderableType]:
    """What the solvers did, stage by stage, for each thing that was asked."""
    from rich.text import Text

    rows = stage_rows(review.queries)
    wide = [
        max(len(name) for name in names) for names in zip(*((r.solver, r.stage) for r in rows), strict=True)
    ]
    parts: list[RenderableType] = [Text("Solver stages", style="bold")]
    before = None
    for row in rows:
        if row.what != before:
            parts.append(Text(f"  {row.what}"))
            before = row.what
        words = f"    {row.solver:{wide[0]}}  {row.stage:{wide[1]}} {row.count:5} x {row.cpu_ms:9.1f} ms"
        parts.append(Text(words + (f"  residual {row.residuals}" if row.residuals else ""), style="dim"))
    parts += [Text(f"  {line}", style="dim") for line in own_cuboids(review.queries)]
    return parts


def _contents(review: Review) -> str:
    """How many entities of each kind the file holds."""
    groups: dict[str, int] = {}
    for path in review.inventory:
        parts = names_of(path)
        if parts[0] == "world" and len(parts) > 2:
            name = f"{parts[1]}/{parts[2]}" if parts[1] == "robots" else parts[1]
        else:
            name = parts[0]
        groups[name] = groups.get(name, 0) + 1
    return ", ".join(f"{name} ({count})" for name, count in groups.items() if not name.startswith("__"))
