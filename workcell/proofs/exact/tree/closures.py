"""Which closures of a chain are worth their equations: what few joints move, and the whole at a middle link."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from workcell.proofs.exact.tree.fixed import ONE, Flags, Ints
from workcell.proofs.exact.tree.linear import LARGEST_SUM, Equations, direction, narrow, place, rotation
from workcell.proofs.exact.tree.relations import Blur
from workcell.proofs.exact.tree.views import FixedArm, View, views

_Maker = Callable[[FixedArm, View, View, Ints, Blur, int], Equations]
LEAST_STILL = 2
"""A place or direction is of use by itself where so many joints leave it alone."""


@dataclass(frozen=True, slots=True)
class Closure:
    """Equations of a line that are taken together, and which joints they are expected to move."""

    makers: tuple[_Maker, ...]
    line: int
    moving: Flags


def closures(arm: FixedArm) -> list[Closure]:
    """Of an arm: a guess by what moves at one configuration; the whole comes last."""
    n = arm.joints
    base, target = views(arm, np.arange(1, n + 1)[:, None] * (7 * ONE // 10))
    half = np.full((n, 1), ONE // 1000)
    found: list[Closure] = []
    for maker in (place, direction):
        for line in range(1, n + 1):
            moving = maker(arm, base, target, half, Blur(0, 0), line).moving[:, 0]
            known = any(
                closure.makers == (maker,) and np.array_equal(closure.moving, moving) for closure in found
            )
            if n - moving.sum() >= LEAST_STILL and not known:
                found.append(Closure((maker,), line, moving))
    return [*found, Closure((place, rotation), (n + 1) // 2, np.ones(n, dtype=bool))]


def narrowed(
    closure: Closure, arm: FixedArm, seen: tuple[View, View], middle: Ints, low: Ints, high: Ints, blur: Blur
) -> tuple[Ints, Ints]:
    """Ends of boxes that still hold every candidate, by one closure."""
    half = np.maximum(high - middle, middle - low)
    small = np.flatnonzero(half[closure.moving].sum(axis=0) <= LARGEST_SUM)
    if not len(small):
        return low, high
    base, target = (view.only(small) for view in seen)
    blocks = [maker(arm, base, target, half[:, small], blur, closure.line) for maker in closure.makers]
    ends = narrow(blocks, middle[:, small], low[:, small], high[:, small])
    low, high = low.copy(), high.copy()
    low[:, small], high[:, small] = ends
    return low, high
