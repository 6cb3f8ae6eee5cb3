"""Shorter, smoother paths of straight lines: random shortcuts, then corners pulled in. Every new line is proved."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from workcell.jit import inner, kernel
from workcell.kernels.random import RandomState, uniform
from workcell.motion.kernels.body import Body, Room, room
from workcell.motion.kernels.line import INTERVALS
from workcell.motion.kernels.straight import distance, line_is_clear
from workcell.pose import Array

_WORTH = 1e-3
"""Share of its length that a shortcut must save."""


@inner
def _cut(path: Array, count: int, i: int, j: int) -> int:
    """Remove rows i + 1 ... j - 1; returns the new count."""
    gone = j - i - 1
    for row in range(j, count):
        for k in range(path.shape[1]):
            path[row - gone, k] = path[row, k]
    return count - gone


@inner
def _skip_corners(body: Body, path: Array, count: int, tally: NDArray[np.int64], work: Room) -> int:
    """From the start on, jump to the farthest later corner that a proved line reaches (by halving the jump)."""
    i = 0
    while i < count - 2:
        jump = count - 1 - i
        while jump > 1 and not line_is_clear(body, path[i], path[i + jump], tally, work):
            jump //= 2
        if jump > 1:
            count = _cut(path, count, i, i + jump)
        i += 1
    return count


@inner
def _point(path: Array, count: int, along: float, q: Array) -> int:
    """The point at arc length `along`, into q (n,); the row before it."""
    row = 0
    while row < count - 2:
        length = distance(path[row], path[row + 1])
        if along <= length:
            break
        along -= length
        row += 1
    share = min(along / max(distance(path[row], path[row + 1]), 1e-12), 1.0)
    for k in range(q.shape[0]):
        q[k] = path[row, k] + share * (path[row + 1, k] - path[row, k])
    return row


@inner
def _shortcut(
    body: Body,
    path: Array,
    count: int,
    random: RandomState,
    a: Array,
    b: Array,
    tally: NDArray[np.int64],
    work: Room,
) -> int:
    """Join two random points of the path by a line, if it is proved and shorter; the new count, or -1."""
    total = 0.0
    for row in range(count - 1):
        total += distance(path[row], path[row + 1])
    u, v = total * uniform(random), total * uniform(random)
    if u > v:
        u, v = v, u
    i, j = _point(path, count, u, a), _point(path, count, v, b)
    if i == j or count + 2 - (j - i) > path.shape[0]:
        return -1
    if distance(a, b) > (v - u) * (1.0 - _WORTH) or not line_is_clear(body, a, b, tally, work):
        return -1
    # rows i + 1 ... j give way to a and b
    shift = 2 - (j - i)
    if shift > 0:
        for row in range(count - 1, j, -1):
            for k in range(path.shape[1]):
                path[row + shift, k] = path[row, k]
    elif shift < 0:
        for row in range(j + 1, count):
            for k in range(path.shape[1]):
                path[row + shift, k] = path[row, k]
    for k in range(path.shape[1]):
        path[i + 1, k], path[i + 2, k] = a[k], b[k]
    return count + shift


@inner
def _pull(
    body: Body, path: Array, count: int, share: float, q: Array, tally: NDArray[np.int64], work: Room
) -> float:
    """Move every inner corner by `share` of the way to the middle of its neighbours, where both lines are proved.

    Returns the length saved.
    """
    saved = 0.0
    for row in range(1, count - 1):
        before = distance(path[row - 1], path[row]) + distance(path[row], path[row + 1])
        for k in range(q.shape[0]):
            q[k] = path[row, k] + share * (0.5 * (path[row - 1, k] + path[row + 1, k]) - path[row, k])
        gain = before - distance(path[row - 1], q) - distance(q, path[row + 1])
        if gain < _WORTH * before:
            continue
        if line_is_clear(body, path[row - 1], q, tally, work) and line_is_clear(
            body, q, path[row + 1], tally, work
        ):
            saved += gain
            for k in range(q.shape[0]):
                path[row, k] = q[k]
    return saved


@inner
def _without_repetitions(path: Array, count: int) -> int:
    row = 1
    while row < count - 1:
        if distance(path[row - 1], path[row]) < 1e-9:
            count = _cut(path, count, row - 1, row + 1)
        else:
            row += 1
    if count > 2 and distance(path[count - 2], path[count - 1]) < 1e-9:
        count = _cut(path, count, count - 3, count - 1)
    return count


@kernel
def shorten(
    body: Body,
    path: Array,
    count: int,
    random: RandomState,
    tries: int,
    patience: int,
    pulls: int,
    tally: NDArray[np.int64],
) -> int:
    """Shorten the first `count` rows of path (m, n) in place; its ends stay. Returns the new count.

    Args:
        tries, patience: shortcuts to try, and failures in a row after which to stop.
        pulls: rounds of pulling corners in.
        tally: (2,) counts lines tried and configurations looked at.
    """
    n = path.shape[1]
    a, b, work = np.empty(n), np.empty(n), room(body, INTERVALS)
    count = _skip_corners(body, path, count, tally, work)
    failures = 0
    for _ in range(tries):
        if count < 3 or failures >= patience:
            break
        shorter = _shortcut(body, path, count, random, a, b, tally, work)
        failures = failures + 1 if shorter < 0 else 0
        count = count if shorter < 0 else _without_repetitions(path, shorter)
    share = 0.6
    for _ in range(pulls):
        if count < 3 or share < 0.05:
            break
        if _pull(body, path, count, share, a, tally, work) == 0.0:
            share *= 0.5
    return _skip_corners(body, path, count, tally, work)
