"""What two lines of the chain know of each other, seen from the base and from the target (rule 6.7).

A near line a (direction u) is fixed to link a, seen from the base, a far line b >= a (point x, direction w), seen
from the target, with at most one joint between: |x - y|, u . (x - y) and u . w are measured with both seen from the
base, and with the far one seen from the target. At a candidate the two differ by what the joints of the box turn
away from its middle, and by the ball: joints a and b turn about the lines themselves and change nothing. A
difference that is larger excludes the box.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from workcell.proofs.exact.tree.fixed import ONE, Flags, Ints, cross, down, root_down, root_up, up
from workcell.proofs.exact.tree.views import FixedArm, View

LEAST_SCORE = 0.15
"""Where to cut, a guess: by a relation whose gap beyond the ball is this part of its blur at least, ..."""
WORTH = 20.0
"""... the ball, so many times, counted with the blur, since cuts do not lessen it;"""
FAR_WIDER = 16
"""and never a joint that is so many times narrower than the widest."""
MOST_BETWEEN = 2
"""Far lines are up to so many beyond near ones: one joint between them."""


@dataclass(frozen=True, slots=True)
class Blur:
    """How far a target may be missed, in whole numbers rounded up: T, A."""

    position: int
    rotation: int


@dataclass(frozen=True, slots=True)
class Relations:
    """Of N boxes.

    Attributes:
        gap: (relations, N) what the two sides differ by at least, at the middle.
        moves: (relations, n, N) what each joint may add to that, and
        ball: (relations, N) what the target's tolerances may.
    """

    gap: Ints
    moves: Ints
    ball: Ints

    @property
    def excluded(self) -> Flags:
        """(N,) whether a box holds no candidate."""
        found: Flags = np.any(self.gap > self.moves.sum(axis=1) + self.ball, axis=0)
        return found

    def joint_to_cut(self, half: Ints, which: Ints) -> Ints:
        """The joint that blurs most the relation that is nearest to excluding a box, else the widest: a guess."""
        moves, ball = self.moves[:, :, which], self.ball[:, which]
        score = (self.gap[:, which] - ball) / (moves.sum(axis=1) + WORTH * ball)
        best, each = np.argmax(score, axis=0), np.arange(len(which))
        blurring = np.argmax(moves[best, :, each], axis=1)
        widest = np.argmax(half[:, which], axis=0)
        told = (score[best, each] > LEAST_SCORE) & (half[blurring, which] > half[widest, which] // FAR_WIDER)
        joint: Ints = np.where(told, blurring, widest)
        return joint


def relations(arm: FixedArm, base: View, target: View, half: Ints, blur: Blur) -> Relations:
    """All relations of lines that are one, neighbours, or have one joint between them.

    Moves (6.6): turning one joint after the other, x moves by chord_j times its distance from line j, u tilts by
    chord_j |u x z_j|. A joint moves x at right angles to its line: along u by no more than |u x z_j| of that, and
    by what the joints before it have tilted u; before it come the base's joints from the near line down, the ball,
    and the target's from the tool down.
    """
    n, count = half.shape
    slack = 6 * arm.error
    chord = np.minimum(half, 2 * ONE)
    lines = n + 2
    joint, line = np.arange(1, n + 1)[None, :, None], np.arange(lines)[:, None, None]
    seen = joint < line  # by the base
    point = np.where(seen, base.near[:, None, 1:-1], target.near[:, None, 1:-1])
    axis = np.where(seen, base.along[:, None, 1:-1], target.along[:, None, 1:-1])
    levers = down(cross(target.far[:, :, None] - point, axis))
    sines = down(cross(np.broadcast_to(base.along[:, :, None], axis.shape), axis))
    step = up(chord * (root_up((levers * levers).sum(axis=0)) + slack))
    slant = np.minimum(root_up((sines * sines).sum(axis=0)) + slack, ONE)
    tilt = up(chord * slant)
    from_pole = target.far - arm.pole[:, None, None]
    ball = blur.position + up(blur.rotation * (root_up((from_pole * from_pole).sum(axis=0)) + slack))

    tilted = np.where(seen, tilt, 0)
    tilt_of_base = tilted.sum(axis=1, keepdims=True)
    tilt_before = tilt_of_base - np.cumsum(tilted, axis=1)
    apart = base.far - target.far
    gaps, moves, balls = [], [], []
    turning = np.full((lines, count), blur.rotation)
    for g in range(MOST_BETWEEN + 1):
        a, b = slice(0, lines - g), slice(g, lines)
        outside = joint > line[a] + g
        inside = seen[a] | outside
        between = np.zeros((lines - g, n, count), dtype=np.int64)
        slanted = between.copy()
        if g == MOST_BETWEEN:
            each = np.arange(n)
            between[each, each] = up(chord * arm.beside[1 : n + 1, None])
            slanted[each, each] = up(chord * arm.beside_angle[:n, None])
        beyond = np.where(outside, tilt[a], 0)
        after = (
            beyond.sum(axis=1, keepdims=True) - np.cumsum(beyond, axis=1) + tilt_of_base[a] + blur.rotation
        )
        across = np.minimum(slant[a] + np.where(seen[a], tilt_before[a], after), ONE)
        moved = np.where(inside, step[b], between)
        moves += [moved, up(moved * np.where(inside, across, arm.beside_angle[: lines - g, None, None]))]
        moves.append(np.where(inside, tilt[a], slanted))
        gaps += _gaps(base, target, apart, g)
        balls += [ball[b], ball[b], turning[a]]
    return Relations(np.concatenate(gaps) - slack, np.concatenate(moves), np.concatenate(balls))


def _gaps(base: View, target: View, apart: Ints, g: int) -> list[Ints]:
    """How far the two sides differ in |x - y|, u . (x - y) and u . w; for one line, in x and its direction."""
    lines = apart.shape[1]
    a, b = slice(0, lines - g), slice(g, lines)
    u = base.along[:, a]
    along = np.abs(down((u * apart[:, b]).sum(axis=0)))
    turned = base.along[:, b] - target.along[:, b]
    if g == 0:
        return [root_down((apart * apart).sum(axis=0)), along, root_down((turned * turned).sum(axis=0))]
    squares = [((view.far[:, b] - base.near[:, a]) ** 2).sum(axis=0) for view in (base, target)]
    first, second = (root_down(s) for s in squares)
    return [np.abs(first - second) - 1, along, np.abs(down((u * turned).sum(axis=0)))]
