"""Where a stalled ascent begins again: at a configuration, at an objective, or along a line (Algorithm 2).

Algorithm 2 goes on from the stalled point along a line, as far as the set reaches, and climbs from there. A line that
ends at another point of the set keeps all equalities; ours leads to the end of a random objective, and beyond it.
"""

from __future__ import annotations

from typing import Literal

import numpy as np

from workcell.errors import UnknownNameError
from workcell.ik.ikspark.mechanisms.blocks import Blocks, linearise
from workcell.ik.ikspark.mechanisms.program import Program
from workcell.pose import Array

Restart = Literal["configuration", "objective", "line"]
RESTARTS: tuple[Restart, ...] = ("configuration", "objective", "line")
"""At the lift of a random configuration (`directions`), at the end of a random objective, or along a line."""
STEP = 0.05
"""eta of Algorithm 2, as part of the way to the end of the objective."""
_FARTHEST = 200
"""Steps after which a line ends anyway."""
_INSIDE = 1e-6
"""What a point may miss to be in the set: the points that lines begin at are as exact as Clarabel makes them."""


class Restarts:
    """Directions from which ascents begin again.

    Args:
        kind: see `RESTARTS`.
        rng: of the objectives.

    Raises:
        UnknownNameError: no such kind.
    """

    def __init__(self, kind: Restart, rng: np.random.Generator) -> None:
        if kind not in RESTARTS:
            raise UnknownNameError("restart", kind, RESTARTS, where="restart")
        self._kind, self._rng = kind, rng

    def direction(
        self, blocks: Blocks, program: Program, stalled: Array | None, bounded: Array
    ) -> Array | None:
        """A direction (N,) to climb from the end of; None: a configuration's lift is wanted.

        Args:
            blocks: of the variables.
            program: the set.
            stalled: (N,) where the last ascent ended; None: there was none.
            bounded: (N,) one, or zero of what nothing bounds.
        """
        if self._kind == "configuration" or (self._kind == "line" and stalled is None):
            return None
        objective = bounded * self._rng.standard_normal(blocks.size)
        if self._kind == "objective" or stalled is None:
            return objective
        solution = program.solve(-objective)
        if not solution.usable:
            return None
        return linearise(blocks, along_line(program, stalled, solution.x - stalled))[1]


def along_line(program: Program, x: Array, way: Array) -> Array:
    """The last of the points x + n `STEP` way (N,), n = 0, 1, 2, ..., that is in the set (Algorithm 2)."""
    here = x
    for n in range(1, _FARTHEST + 1):
        there = x + n * STEP * way
        if not program.inside(there, slack=_INSIDE):
            break
        here = there
    return here
