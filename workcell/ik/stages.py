"""What a solver did, stage by stage, with the CPU time of each."""

from __future__ import annotations

from collections import deque
from collections.abc import Mapping
from dataclasses import dataclass, field, replace

from workcell import clock

KEPT = 100
"""Stages of one query, from its beginning and from its end, that are kept one by one; those between are added up."""

NO_GAP = float("nan")
_WORTH_TELLING = 1e-4


@dataclass(frozen=True, slots=True)
class SolverStage:
    """One step of the work on a query.

    Attributes:
        name: `relaxation` (the first point of a restart), `rank reduction` (the points after it), `snap` (the
            configuration read from a point of low rank, and polished), `judge`, `verify`, `sampling`, ...
        cpu_s: seconds of CPU time of the process.
        gap: rank residual of the point that was reached: the largest of 1 - (largest eigenvalue / trace) of IKSPARK's
            blocks, or CIDGIK's excess rank; nan where there is no such point.
        note: what came of it, in words.
        numbers: counts of the work, such as restarts or nodes.
        solver: whose work it was.
    """

    name: str
    cpu_s: float
    gap: float = NO_GAP
    note: str = ""
    numbers: Mapping[str, float] = field(default_factory=dict)
    solver: str = ""

    @property
    def words(self) -> str:
        """The note, and the counts that are not zero."""
        counts = (f"{value:.4g} {name.replace('_', ' ')}" for name, value in self.numbers.items() if value)
        return "; ".join(part for part in (self.note, ", ".join(counts)) if part)


class StageLog:
    """Collects stages; each takes the CPU time since the one before it."""

    def __init__(self) -> None:
        self._first: list[SolverStage] = []
        self._last: deque[SolverStage] = deque()
        self._between, self._between_cpu_s = 0, 0.0
        self._since = clock.cpu_seconds()

    def add(
        self,
        name: str,
        *,
        gap: float = NO_GAP,
        note: str = "",
        numbers: Mapping[str, float] | None = None,
        solver: str = "",
    ) -> None:
        """The stage that has just ended."""
        now = clock.cpu_seconds()
        self._append(SolverStage(name, now - self._since, gap, note, numbers or {}, solver))
        self._since = now

    def add_point(self, step: int, gap: float | None, empty: bool, note: str) -> None:
        """A cone program of a series that drives the rank down: the `step`-th of its restart.

        Args:
            gap: rank residual of the point that it found; None: it found none.
            empty: whether a ray shows that there is none.
        """
        if gap is None:
            note += ": the set is empty" if empty else ": no point"
        self.add("rank reduction" if step else "relaxation", gap=NO_GAP if gap is None else gap, note=note)

    def extend(self, stages: tuple[SolverStage, ...], solver: str, cpu_s: float) -> None:
        """Stages that a solver has timed itself, and before them what it took besides of `cpu_s`.

        The clock goes on from now.
        """
        besides = cpu_s - sum(stage.cpu_s for stage in stages)
        if besides > _WORTH_TELLING:
            self._append(SolverStage("set-up", besides, solver=solver))
        for stage in stages:
            self._append(replace(stage, solver=stage.solver or solver))
        self._since = clock.cpu_seconds()

    def _append(self, stage: SolverStage) -> None:
        if len(self._first) < KEPT:
            self._first.append(stage)
            return
        self._last.append(stage)
        if len(self._last) > KEPT:
            self._between += 1
            self._between_cpu_s += self._last.popleft().cpu_s

    @property
    def stages(self) -> tuple[SolverStage, ...]:
        """What has been collected, in order."""
        if not self._between:
            return (*self._first, *self._last)
        folded = SolverStage("more of these", self._between_cpu_s, numbers={"stages": self._between})
        return (*self._first, replace(folded, solver=self._first[-1].solver), *self._last)
