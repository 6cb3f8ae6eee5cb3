"""What the solvers did for every query of a run: a log, time series over `solver_step`, and a document a query."""

from __future__ import annotations

import json
import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any

import numpy as np
from numpy.typing import NDArray

from workcell.ik.mechanisms.problem import MechanismProblem
from workcell.ik.mechanisms.result import MechanismResult
from workcell.ik.problem import IKProblem
from workcell.ik.result import IKResult
from workcell.ik.stages import SolverStage
from workcell.record.write.query_facts import mechanism_facts, query_facts
from workcell.record.write.rrd import Indexes, RrdWriter

LOG, QUERIES = "solver/log", "solver/queries"
RESIDUAL, CPU = "solver/log10_rank_residual", "solver/cpu_ms"
LEVEL = "DEBUG"
_SMALLEST = 1e-16
_LONGEST_NOTE = 200


@dataclass(slots=True)
class _Rows:
    """Rows that are not in the file yet: (simulated time, step, solver step) and a value each."""

    places: list[tuple[float, int, int]] = field(default_factory=list)
    values: list[Any] = field(default_factory=list)

    def add(self, place: tuple[float, int, int], value: Any) -> None:
        self.places.append(place)
        self.values.append(value)

    @property
    def indexes(self) -> Indexes:
        times, steps, solver_steps = zip(*self.places, strict=True)
        return np.array(times), np.array(steps, dtype=np.int64), np.array(solver_steps, dtype=np.int64)


class SolverLog:
    """Numbers queries and their stages as they come, and writes them when told to."""

    def __init__(self, writer: RrdWriter) -> None:
        self._writer = writer
        self._queries, self._step = 0, 0
        self._rows = {path: _Rows() for path in (LOG, QUERIES, RESIDUAL, CPU)}

    def add(
        self,
        what: str,
        problem: IKProblem,
        result: IKResult,
        when: tuple[float, int],
        cuboids: NDArray[np.int64] | None,
    ) -> None:
        """One answered query.

        Args:
            what: what was asked, in words.
            problem, result: the query and its answer.
            when: simulated seconds and step.
            cuboids: (m,) by sphere of the cover the number of the cuboid that the solver had it in (-1: none), or None.
        """
        facts = query_facts(problem, result)
        if cuboids is not None and problem.cover is not None:
            links = [problem.robot.link_names[link] for link in problem.cover.link]
            facts["cuboids"] = _by_link(links, cuboids)
        self._add(what, result, facts, when)

    def add_mechanism(
        self, what: str, problem: MechanismProblem, result: MechanismResult, when: tuple[float, int]
    ) -> None:
        """One answered question about a mechanism."""
        self._add(what, result, mechanism_facts(problem, result), when)

    def _add(
        self,
        what: str,
        result: IKResult | MechanismResult,
        facts: Mapping[str, Any],
        when: tuple[float, int],
    ) -> None:
        cpu_ms = 1e3 * float(result.stats.get("cpu_s", 0.0))
        head = f"query {self._queries}: {what}: {result.solver} {result.status.value}, {cpu_ms:.2f} ms"
        self._rows[LOG].add((*when, self._step), head)
        first = self._step
        for stage in result.stages:
            place = (*when, self._step)
            self._rows[LOG].add(place, _line(stage))
            self._rows[CPU].add(place, 1e3 * stage.cpu_s)
            if math.isfinite(stage.gap):
                self._rows[RESIDUAL].add(place, math.log10(max(stage.gap, _SMALLEST)))
            self._step += 1
        document: dict[str, Any] = {
            "query": self._queries,
            "what": what,
            "solver": result.solver,
            "status": result.status.value,
            "cpu_ms": round(cpu_ms, 4),
            "first_step": first,
            "stages": [_row(stage) for stage in result.stages],
            **facts,
        }
        self._rows[QUERIES].add((*when, first), json.dumps(document))
        self._queries += 1

    def send(self) -> None:
        """Hands what has been added to the writer."""
        for path, rows in self._rows.items():
            if not rows.values:
                continue
            if path == LOG:
                self._writer.send_texts(path, rows.indexes, rows.values, LEVEL)
            elif path == QUERIES:
                self._writer.send_documents(path, rows.indexes, rows.values)
            else:
                self._writer.send_scalars(path, rows.indexes, np.array(rows.values))
            self._rows[path] = _Rows()


def _row(stage: SolverStage) -> Mapping[str, Any]:
    """A stage for a document; what it does not know is left out."""
    row: dict[str, Any] = {"name": stage.name, "solver": stage.solver, "cpu_ms": round(1e3 * stage.cpu_s, 4)}
    if math.isfinite(stage.gap):
        row["residual"] = float(f"{stage.gap:.4g}")
    if stage.words:
        row["note"] = stage.words[:_LONGEST_NOTE]
    return row


def _line(stage: SolverStage) -> str:
    parts = [f"{1e3 * stage.cpu_s:.2f} ms"]
    if math.isfinite(stage.gap):
        parts.append(f"rank residual {stage.gap:.2e}")
    if stage.words:
        parts.append(stage.words[:_LONGEST_NOTE])
    return f"    {stage.solver}: {stage.name}: {', '.join(parts)}"


def _by_link(links: Sequence[str], cuboids: NDArray[np.int64]) -> dict[str, list[int]]:
    """The cuboids of each link's spheres."""
    used: dict[str, set[int]] = {}
    for link, cuboid in zip(links, cuboids, strict=True):
        if cuboid >= 0:
            used.setdefault(link, set()).add(int(cuboid))
    return {link: sorted(numbers) for link, numbers in used.items()}
