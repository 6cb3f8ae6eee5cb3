"""`Motion`: the arm's state, what it is to become, and what was found out about that."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from workcell.pose import Array

FREE, STOPPING = 0, 1


class Motion(NamedTuple):
    """The arm's state and what it is to become.

    Attributes:
        now, next: (3, n) position, velocity, acceleration.
        wanted: (2, n) the relaxed solution at the end of the period, and its velocity.
        stop: (3, n) the state after the period of stopping now; end: (n,) where that stop ends.
        windows: (2, n) lowest and highest jerk as shares of the limit; held: (n,) whether there is such a window.
        aim: (n,) the share that each joint would take by itself.
        best: (3, n) scratch; then: (n,) scratch; drift: (m,) how far joints move, scratch.
        report: (6,) share of the program's step that was taken, 1 where it was shown to be clear, the smallest gap
            after the period, looks, slack, longest stop.
        guards: (16, 4) kind of pair, sphere, other, gap in micrometres: what shaped the step; used: (1,).
    """

    now: Array
    next: Array
    wanted: Array
    stop: Array
    end: Array
    windows: Array
    held: NDArray[np.int64]
    aim: Array
    best: Array
    then: Array
    drift: Array
    report: Array
    guards: NDArray[np.int64]
    used: NDArray[np.int64]
