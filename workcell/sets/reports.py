"""What a run over a problem set, or a re-check of its answers, came to."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field
from typing import Any

import numpy as np

from workcell.ik.result import Status


@dataclass(frozen=True, slots=True)
class SolveSummary:
    """What a run over a problem set came to.

    Attributes:
        set, robot, solver, seed: what was run.
        statuses: how many problems ended with each status.
        solvers: how many answers came from each solver.
        cpu_s: (n,) CPU seconds a problem, solving and verification.
        wall_s: of the whole run.
    """

    set: str
    robot: str
    solver: str
    seed: int
    statuses: dict[str, int]
    solvers: dict[str, int]
    cpu_s: tuple[float, ...]
    wall_s: float

    def to_json(self) -> dict[str, Any]:
        """A plain dictionary."""
        return {
            "set": self.set,
            "robot": self.robot,
            "solver": self.solver,
            "seed": self.seed,
            "n": len(self.cpu_s),
            "statuses": dict(self.statuses),
            "answered_by": dict(self.solvers),
            **cpu_columns(self.cpu_s),
            "wall_s": self.wall_s,
        }

    def rows(self) -> list[tuple[str, object]]:
        """(label, value) for a table."""
        mean, median, p95 = cpu_figures(self.cpu_s)
        return [
            ("problems", len(self.cpu_s)),
            *(
                (status.value, self.statuses[status.value])
                for status in Status
                if status.value in self.statuses
            ),
            *((f"answered by {name}", count) for name, count in self.solvers.items()),
            ("CPU ms, mean", mean),
            ("CPU ms, median", median),
            ("CPU ms, 95 %", p95),
            ("wall s", self.wall_s),
        ]


@dataclass(slots=True)
class VerifyReport:
    """What a re-check of answers came to: how many hold, and which were refused, why.

    `certified` counts those of the solved that came with a proof of their own, `twice` the answers that the exact
    checker was asked about as well, and accepts.
    """

    problems: int
    solved: int = 0
    certified: int = 0
    twice: int = 0
    proved: int = 0
    unanswered: int = 0
    refused: list[str] = field(default_factory=list)
    position_error: float = 0.0
    rotation_error: float = 0.0
    clearance: float = float("inf")

    @property
    def missing(self) -> int:
        """Problems without a line."""
        return self.problems - self.solved - self.proved - self.unanswered

    def to_json(self) -> dict[str, Any]:
        """A plain dictionary; errors and clearance are the worst of the accepted configurations."""
        return {
            "problems": self.problems,
            "solved": self.solved,
            "certified": self.certified,
            "checked_twice": self.twice,
            "proved": self.proved,
            "unanswered": self.unanswered,
            "missing": self.missing,
            "refused": list(self.refused),
            "max_position_error_m": self.position_error if self.solved else None,
            "max_rotation_error_rad": self.rotation_error if self.solved else None,
            "min_clearance_m": self.clearance if np.isfinite(self.clearance) else None,
        }

    def rows(self) -> list[tuple[str, object]]:
        """(label, value) for a table."""
        figures = self.to_json()
        figures["refused"] = len(self.refused)
        return [(name.replace("_", " "), value) for name, value in figures.items()]


def cpu_columns(cpu_s: Sequence[float]) -> dict[str, float]:
    """The columns of a table that say what a problem costs: mean, median and 95th percentile, in milliseconds."""
    mean, median, p95 = cpu_figures(cpu_s)
    return {"cpu_ms_mean": mean, "cpu_ms_median": median, "cpu_ms_p95": p95}


def cpu_figures(cpu_s: Sequence[float]) -> tuple[float, float, float]:
    """Mean, median and 95th percentile in milliseconds; nan without any."""
    if not len(cpu_s):
        return (float("nan"),) * 3
    ms = 1e3 * np.array(cpu_s)
    return float(ms.mean()), float(np.median(ms)), float(np.percentile(ms, 95))
