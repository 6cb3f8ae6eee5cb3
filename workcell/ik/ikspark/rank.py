"""Rank recovery (IKSPARK, section VI): from a point of the convex set to one where every block has rank 1."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from typing import Protocol

import numpy as np

from workcell.ik.ikspark.lift import Lift
from workcell.ik.shared.conic import ConicSolution, smat, svec
from workcell.ik.shared.convex import SLOW
from workcell.pose import Array

RANK_GAP = 1e-5
"""eps_1 of Algorithm 1: a block counts as rank 1 when its largest eigenvalue is within this of its trace."""
LONGEST = 30


class ConvexSet(Protocol):
    """What an ascent needs to know: the lifted variables, and the minimiser of a linear function of them."""

    @property
    def lift(self) -> Lift:
        """The meaning of the variables."""
        ...

    def solve(self, q: Array) -> ConicSolution:
        """Minimise q.x over the set, x (N,)."""
        ...


@dataclass(frozen=True, slots=True)
class Iterate:
    """One solve of an ascent.

    Attributes:
        x: (N,) the point, or None when the set is empty or the solver failed.
        gap: largest rank gap of its blocks.
        ray: (rows,) a Farkas ray when the set was found empty, else None.
    """

    x: Array | None
    gap: float = 1.0
    ray: Array | None = None

    @property
    def rank_one(self) -> bool:
        """Whether the point is a configuration."""
        return self.x is not None and self.gap < RANK_GAP


def linearise(lift: Lift, x: Array) -> tuple[Array, Array]:
    """Rank gaps (blocks,) at x and the gradient (N,) of the sum of largest eigenvalues (and of disc radii) there."""
    gradient = np.zeros(lift.size)
    balls = 10 * len(lift.balls)
    values, vectors = np.linalg.eigh(smat(x[:balls].reshape(-1, 10), 4))
    top = vectors[:, :, -1]
    gradient[:balls] = svec(top[:, :, None] * top[:, None, :]).ravel()
    planar = x[balls:].reshape(-1, 2)
    radius = np.linalg.norm(planar, axis=1)
    gradient[balls:] = (planar / np.maximum(radius, 1e-9)[:, None]).ravel()
    return np.concatenate([1.0 - values[:, -1], 1.0 - radius]), gradient


def ascend(convex: ConvexSet, direction: Array) -> Iterator[Iterate]:
    """Algorithm 1 with Problem 3, from the point farthest along `direction` (N,); ends at rank 1 or when it is slow."""
    before = np.inf
    for step in range(LONGEST):
        solution = convex.solve(-direction)
        if solution.status == "infeasible":
            yield Iterate(None, ray=solution.z)
            return
        if not solution.usable:
            yield Iterate(None)
            return
        gaps, direction = linearise(convex.lift, solution.x)
        iterate = Iterate(solution.x, float(gaps.max(initial=0.0)))
        yield iterate
        left = float(gaps.sum())
        if iterate.rank_one or (step > 0 and left > SLOW * before):
            return
        before = left
