"""What a recording tells of its queries of inverse kinematics, and of the solvers' stages."""

from __future__ import annotations

import itertools
import json
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any, get_args

import numpy as np

from workcell.record.read.reader import Contents
from workcell.record.write.query_facts import Kind
from workcell.record.write.solver_log import LOG, QUERIES

_NAN = float("nan")


@dataclass(frozen=True, slots=True)
class RecordedStage:
    """One stage: its name, the solver at work, CPU milliseconds, the rank residual reached (nan: none), and a note."""

    name: str
    solver: str
    cpu_ms: float
    residual: float
    note: str


@dataclass(frozen=True, slots=True)
class Query:
    """One query, as far as its document tells.

    Attributes:
        number: in the order of answers.
        what: what was asked, the same for all queries of a way.
        solver, status: who answered, and how.
        cpu_ms: CPU milliseconds.
        first_step: number of its first stage on the timeline `solver_step`.
        stages: by which it was answered.
        cuboids: by link, those that the solver had the link's spheres in; empty: it used none.
        kind: `step` where continuity was asked for, else `goal`; None: not told, as nothing below in older layouts.
        in_cuboids: whether the answer was found among cuboids.
        sdps: cone programs that were solved for it.
        step, max_step: change of the joint that came nearest to its bound, and that bound; radians or metres.
        link_rotation, max_link_rotation: largest change of a link's world rotation (Eq. 75 of IKSPARK), and its bound.
    """

    number: int
    what: str
    solver: str
    status: str
    cpu_ms: float
    first_step: int
    stages: tuple[RecordedStage, ...]
    cuboids: dict[str, list[int]]
    kind: str | None = None
    in_cuboids: bool | None = None
    sdps: int | None = None
    step: float | None = None
    max_step: float | None = None
    link_rotation: float | None = None
    max_link_rotation: float | None = None

    @property
    def solved(self) -> bool:
        """Whether there was a verified configuration."""
        return self.status == "SOLVED"


@dataclass(frozen=True, slots=True)
class StageRow:
    """The stages of one name in the queries for one thing.

    Attributes:
        what: what was asked.
        solver, stage: who did what.
        count: how often.
        cpu_ms: CPU milliseconds, all together.
        largest, smallest: rank residuals reached by them; nan without.
        note: of the last.
    """

    what: str
    solver: str
    stage: str
    count: int
    cpu_ms: float
    largest: float
    smallest: float
    note: str

    @property
    def residuals(self) -> str:
        """The residuals in words."""
        if np.isnan(self.smallest):
            return ""
        if self.largest == self.smallest:
            return f"{self.smallest:.1e}"
        return f"{self.largest:.1e} to {self.smallest:.1e}"


def recorded_queries(contents: Contents) -> tuple[Query, ...]:
    """All queries in order; documents that can't be understood are left out."""
    entity = contents.entities.get(QUERIES)
    if entity is None:
        return ()
    found = []
    for text in entity.over_time("TextDocument:text")[1]:
        try:
            found.append(_query(json.loads(text[0])))
        except (ValueError, KeyError, TypeError, IndexError, AttributeError):
            continue
    return tuple(sorted(found, key=lambda query: query.number))


def lost_queries(contents: Contents, queries: Sequence[Query]) -> int:
    """How many queries the file speaks of, in documents or in the solvers' log, but can't be read."""
    documents, log = contents.entities.get(QUERIES), contents.entities.get(LOG)
    heads = [] if log is None else [text[0] for text in log.over_time("TextLog:text")[1] if text]
    told = (
        0 if documents is None else documents.rows(),
        sum(str(head).startswith("query ") for head in heads),
        max((query.number + 1 for query in queries), default=0),
    )
    return max(told) - len({query.number for query in queries})


def _query(document: dict[str, Any]) -> Query:
    stages = tuple(
        RecordedStage(
            str(row["name"]),
            str(row["solver"]),
            float(row["cpu_ms"]),
            float(row.get("residual", _NAN)),
            str(row.get("note", "")),
        )
        for row in document["stages"]
    )
    cuboids = {str(link): [int(n) for n in numbers] for link, numbers in document.get("cuboids", {}).items()}
    return Query(
        int(document["query"]),
        str(document["what"]),
        str(document["solver"]),
        str(document["status"]),
        float(document["cpu_ms"]),
        int(document["first_step"]),
        stages,
        cuboids,
        kind=kind if (kind := document.get("kind")) in get_args(Kind) else None,
        in_cuboids=inside if isinstance(inside := document.get("in_cuboids"), bool) else None,
        sdps=None if (sdps := _number(document, "sdps")) is None else int(sdps),
        step=_number(document, "step"),
        max_step=_number(document, "max_step"),
        link_rotation=_number(document, "link_rotation"),
        max_link_rotation=_number(document, "max_link_rotation"),
    )


def _number(document: dict[str, Any], name: str) -> float | None:
    """A finite number of a document; None where it is none."""
    value = document.get(name)
    if isinstance(value, bool) or not isinstance(value, int | float) or not np.isfinite(value):
        return None
    return float(value)


def stage_rows(queries: Sequence[Query]) -> tuple[StageRow, ...]:
    """The stages added up by what was asked, solver and name, in the order in which they first come."""
    groups: dict[tuple[str, str, str], list[RecordedStage]] = {}
    for query in queries:
        for stage in query.stages:
            groups.setdefault((query.what, stage.solver, stage.name), []).append(stage)
    order = list(dict.fromkeys(what for what, _, _ in groups))
    rows = []
    for (what, solver, name), stages in sorted(groups.items(), key=lambda item: order.index(item[0][0])):
        known = [stage.residual for stage in stages if not np.isnan(stage.residual)] or [_NAN]
        spent = sum(stage.cpu_ms for stage in stages)
        rows.append(StageRow(what, solver, name, len(stages), spent, max(known), min(known), stages[-1].note))
    return tuple(rows)


def summary(queries: Sequence[Query]) -> str:
    """How many queries were answered by whom, and how many solved."""
    by: dict[str, int] = {}
    for query in queries:
        by[query.solver] = by.get(query.solver, 0) + 1
    solved = sum(query.solved for query in queries)
    who = ", ".join(f"{count} by {name}" for name, count in by.items())
    return f"{len(queries)} queries ({who}), {solved} solved"


def own_cuboids(queries: Sequence[Query]) -> list[str]:
    """For each way whose solvers put spheres into cuboids: which links, which cuboids, in all its queries."""
    ways: dict[str, dict[str, set[int]]] = {}
    for query in queries:
        for link, numbers in query.cuboids.items():
            ways.setdefault(query.what, {}).setdefault(link, set()).update(numbers)
    return [f"{what}: {_places(links)}" for what, links in ways.items()]


def _places(links: dict[str, set[int]]) -> str:
    """Links with their cuboids; of neighbours that share them, the first and the last."""
    runs = [(list(run), shared) for shared, run in itertools.groupby(links, key=lambda link: links[link])]
    return ", ".join(
        (run[0] if len(run) == 1 else f"{run[0]} to {run[-1]}")
        + f" in {' and '.join(map(str, sorted(shared)))}"
        for run, shared in runs
    )
