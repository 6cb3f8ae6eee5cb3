"""What a recording tells of its queries of inverse kinematics, and of the solvers' stages."""

from __future__ import annotations

import json
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from workcell.record.read.reader import Contents
from workcell.record.write.solver_log import QUERIES

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
    """One query: its number, what was asked, who answered how, in how many CPU milliseconds, and by which stages.

    `first_step` is the number of its first stage on the timeline `solver_step`; `cuboids` are, by link, those that the
    solver itself had the link's spheres in (empty: it used none).
    """

    number: int
    what: str
    solver: str
    status: str
    cpu_ms: float
    first_step: int
    stages: tuple[RecordedStage, ...]
    cuboids: dict[str, list[int]]


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
    )


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
    solved = sum(query.status == "SOLVED" for query in queries)
    who = ", ".join(f"{count} by {name}" for name, count in by.items())
    return f"{len(queries)} queries ({who}), {solved} solved"


def own_cuboids(queries: Sequence[Query]) -> list[str]:
    """For each query whose solver put spheres into cuboids itself: which links, which cuboids."""
    lines = []
    for query in queries:
        if query.cuboids:
            places = ", ".join(
                f"{link} in {' and '.join(map(str, numbers))}" for link, numbers in query.cuboids.items()
            )
            lines.append(f"{query.what}: {query.solver} had {places}")
    return lines
