"""What is asked of a planner in joint space, and what it answers."""

from __future__ import annotations

import enum
from dataclasses import dataclass

import numpy as np

from workcell.errors import InputError
from workcell.motion.path import Path
from workcell.motion.proofs.on_model import Proof


class PlanStatus(enum.Enum):
    """How planning ended."""

    PLANNED = "PLANNED"
    NOT_FOUND = "NOT_FOUND"

    @property
    def sentence(self) -> str:
        """The status in words, with its remedy."""
        if self is PlanStatus.PLANNED:
            return "A path was found and proved clear over its whole length."
        return (
            "The budget was spent without a clear path. Raise the iterations, lower the clearance, "
            "or try another seed."
        )


@dataclass(frozen=True, slots=True)
class PlanSettings:
    """How to search.

    Attributes:
        clearance: metres to keep along the path.
        spare: clearance that samples keep on top of that (less where start or goal have less), for the proof to use.
        step: largest joint step of one tree edge (L-infinity, radians).
        resolution: joint step between the configurations of an edge that are looked at while the trees grow.
        iterations: tree extensions to spend.
        shortcuts: pairs of points that are tried for a shortcut.
        attempts: searches, each with samples twice as dense as the one before.
        optimise_s: CPU seconds to spend on shorter paths once there is one, where spheres and pieces are known
            (`plan_in_world`); 0: none.
        optimise_iterations: samples to draw for that, at most; with `optimise_s` inf the result depends on nothing
            else.
    """

    clearance: float = 0.0
    spare: float = 0.005
    step: float = 0.3
    resolution: float = 0.05
    iterations: int = 3000
    shortcuts: int = 60
    attempts: int = 4
    optimise_s: float = 0.0
    optimise_iterations: int = 100_000_000

    def __post_init__(self) -> None:
        steps = np.array([self.step, self.resolution])
        if not (np.all(steps > 0) and np.all(np.isfinite(steps)) and min(self.iterations, self.attempts) > 0):
            raise InputError(
                "step, resolution, iterations and attempts of a planner must be positive, and finite",
                where="settings",
            )
        if self.shortcuts < 0:
            raise InputError(
                f"{self.shortcuts} shortcuts can't be tried", where="settings", remedy="0 or more"
            )
        if not (np.isfinite(self.clearance) and np.isfinite(self.spare) and self.spare >= 0):
            raise InputError(
                f"a clearance of {self.clearance} m with {self.spare} m to spare can't be kept",
                where="settings",
            )
        if not (self.optimise_s >= 0 and self.optimise_iterations >= 0):
            raise InputError(
                f"{self.optimise_s} s and {self.optimise_iterations} samples can't be spent on shorter paths",
                where="settings",
                remedy="0 or more",
            )


@dataclass(frozen=True, slots=True)
class Optimised:
    """What looking for shorter paths came to; lengths in radians (L2 of all joints together).

    Attributes:
        first_length: of the path that was found first.
        length: of the path returned.
        lower_bound: the straight line to the nearest goal; no path to any of the goals is shorter.
        iterations: samples drawn.
        cpu_s: CPU seconds spent.
    """

    first_length: float
    length: float
    lower_bound: float
    iterations: int
    cpu_s: float


@dataclass(frozen=True, slots=True)
class PlanResult:
    """A proved path, or why there is none.

    Attributes:
        status: see `PlanStatus`.
        path: proved clear; None when not found.
        proof: of the path; None when not found.
        detail: what stood in the way, in words; empty when planned.
        iterations: tree extensions spent; 0 when the straight line was clear.
        evaluations: collision queries spent.
        optimised: what optimising came to; None where it was not asked for, or not possible.
    """

    status: PlanStatus
    path: Path | None
    proof: Proof | None
    detail: str
    iterations: int
    evaluations: int
    optimised: Optimised | None = None

    @property
    def planned(self) -> bool:
        """Whether there is a path."""
        return self.status is PlanStatus.PLANNED
