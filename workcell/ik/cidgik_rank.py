"""Convex iteration (Problem 4 against Problem 5 in closed form): from random objectives to points of rank d."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np

from workcell.ik.cidgik_instance import Instance
from workcell.pose import Array

RANK_GAP = 1e-5
"""Excess rank h(Z), the sum of all eigenvalues but the d largest, below which Z counts as a configuration."""
LONGEST = 12
SLOW = 0.8
"""An iteration is given up when a step leaves more than this share of the excess rank."""


@dataclass(frozen=True, slots=True)
class Iterate:
    """One solve.

    Attributes:
        Z: (N, N), or None when the set is empty or the solver failed.
        gap: excess rank.
        ray: the dual ray when the set was found empty.
        C: the objective that Problem 5 gives there.
    """

    Z: Array | None
    gap: float = np.inf
    ray: Array | None = None
    C: Array | None = None

    @property
    def low_rank(self) -> bool:
        """Whether the point is a configuration."""
        return self.gap < RANK_GAP


def converge(instance: Instance, C: Array) -> Iterator[Iterate]:
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
