"""What is answered to a question about a mechanism."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from types import MappingProxyType

import numpy as np

from workcell.errors import NotSolvedError
from workcell.ik.certificate import Certificate
from workcell.ik.problem import Clearance
from workcell.ik.result import Status
from workcell.ik.stages import SolverStage
from workcell.pose import Array, read_only

NAN = float("nan")


@dataclass(frozen=True, slots=True)
class Measured:
    """What the judge measured at a configuration, and what is wrong with it.

    Attributes:
        position_error, rotation_error: worst of all goals, metres and radians.
        closure_error: worst that a tie misses, metres (radians), as MuJoCo has it where there is a compiled model.
        region_error: metres that the worst point is outside its region.
        limit_error: radians or metres by which the worst joint is outside its limits.
        clearance: smallest signed distance, and the pair that has it; inf where nothing was looked at.
        looked_at: how many pairs of geoms (or spheres) the clearance is of.
        reasons: what is wrong, in words; empty: it is an answer.
    """

    position_error: float = 0.0
    rotation_error: float = 0.0
    closure_error: float = 0.0
    region_error: float = 0.0
    limit_error: float = 0.0
    clearance: Clearance = field(default_factory=lambda: Clearance(float("inf")))
    looked_at: int = 0
    reasons: tuple[str, ...] = ()

    @property
    def accepted(self) -> bool:
        """Whether everything holds."""
        return not self.reasons


@dataclass(frozen=True, slots=True)
class MechanismCandidate:
    """What a solver proposes, before anybody has checked it.

    Attributes:
        q: (size,) a configuration believed to be an answer; None: none was found.
        certificate: a proof that there is none; None: there is no proof.
        stats: numbers about the work done.
        rejected: why near misses failed, in words.
        error: a numerical failure, in words.
        stages: what was done, in order: every step of the rank minimisation with its gap.
        bound: a lower bound on the cost that no configuration can be below (Problem 2b); nan: none was asked for.
        bound_certificate: what proves it.
        by: the name of the part of the solver that found it, where that has one of its own; empty: the solver's.
    """

    q: Array | None = None
    certificate: Certificate | None = None
    stats: Mapping[str, float] = field(default_factory=dict)
    rejected: tuple[str, ...] = ()
    error: str | None = None
    stages: tuple[SolverStage, ...] = ()
    bound: float = NAN
    bound_certificate: Certificate | None = None
    by: str = ""


@dataclass(frozen=True, slots=True)
class MechanismResult:
    """The answer to a `MechanismProblem`.

    Attributes:
        status: see `Status`; SOLVED was awarded by the judge, a "no" by a re-checked proof.
        solver: whose answer it is.
        q: (size,) the verified configuration; None: there is none.
        measured: what the judge measured there; None without a configuration.
        certificate: the re-checked proof behind a "no".
        cost: squared pose error of the closest configuration (Eq. 36); nan where the closest was not asked for.
        bound: what no configuration can be below, re-checked; the closest one is proved to be that good but for
            `cost - bound`.
        stats, rejected, stages: as of `MechanismCandidate`.
    """

    status: Status
    solver: str
    q: Array | None = None
    measured: Measured | None = None
    certificate: Certificate | None = None
    cost: float = NAN
    bound: float = NAN
    stats: Mapping[str, float] = field(default_factory=dict)
    rejected: tuple[str, ...] = ()
    stages: tuple[SolverStage, ...] = ()

    def __post_init__(self) -> None:
        if self.q is not None:
            object.__setattr__(self, "q", read_only(self.q))
        object.__setattr__(self, "stats", MappingProxyType(dict(self.stats)))

    @property
    def solved(self) -> bool:
        """Whether there is a verified configuration."""
        return self.status is Status.SOLVED

    @property
    def gap(self) -> float:
        """By how much the closest configuration's cost exceeds what is proved to be the least; nan: unknown."""
        return float(np.subtract(self.cost, self.bound))

    def unwrap(self) -> Array:
        """The verified configuration (size,); raises NotSolvedError with the status's sentence otherwise."""
        if self.q is None or not self.solved:
            because = f" Rejected: {'; '.join(self.rejected[:3])}." if self.rejected else ""
            raise NotSolvedError(f"{self.status.value}: {self.status.sentence}{because}")
        return np.array(self.q)
