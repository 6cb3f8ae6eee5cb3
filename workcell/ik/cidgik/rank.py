"""Convex iteration (Problem 4 against Problem 5 in closed form): from random objectives to points of rank d."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from typing import Any, Protocol

import numpy as np

from workcell.ik.shared.conic import ConicSolution
from workcell.ik.shared.convex import SLOW
from workcell.pose import Array

Blocks = Any
"""A symmetric matrix (`Instance`), or a list of them (`ChordalInstance`): for Z as for C."""

RANK_GAP = 1e-5
"""Excess rank h(Z), the sum of all eigenvalues but the d largest, below which Z counts as a configuration."""
LONGEST = 12


class Relaxed(Protocol):
    """A relaxation at one query's goals: `Instance`, or `ChordalInstance` for long chains."""

    solves: int
    contradiction: bool

    @property
    def determined(self) -> bool:
        """Whether there is a single Z."""
        ...

    def solve(self, C: Blocks) -> ConicSolution:
        """Minimise <C, Z>."""
        ...

    def matrix(self, y: Array) -> Blocks:
        """Z of a solution's x."""
        ...

    def excess(self, Z: Blocks) -> tuple[float, Blocks]:
        """h(Z), and Problem 5's C there."""
        ...

    def nuclear(self) -> Blocks:
        """C = I."""
        ...

    def random_objective(self, rng: np.random.Generator) -> Blocks:
        """A random C."""
        ...

    def toward(self, q: Array) -> Blocks:
        """The C that is zero at a configuration."""
        ...

    def directions(self, Z: Blocks) -> dict[int, Array]:
        """By link, its basis directions (s, d)."""
        ...

    def release(self) -> None:
        """Hand back what queries share."""
        ...


class Kept(Protocol):
    """The workspace over a relaxation: `Keeper`, or `ChordalKeeper`."""

    @property
    def passing(self) -> bool:
        """Whether rows are loaded that not every solution keeps."""
        ...

    @property
    def conservative(self) -> bool:
        """Whether rows are loaded for spheres that cover solids: the solids themselves may allow more."""
        ...

    @property
    def left_out(self) -> int:
        """How many pairs of point and solid are not kept apart, and left to the judge."""
        ...

    def give_way(self) -> int:
        """Drop rows of spheres that may stick out of the robot by as much as they overlap solids; how many."""
        ...

    def forget_passing(self) -> None:
        """At a restart."""
        ...

    def add_broken(self, Z: Blocks) -> int:
        """Rows for what points break."""
        ...

    def add_cut_off(self, Z: Blocks) -> int:
        """Rows for what Z breaks."""
        ...


@dataclass(frozen=True, slots=True)
class Iterate:
    """One solve.

    Attributes:
        Z: the point, or None when the set is empty or the solver failed.
        gap: excess rank.
        ray: the dual ray when the set was found empty.
        C: the objective that Problem 5 gives there.
    """

    Z: Blocks | None
    gap: float = np.inf
    ray: Array | None = None
    C: Blocks | None = None

    @property
    def low_rank(self) -> bool:
        """Whether the point is a configuration."""
        return self.gap < RANK_GAP


def converge(instance: Relaxed, C: Blocks) -> Iterator[Iterate]:
    """Algorithm 1 from an objective; ends at rank d, or when it is slow."""
    before = np.inf
    for step in range(LONGEST):
        solution = instance.solve(C)
        if solution.status == "infeasible":
            yield Iterate(None, ray=solution.z)
            return
        if not solution.usable:
            yield Iterate(None)
            return
        Z = instance.matrix(solution.x)
        gap, C = instance.excess(Z)
        iterate = Iterate(Z, gap, C=C)
        yield iterate
        if iterate.low_rank or (step > 1 and gap > SLOW * before):
            return
        before = gap
