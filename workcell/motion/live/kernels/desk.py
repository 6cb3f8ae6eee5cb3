"""What a frame's kernels work with: what limbs must keep off, a desk of scratch, and a look around."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from workcell.jit import lean
from workcell.kernels.shapes import Shapes
from workcell.motion.live.kernels.conditioning import conditioning
from workcell.motion.live.kernels.limbs import Limbs, Place, put, tool_jacobian
from workcell.motion.live.kernels.near import Movers, Near, find_near
from workcell.motion.live.kernels.program import Program
from workcell.motion.live.kernels.terms import Sum
from workcell.pose import Array


class Surroundings(NamedTuple):
    """What the limbs must keep off.

    Attributes:
        shapes: what stands; movers: what moves.
        skipped: (s, k) spheres and shapes that don't count.
        keep: (2,) metres to keep: of the margin that the caller asked for, and a little that rows keep on top.
        least: (k,) conditioning below which a tool counts as singular.
    """

    shapes: Shapes
    movers: Movers
    skipped: NDArray[np.bool_]
    keep: Array
    least: Array


class Desk(NamedTuple):
    """Scratch: places, sums, near pairs, programs, singular vectors (see `workcell.motion.live.packing`).

    Attributes:
        ratio: (k,) each tool's conditioning where the arm is.
        box: (2, n) where the relaxed solution may be in this frame.
        held: (1,) for how many frames the arm has been held.
    """

    place: Place
    total: Sum
    near: Near
    program: Program
    matrix: Array
    ratio: Array
    vectors: Array
    gram: Array
    eigenvectors: Array
    slope: Array
    trial: Array
    gaps: Array
    gaps_then: Array
    box: Array
    held: NDArray[np.int64]


@lean
def look(limbs: Limbs, around: Surroundings, desk: Desk, q: Array, margin: float) -> float:
    """Put the limbs at q and find what is nearer than `margin`; the smallest gap."""
    put(limbs, q, desk.place)
    return find_near(
        limbs, around.shapes, around.movers, around.skipped, desk.place, margin, margin, desk.near
    )


@lean
def condition(limbs: Limbs, around: Surroundings, desk: Desk, t: int) -> float:
    """The conditioning of tool t where the limbs have been put."""
    tool_jacobian(limbs, desk.place, t, desk.total.J)
    return conditioning(desk.total.J, desk.gram, desk.eigenvectors, desk.vectors)
