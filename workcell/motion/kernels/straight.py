"""Straight lines between configurations: looked at first, and proved where a look finds nothing."""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from workcell.jit import inner
from workcell.motion.kernels.body import Body, Room
from workcell.motion.kernels.line import PROVED, prove_line
from workcell.motion.kernels.touch import free_samples
from workcell.motion.kernels.tree import FINEST, MOST
from workcell.pose import Array

_SPACING = 0.25
"""Radians between samples that are looked at before a line is proved."""


@inner
def distance(a: Array, b: Array) -> float:
    """Length of the line between two configurations (n,)."""
    square = 0.0
    for k in range(a.shape[0]):
        square += (a[k] - b[k]) ** 2
    return math.sqrt(square)


@inner
def line_is_clear(body: Body, a: Array, b: Array, tally: NDArray[np.int64], work: Room) -> bool:
    """Whether the line from a to b (n,) is proved clear; counts the line in tally[0], the looks in tally[1]."""
    samples = math.ceil(distance(a, b) / _SPACING)
    free = free_samples(body, a, b, samples, work)
    tally[0] += 1
    tally[1] += min(free + 1, samples)
    if free < samples:
        return False
    verdict = prove_line(body, a, b, 0.0, body.floor, FINEST, MOST, work)
    tally[1] += verdict.looks
    return verdict.code == PROVED
