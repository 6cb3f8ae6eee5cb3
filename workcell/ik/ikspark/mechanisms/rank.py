"""Rank minimisation on a mechanism's relaxation: Algorithm 1 with Problem 3, from the end of a direction."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np

from workcell.ik.ikspark.mechanisms.blocks import Blocks, linearise
from workcell.ik.ikspark.mechanisms.program import Program
from workcell.ik.ikspark.rank import LONGEST, RANK_GAP
from workcell.ik.shared.convex import SLOW
from workcell.pose import Array

STEADIEST = 0.8
"""Largest ratio of two changes of the gradient from which a limit is guessed."""
TIGHTEST = 6
"""Programs that a point is solved for again."""
STRAIGHT = 0.95
"""Least cosine of the angle between them."""


@dataclass(frozen=True, slots=True)
class Step:
    """One cone program of an ascent.

    Attributes:
        x: (N,) its point; None: the set is empty, or the solver failed.
        gap: largest rank gap of its blocks, their traces less their largest eigenvalues, and of its discs.
        left: sum of the gaps.
        z: dual of the rows, a ray where the set was found empty.
        empty: whether it was, or nearly so.
    """

    x: Array | None
    gap: float = 1.0
    left: float = np.inf
    z: Array | None = None
    empty: bool = False

    @property
    def rank_one(self) -> bool:
        """Whether the point is a configuration."""
        return self.x is not None and self.gap < RANK_GAP


def ascend(
    blocks: Blocks, program: Program, direction: Array, *, most: int = LONGEST, slow: float = SLOW
) -> Iterator[Step]:
    """From the point farthest along a direction (N,) upwards; ends at rank 1, or when it is slow.

    Where gradients settle geometrically, as with slides, the next step is made along their limit (Aitken's).
    """
    before, slopes, ahead = np.inf, list[Array](), False
    for count in range(most):
        solution = program.solve(-direction)
        if solution.status in ("infeasible", "almost_infeasible"):  # a ray's proof is checked in any case
            yield Step(None, z=solution.z, empty=True)
            return
        if not solution.usable:
            yield Step(None)
            return
        gaps, gradient = linearise(blocks, solution.x)
        step = Step(solution.x, float(gaps.max(initial=0.0)), float(gaps.sum()), solution.z)
        yield step
        if step.rank_one:
            return
        if ahead and step.left > before:  # the limit was none: on from where it was guessed
            direction, slopes, ahead = slopes[-1], [], False
            continue
        if count > 0 and step.left > slow * before:
            return
        before, slopes = step.left, [*slopes[-2:], gradient] if not ahead else [gradient]
        limit = limit_of(slopes)
        direction, ahead = (gradient, False) if limit is None else (limit, True)


def limit_of(slopes: list[Array]) -> Array | None:
    """Where the last three gradients lead to, if they go there geometrically; None: they don't."""
    if len(slopes) < 3:
        return None
    one, two = slopes[1] - slopes[0], slopes[2] - slopes[1]
    long, short = float(np.linalg.norm(one)), float(np.linalg.norm(two))
    if not 0.0 < short < STEADIEST * long or float(one @ two) < STRAIGHT * long * short:
        return None
    ratio = short / long
    limit: Array = slopes[2] + ratio / (1.0 - ratio) * two
    return limit


def tightened(blocks: Blocks, program: Program, step: Step, *, exact: float, tolerance: float) -> Array:
    """A point of rank 1 (N,) once more, to digits that ascents are spared.

    Args:
        blocks, program: of the set.
        step: its last step.
        exact: the rank gap to come below, if it can be.
        tolerance: of Clarabel.
    """
    assert step.x is not None
    x, gap, slopes = step.x, step.gap, list[Array]()
    direction = linearise(blocks, x)[1]
    for _ in range(TIGHTEST):
        if gap < exact:
            break
        solution = program.solve(-direction, tolerance=tolerance)
        if not solution.usable:
            break
        gaps, gradient = linearise(blocks, solution.x)
        here = float(gaps.max(initial=0.0))
        if here <= gap:
            x, gap = solution.x, here
        slopes = [*slopes[-2:], gradient]
        limit = limit_of(slopes)
        direction, slopes = (gradient, slopes) if limit is None else (limit, [])
    return x
