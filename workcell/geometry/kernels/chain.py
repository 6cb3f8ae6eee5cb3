"""Forward kinematics of one serial chain.

A frame is a row of 12 numbers: rotation (row-major), then position, in the world.
"""

from __future__ import annotations

import math
from typing import NamedTuple

from workcell.jit import inner
from workcell.pose import Array


class Arm(NamedTuple):
    """A serial chain for the kernels, every joint axis turned into its frame's z.

    Attributes:
        frames: (n + 2, 13) base, joints and tool: rotation (9, row-major) and position (3) in the frame before, then 1
            for a prismatic joint.
        bounds: (3, n) lower and upper limits, and 1 where whole turns fit in between.
    """

    frames: Array
    bounds: Array


@inner
def forward(frames: Array, q: Array, T: Array) -> None:
    """World frames T (n + 2, 12) of base, links and tool at q (n,)."""
    n = q.shape[0]
    for a in range(12):
        T[0, a] = frames[0, a]
    for i in range(1, n + 2):
        c, s, slide = 1.0, 0.0, 0.0
        if i <= n:
            if frames[i, 12] == 0.0:
                c, s = math.cos(q[i - 1]), math.sin(q[i - 1])
            else:
                slide = q[i - 1]
        for r in range(3):
            a, b, d = T[i - 1, 3 * r], T[i - 1, 3 * r + 1], T[i - 1, 3 * r + 2]
            x = a * frames[i, 0] + b * frames[i, 3] + d * frames[i, 6]
            y = a * frames[i, 1] + b * frames[i, 4] + d * frames[i, 7]
            z = a * frames[i, 2] + b * frames[i, 5] + d * frames[i, 8]
            T[i, 3 * r] = c * x + s * y
            T[i, 3 * r + 1] = c * y - s * x
            T[i, 3 * r + 2] = z
            T[i, 9 + r] = (
                T[i - 1, 9 + r] + a * frames[i, 9] + b * frames[i, 10] + d * frames[i, 11] + slide * z
            )
