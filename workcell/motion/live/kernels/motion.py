"""`Motion`: the arm's state, what it is to become, and what was found out about that."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from workcell.pose import Array

FREE, STOPPING = 0, 1
MOST_GUARDS = 16
"""Pairs that are written down."""
POSITION, VELOCITY, ACCELERATION, SINGULARITY, NEAR = range(5)
"""Kinds of guards."""


class Motion(NamedTuple):
    """The arm's state and what it is to become.

    Attributes:
        now, next: (3, n) position, velocity, acceleration.
        wanted: (2, n) the relaxed solution at the end of the period, and its velocity.
        stop: (3, n) the state after the period of stopping now; end: (n,) where that stop ends.
        windows: (2, n) lowest and highest jerk as shares of the limit; held: (n,) whether there is such a window.
        aim: (n,) the share that each joint would take by itself; limited: (n,) 1 where acceleration or jerk limit it.
        best: (3, n) scratch; then: (n,) scratch; drift: (m,) how far joints move, scratch.
        report: (6,) share of the program's step that was taken, 1 where it was shown to be clear, the smallest gap
            after the period, looks, slack, longest stop.
        guards: (g, 4) what shaped the step: kind, then joint or tool, or sphere, kind of pair and other; used: (1,).
        values: (g,) how near each is.
        out: (2 n + 3 k + 8,) what is told of the arm: position, velocity, position and rotation errors, terms,
            conditioning, clearance.
        flags: (4,) 1 where the step is not what was wanted, where it was shown to be clear, where all tools are on
            their goals, where the arm rests.
    """

    now: Array
    next: Array
    wanted: Array
    stop: Array
    end: Array
    windows: Array
    held: NDArray[np.int64]
    aim: Array
    limited: NDArray[np.int64]
    best: Array
    then: Array
    drift: Array
    report: Array
    guards: NDArray[np.int64]
    values: Array
    used: NDArray[np.int64]
    out: Array
    flags: NDArray[np.int64]
