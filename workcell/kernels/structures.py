"""The structures that the kernels share, and their random numbers."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from workcell.jit import inner
from workcell.pose import Array


class World(NamedTuple):
    """The robot's spheres and the obstacles.

    Attributes:
        spheres: (m, 6) centre in the link's frame, radius, index in the cover, link; sorted by link.
        balls: (n + 1, 6) for each link a ball around its spheres (centre, radius) and their first and last row.
        obstacles: (k, 19) kind, centre (3), rotation (9), size (3), bounding radius, first and last row in `faces`.
        faces: (f, 13) triangles of hulls in the hull's frame: outward unit normal (3), offset, corners (9).
        pairs: (p, 2) rows of spheres that must keep clear of each other.
        required: metres of clearance that a solution keeps.
    """

    spheres: Array
    balls: Array
    obstacles: Array
    faces: Array
    pairs: NDArray[np.int64]
    required: float


class Work(NamedTuple):
    """Scratch of one query: frames, Jacobian, residual and the vectors of a step (see `scratch`)."""

    T: Array
    J: Array
    e: Array
    A: Array
    y: Array
    step: Array
    trial: Array
    gradient: Array
    newton: Array
    H: Array
    column: Array


@inner
def scratch(n: int) -> Work:
    """Room for a chain of n joints."""
    return Work(
        np.empty((n + 2, 12)),
        np.empty((6, n)),
        np.empty(6),
        np.empty((6, 6)),
        np.empty(6),
        np.empty(n),
        np.empty(n),
        np.empty(n),
        np.empty(n),
        np.empty((n, n)),
        np.empty(n),
    )
