"""Restart by line search (IKSPARK, Algorithm 2): from where an ascent got stuck through the set to elsewhere.

The paper leaves open how the direction M is found along which the stuck point Y can move. Here the line runs through a
neighbour of a point inside the set, which a program without an objective finds once for a query, and on to where it
leaves the set. What that neighbour is, is drawn, among the points that keep the equalities.
"""

from __future__ import annotations

import numpy as np

from workcell.ik.ikspark.instance import Instance
from workcell.ik.shared.conic import Cones, smat
from workcell.pose import Array

STRIDE = 0.1
"""Eta of Algorithm 2: the step along M, of which the whole leads to the neighbour of the inner point."""
MOST_STRIDES = 60
ASIDE = 0.5
"""How far the neighbour is from the inner point at first, of the latter's distance from the stuck point."""
HALVINGS = 6
_LEAST = 1e-7
"""Lengths and singular values below which they count as none."""
_OUTSIDE = 1e-5
"""By how much a row may be broken: programs are solved to a tenth of that, relative to what is in them."""


class LineRestarts:
    """Restarts of one query.

    Attributes:
        programs: cone programs that were solved for it so far.
    """

    def __init__(self, instance: Instance, rng: np.random.Generator) -> None:
        self._instance, self._rng, self.programs = instance, rng, 0
        self._A, self._b = instance.numbers()
        self._cones = instance.solved_cones
        self._inner: Array | None = None
        self._free = np.zeros((instance.lift.size, 0))

    def beyond(self, stuck: Array) -> Array | None:
        """A point (N,) of the set on a random line from `stuck` (N,) through its inside; None: none is found."""
        if self._inner is None and not self._enter():
            return None
        assert self._inner is not None
        ahead = self._inner - stuck
        aside = self._free @ self._rng.standard_normal(self._free.shape[1])
        aside *= ASIDE * np.linalg.norm(ahead) / max(float(np.linalg.norm(aside)), _LEAST)
        for _ in range(HALVINGS):
            if self.holds(stuck + STRIDE * (ahead + aside)):
                return self._last_on(stuck, ahead + aside)
            aside *= 0.5
        return None

    def holds(self, x: Array) -> bool:
        """Whether a point (N,) keeps all rows of the set, as far as programs are solved."""
        return violation(self._cones, self._b - self._A @ x) <= _OUTSIDE

    def _last_on(self, stuck: Array, along: Array) -> Array:
        """The last point inside, stride by stride."""
        strides = 1
        while strides < MOST_STRIDES and self.holds(stuck + (strides + 1) * STRIDE * along):
            strides += 1
        last: Array = stuck + strides * STRIDE * along
        return last

    def _enter(self) -> bool:
        """Find the inner point, and the directions that keep the equalities."""
        zero = self._cones.zero
        solution = self._instance.solve(np.zeros(self._instance.lift.size))
        self.programs += 1
        if not solution.usable:
            return False
        _, values, right = np.linalg.svd(self._A[:zero])
        rank = int(np.count_nonzero(values > _LEAST))
        self._inner, self._free = solution.x, right[rank:].T
        return True


def violation(cones: Cones, slack: Array) -> float:
    """By how much `slack` (rows,) is outside of a cone by its worst row, second-order cone or triangle; 0: inside."""
    at = cones.zero + cones.nonneg
    worst = float(np.abs(slack[: cones.zero]).max(initial=0.0))
    worst = max(worst, -float(slack[cones.zero : at].min(initial=0.0)))
    for size in cones.soc:
        worst = max(worst, float(np.linalg.norm(slack[at + 1 : at + size]) - slack[at]))
        at += size
    for order in cones.psd:
        size = order * (order + 1) // 2
        worst = max(worst, -float(np.linalg.eigvalsh(smat(slack[at : at + size], order))[0]))
        at += size
    return worst
