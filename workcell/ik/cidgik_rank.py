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


def excess(instance: Instance, Z: Array) -> tuple[float, Array]:
    """h(Z) in the points' metric, and the objective C = U U^T of Problem 5 pulled back to Z's basis."""
    L, d = instance.metric, instance.structure.skeleton.dimension
    values, vectors = np.linalg.eigh(L.T @ Z @ L)
    U = L @ vectors[:, :-d]
    return float(values[:-d].sum()), U @ U.T


def nuclear(instance: Instance) -> Array:
    """C = I over all points: the nuclear norm."""
    L = instance.metric
    C: Array = L @ L.T
    return C


def random_objective(instance: Instance, rng: np.random.Generator) -> Array:
    """A Wishart matrix of random rank over all points."""
    L = instance.metric
    order = len(L)
    R = L @ rng.standard_normal((order, int(rng.integers(1, order + 1))))
    C: Array = R @ R.T / order
    return C


def toward(instance: Instance, X: Array) -> Array:
    """The objective that is zero at the configuration with basis X (r, d)."""
    d = X.shape[1]
    full = np.vstack([X, np.eye(d)])[instance.structure.keep]
    return excess(instance, full @ full.T)[1]


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
        gap, C = excess(instance, Z)
        iterate = Iterate(Z, gap, C=C)
        yield iterate
        if iterate.low_rank or (step > 1 and gap > SLOW * before):
            return
        before = gap
