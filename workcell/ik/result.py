"""`Status`, `IKResult` and what solvers hand to `verify`.

Only `verify` awards `SOLVED`, only a re-checked certificate a "no".
"""

from __future__ import annotations

import enum
from collections.abc import Mapping
from dataclasses import dataclass, field
from types import MappingProxyType

import numpy as np
from numpy.typing import NDArray

from workcell.errors import NotSolvedError
from workcell.geometry.types import FreeSpace
from workcell.ik.certificate import Certificate
from workcell.ik.problem import Checks, Clearance
from workcell.ik.stages import SolverStage
from workcell.pose import Array, read_only

NEAR_MISSES = 5
"""Near misses whose reasons a solver reports."""


class Status(enum.Enum):
    """How a query ended; `sentence` says what that means and what to do."""

    SOLVED = "SOLVED"
    UNREACHABLE = "UNREACHABLE"
    BLOCKED = "BLOCKED"
    BLOCKED_IN_MODEL = "BLOCKED_IN_MODEL"
    NOT_FOUND = "NOT_FOUND"
    SOLVER_ERROR = "SOLVER_ERROR"

    @property
    def sentence(self) -> str:
        """The status in words, with its remedy."""
        return _SENTENCES[self]

    @property
    def is_proof(self) -> bool:
        """Whether the status says that no solution exists (in the scope it names)."""
        return self in (Status.UNREACHABLE, Status.BLOCKED, Status.BLOCKED_IN_MODEL)

    @property
    def is_impossible(self) -> bool:
        """Whether the status says that no solution exists in reality, not only in a conservative model of it."""
        return self in (Status.UNREACHABLE, Status.BLOCKED)


_SENTENCES = {
    Status.SOLVED: "A configuration that reaches the target was found and independently verified.",
    Status.UNREACHABLE: "Kinematics alone forbids the target: no configuration within the joint limits reaches it. "
    "Move the target or the robot's base, or widen the joint limits.",
    Status.BLOCKED: "Obstacles, or the robot itself, forbid the target: no configuration that reaches it has the "
    "clearance that its proof names. Move the target or an obstacle.",
    Status.BLOCKED_IN_MODEL: "No configuration exists in the conservative model (outer spheres, inner free space); "
    "the real geometry may still allow one. Use a finer sphere cover or more free-space cuboids.",
    Status.NOT_FOUND: "The budget was spent without a solution and without a proof that there is none. "
    "Raise the budget, try another seed or solver.",
    Status.SOLVER_ERROR: "The numerical solver failed. Try another solver, and please report the problem.",
}


@dataclass(frozen=True, slots=True)
class Candidate:
    """What a solver proposes, before anybody has checked it.

    Attributes:
        q: (n,) a configuration believed to solve the problem, or None.
        certificate: a proof that there is none, or None.
        stats: numbers about the work done (iterations, restarts, SDPs, residuals ...).
        rejected: why near misses failed, in words.
        error: a numerical failure, in words, or None.
        stages: what was done, in order, with the time of each step; empty where the solver has but one.
        cuboids: (m,) by sphere of the cover, the cuboid of `free_space`, then its polytopes, that the solver had it in
            at `q` (-1: in none); None: the answer was not found among cuboids.
        free_space: what `cuboids` are of: the problem's own, or with what the solver has made besides.
        by: the name of the part of the solver that found it, where that has one of its own; empty: the solver's.
    """

    q: Array | None = None
    certificate: Certificate | None = None
    stats: Mapping[str, float] = field(default_factory=dict)
    rejected: tuple[str, ...] = ()
    error: str | None = None
    stages: tuple[SolverStage, ...] = ()
    cuboids: NDArray[np.int64] | None = None
    free_space: FreeSpace | None = None
    by: str = ""


@dataclass(frozen=True, slots=True)
class IKResult:
    """The answer to an `IKProblem`.

    Attributes:
        status: see `Status`.
        q: (n,) the verified configuration, or None.
        position_error: metres at `q`; nan without one.
        rotation_error: radians at `q`; nan without one.
        clearance: smallest signed distance at `q` and the pair that has it; inf where nothing was checked.
        checks: what the judge looked at for it; None without a verified configuration.
        certificate: the re-checked proof behind a "no", or None.
        solver: the name of the solver, or of the part of it, that found the answer.
        stats: numbers about the work done, `cpu_s` and `time_s` among them.
        rejected: why near misses failed, in words.
        stages: what was done, in order, with the time of each step; verification is among them.
        cuboids, free_space: as of `Candidate`.
    """

    status: Status
    solver: str
    q: Array | None = None
    position_error: float = float("nan")
    rotation_error: float = float("nan")
    clearance: Clearance = field(default_factory=lambda: Clearance(float("nan")))
    certificate: Certificate | None = None
    stats: Mapping[str, float] = field(default_factory=dict)
    rejected: tuple[str, ...] = ()
    stages: tuple[SolverStage, ...] = ()
    cuboids: NDArray[np.int64] | None = None
    free_space: FreeSpace | None = None
    checks: Checks | None = None

    def __post_init__(self) -> None:
        if self.q is not None:
            object.__setattr__(self, "q", read_only(self.q))
        if self.cuboids is not None:
            object.__setattr__(self, "cuboids", read_only(self.cuboids, np.int64))
        object.__setattr__(self, "stats", MappingProxyType(dict(self.stats)))

    @property
    def sentence(self) -> str:
        """The status in words; of a configuration that was found, what it was checked for."""
        if self.checks is None:
            return self.status.sentence
        return f"{self.status.sentence} It is {self.checks.words}."

    @property
    def solved(self) -> bool:
        """Whether there is a verified configuration."""
        return self.status is Status.SOLVED

    def unwrap(self) -> Array:
        """The verified configuration (n,); raises NotSolvedError with the status's sentence otherwise."""
        if self.q is None or self.status is not Status.SOLVED:
            because = f" Rejected: {'; '.join(self.rejected[:3])}." if self.rejected else ""
            raise NotSolvedError(f"{self.status.value}: {self.status.sentence}{because}")
        return np.array(self.q)
