"""Problem 4: towards rank 1 with the least cost, every step cutting what is missing by a factor c.

Of largest eigenvalues, which are convex, a linearisation is a lower bound: where it says that what is missing is at
most c times what it was, it is so (Prop. 9). Blocks and discs are counted together; slides need no row of their own,
their blocks have rank 1 where those of their links have.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass

import numpy as np

from workcell.ik.ikspark.mechanisms.blocks import Blocks, linearise
from workcell.ik.ikspark.mechanisms.minimising.cost import CostProgram
from workcell.ik.ikspark.mechanisms.program import Program
from workcell.ik.ikspark.mechanisms.rows import Rows
from workcell.ik.ikspark.rank import RANK_GAP
from workcell.pose import Array

LARGEST = 0.95
"""The adaptive c at which a descent has stalled: there is next to nothing to gain nearby."""
LONGEST = 50
"""Steps of one descent."""
_WITHIN = 0.3
"""Share of what can be gained that is not asked for: less haste costs less, and there is room about the answer."""


@dataclass(frozen=True, slots=True)
class Reduction:
    """A point of a descent.

    Attributes:
        x: (N,) the point.
        gap: largest rank gap of its blocks and discs.
        left: w, the sum of the gaps.
        cost: f.
        c: what the step to it was asked to leave; nan of the first.
        asked: how often more was asked for than there was.
    """

    x: Array
    gap: float
    left: float
    cost: float
    c: float
    asked: int = 0

    @property
    def rank_one(self) -> bool:
        """Whether the point is a configuration."""
        return self.gap < RANK_GAP


class Descent:
    """Descents over one relaxation.

    Args:
        blocks: what is to be of rank 1.
        program: the set, with the cost.
        plain: the same set without it.
        first: c_0.
        fixed: c of all steps; None: adaptive.
        rows: further rows that hold from a point on; they may depend on it.
    """

    def __init__(
        self,
        blocks: Blocks,
        program: CostProgram,
        plain: Program,
        *,
        first: float,
        fixed: float | None = None,
        rows: Callable[[Array], Sequence[Rows]] = lambda _: (),
    ) -> None:
        self._blocks, self._program, self._plain = blocks, program, plain
        self._first, self._fixed, self._more = first, fixed, rows

    def run(self, x: Array) -> Iterator[Reduction]:
        """From a point (N,) on: itself, then one a step; ends at rank 1, where it stalls, or when Clarabel fails."""
        here, slope = self._reached(x, np.nan, 0)
        yield here
        for _ in range(LONGEST):
            if here.rank_one:
                return
            found = self._step(here, slope)
            if found is None:
                return
            here, slope = found
            yield here

    def _reached(self, x: Array, c: float, asked: int) -> tuple[Reduction, Array]:
        gaps, slope = linearise(self._blocks, x)
        gap, left = float(gaps.max(initial=0.0)), float(gaps.sum())
        return Reduction(x, gap, left, self._program.cost.at(x), c, asked), slope

    def _step(self, here: Reduction, slope: Array) -> tuple[Reduction, Array] | None:
        """The next point; None: none leaves as little as the largest c."""
        rows = list(self._more(here.x))
        c, asked = self._first if self._fixed is None else self._fixed, 0
        while c <= LARGEST or self._fixed is not None:
            wanted = float(slope @ here.x) + (1.0 - c) * here.left
            decrease = Rows("decrease", 0, "nonneg", np.append(slope, -wanted)[None])
            self._program.cut([decrease, *rows])
            solution = self._program.closest()
            if solution.usable:
                return self._reached(solution.x, c, asked)
            if self._fixed is not None:
                return None
            asked += 1
            c = self._next(here, slope, rows) if asked == 1 else 1.0 - (1.0 - c) * (1.0 - self._first)
        return None

    def _next(self, here: Reduction, slope: Array, rows: Sequence[Rows]) -> float:
        """The first c of the series `1 - (1 - c_0)^(p + 1)`, p = 1, 2, ..., that asks for no more than there is.

        Problem 3 tells how much that is; without it the c's before would be tried one by one.
        """
        self._plain.cut(rows)
        solution = self._plain.solve(-slope)
        gain = float(slope @ (solution.x - here.x)) if solution.usable else 0.0
        share = (1.0 - _WITHIN) * gain / here.left
        if not share > 1.0 - LARGEST:
            return 1.0
        p = max(int(np.ceil(np.log(min(share, 1.0)) / np.log1p(-self._first))), 2)
        return float(1.0 - (1.0 - self._first) ** p)
