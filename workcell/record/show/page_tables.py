"""Tables of the HTML page."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from html import escape
from typing import TYPE_CHECKING

from workcell.record.read.cuboids import CUBOID_HEAD
from workcell.record.read.queries import Query, own_cuboids, stage_rows
from workcell.record.read.ways import WAY_HEAD

if TYPE_CHECKING:
    from workcell.record.read.review import Review

_QUERIES, _STAGES = 200, 60


def table(head: Sequence[str], rows: Iterable[Sequence[str]], numbers_from: int = 99) -> str:
    """Rows of HTML as a table; columns from `numbers_from` on hold numbers."""

    def line(tag: str, cells: Sequence[str]) -> str:
        kinds = [f'<{tag} class="n">' if k >= numbers_from else f"<{tag}>" for k in range(len(cells))]
        return "<tr>" + "".join(f"{k}{c}</{tag}>" for k, c in zip(kinds, cells, strict=True)) + "</tr>"

    top = line("th", head) if any(head) else ""
    return f"<table>{top}{''.join(line('td', row) for row in rows)}</table>"


def cuboid_section(review: Review) -> list[str]:
    """Which cuboids decided where each link could be; nothing where the recording does not tell."""
    if not (review.cuboid_words or review.cuboids):
        return []
    rows = [tuple(map(escape, (row.robot, row.link, *row.cells))) for row in review.cuboids]
    title = f"<h2>Cuboids in use (of {review.free_cuboids})</h2><p>{escape(review.cuboid_words)}</p>"
    return [title, *([table(("robot", "link", *CUBOID_HEAD), rows)] if rows else [])]


def way_section(review: Review) -> list[str]:
    """Who answered the queries of each way; nothing where the recording does not tell."""
    rows = [tuple(map(escape, row.cells)) for row in review.ways]
    head = f"<h2>Who planned</h2><p>{escape(review.ways_said)}</p>"
    told = (
        "cuboids: solved among them; programs: cone programs; step and turn: largest change of a joint (rad or m) and "
        "of a link's rotation (Frobenius norm) against its bound; time: share in which a robot was on the way"
    )
    return [head, table(WAY_HEAD, rows), f"<p>{escape(told)}</p>"] if rows else []


def solver_section(review: Review) -> list[str]:
    """What the solvers did, added up, and below it every query; nothing where the recording does not tell."""
    if not review.queries:
        return []
    rows, before = [], None
    for row in stage_rows(review.queries):
        what, before = "" if row.what == before else escape(row.what), row.what
        words = [escape(part) for part in (row.solver, row.stage, row.residuals, row.note)]
        rows.append((what, *words, str(row.count), f"{row.cpu_ms:.1f}"))
    head = ("asked for", "solver", "stage", "rank residual", "last note", "times", "CPU ms")
    each = [
        (
            str(query.number),
            escape(query.what),
            escape(f"{query.solver} {query.status}"),
            escape(_stages(query)),
        )
        for query in review.queries[:_QUERIES]
    ]
    left = len(review.queries) - len(each)
    more = f"<p>{left} more are in the recording.</p>" if left else ""
    return [
        "<h2>Solver stages</h2>",
        table(head, rows, numbers_from=5),
        *(f"<p>{escape(line)}</p>" for line in own_cuboids(review.queries)),
        "<details><summary>Query by query</summary>",
        table(("query", "asked for", "answer", "stages (CPU ms)"), each),
        f"{more}</details>",
    ]


def _stages(query: Query) -> str:
    return ", ".join(f"{stage.name} {stage.cpu_ms:.1f}" for stage in query.stages[:_STAGES])
