"""Walks a tree of boxes level by level, and cuts what a leaf leaves until every piece is excluded."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from workcell.proofs.exact.reading import RefusedError
from workcell.proofs.exact.tree.closures import Closure, narrowed
from workcell.proofs.exact.tree.collisions import Pairs, inside
from workcell.proofs.exact.tree.fixed import ONE, Flags, Ints
from workcell.proofs.exact.tree.relations import Blur, relations
from workcell.proofs.exact.tree.views import FixedArm, View, views

AT_ONCE = 256
"""Boxes looked at together."""
ROUNDS = 2
"""So often a box is narrowed before it is cut."""
PIECES_A_LEAF = 2000
PIECES_BEYOND = 100_000
MOST_PIECES = 10_000_000
"""Where a leaf's proof is given up: some minutes for all of them together."""
SMALLEST = ONE >> 18
"""Pieces whose joints are all narrower (4e-6 rad) reach the target for all that can be told: they are not cut."""


@dataclass(frozen=True, slots=True)
class Tree:
    """In pre-order, as the file has it, in whole numbers.

    Attributes:
        joint: (nodes,) the joint that is split, or below zero for a leaf.
        second: (nodes,) where the second half of an inner node is.
        split: (nodes,) where it is split.
        label: (nodes,) which pair a leaf names; -1 for none.
    """

    joint: Ints
    second: Ints
    split: Ints
    label: Ints


@dataclass(slots=True)
class Boxes:
    """Boxes with what they are: a node of the tree, or the pair that a piece of a leaf has to show."""

    of: Ints
    low: Ints
    high: Ints

    def __len__(self) -> int:
        return len(self.of)

    def only(self, which: Ints | Flags) -> Boxes:
        """Some of them."""
        return Boxes(self.of[which], self.low[:, which], self.high[:, which])


def joined(parts: list[Boxes]) -> Boxes:
    """Boxes put together."""
    return Boxes(
        np.concatenate([p.of for p in parts]),
        np.concatenate([p.low for p in parts], axis=1),
        np.concatenate([p.high for p in parts], axis=1),
    )


@dataclass(frozen=True, slots=True)
class Walker:
    """Looks at boxes of one certificate."""

    arm: FixedArm
    blur: Blur
    pairs: Pairs
    closures: list[Closure]

    def prove(self, tree: Tree, low: Ints, high: Ints) -> int:
        """Prove every leaf below the root box; how many boxes were looked at.

        Raises:
            RefusedError: a piece of a leaf could not be excluded.
        """
        level = Boxes(np.zeros(1, dtype=np.int64), low[:, None], high[:, None])
        leaves: list[Boxes] = []
        seen = 0
        while len(level):
            at_leaf = tree.joint[level.of] < 0
            if np.any(at_leaf):
                found = level.only(at_leaf)
                found.of = tree.label[found.of]
                leaves.append(found)
            level = level.only(~at_leaf)
            seen += len(level)
            parts = [np.arange(i, min(i + AT_ONCE, len(level))) for i in range(0, len(level), AT_ONCE)]
            kept = [self._look(level.only(part), pieces=False)[0] for part in parts]
            level = _halves(tree, joined(kept)) if kept else level
        return seen + (self._pieces(joined(leaves)) if leaves else 0)

    def _look(self, boxes: Boxes, *, pieces: bool) -> tuple[Boxes, Ints]:
        """What is left of some boxes, and where to cut them."""
        cut = np.zeros(len(boxes), dtype=np.int64)
        for _ in range(ROUNDS):
            middle = (boxes.low + boxes.high) >> 1
            half = np.maximum(boxes.high - middle, middle - boxes.low)
            base, target = views(self.arm, middle)
            known = relations(self.arm, base, target, half, self.blur)
            kept = np.flatnonzero(~known.excluded)
            cut = known.joint_to_cut(half, kept)
            boxes, half, base, target = boxes.only(kept), half[:, kept], base.only(kept), target.only(kept)
            if pieces:
                left = ~self._collide(boxes, half, base, target)
                boxes, half, cut = boxes.only(left), half[:, left], cut[left]
                base, target = base.only(left), target.only(left)
            middle = middle[:, kept][:, left] if pieces else middle[:, kept]
            low, high = boxes.low, boxes.high
            for closure in self.closures:
                low, high = narrowed(closure, self.arm, (base, target), middle, low, high, self.blur)
            shrunk = np.any((high - low) * 2 < boxes.high - boxes.low)
            left = np.all(low <= high, axis=0)
            boxes, cut = Boxes(boxes.of, low, high).only(left), cut[left]
            if not shrunk:
                break
        return boxes, cut

    def _collide(self, boxes: Boxes, half: Ints, base: View, target: View) -> Flags:
        """Which pieces have their leaf's sphere inside its obstacle."""
        proved = np.zeros(len(boxes), dtype=bool)
        naming = np.flatnonzero(boxes.of >= 0)
        if len(naming):
            named = self.pairs.of(boxes.of[naming])
            seen = base.only(naming), target.only(naming)
            proved[naming] = inside(self.arm, *seen, half[:, naming], self.blur, named)
        return proved

    def _pieces(self, leaves: Boxes) -> int:
        allowed = min(PIECES_A_LEAF * len(leaves) + PIECES_BEYOND, MOST_PIECES)
        stack, seen = [leaves], 0
        while stack:
            batch = stack.pop()
            if len(batch) > AT_ONCE:
                stack.append(batch.only(np.arange(AT_ONCE, len(batch))))
                batch = batch.only(np.arange(AT_ONCE))
            seen += len(batch)
            if seen > allowed:
                raise RefusedError(f"a leaf is not excluded: {seen} pieces were looked at")
            left, cut = self._look(batch, pieces=True)
            if len(left):
                stack.append(_cut(left, cut))
                if len(stack) > 1 and len(stack[-1]) + len(stack[-2]) <= AT_ONCE:
                    stack[-2:] = [joined(stack[-2:])]
        return seen


def _halves(tree: Tree, boxes: Boxes) -> Boxes:
    """Both halves of the boxes of inner nodes, without those that are empty."""
    joint, split = tree.joint[boxes.of], tree.split[boxes.of]
    each = np.arange(len(boxes))
    first = Boxes(boxes.of + 1, boxes.low, boxes.high.copy())
    second = Boxes(tree.second[boxes.of], boxes.low.copy(), boxes.high)
    first.high[joint, each] = np.minimum(first.high[joint, each], split + 1)
    second.low[joint, each] = np.maximum(second.low[joint, each], split - 1)
    both = joined([first, second])
    return both.only(np.all(both.low <= both.high, axis=0))


def _cut(boxes: Boxes, joint: Ints) -> Boxes:
    """Both halves of pieces."""
    each = np.arange(len(boxes))
    width = boxes.high - boxes.low
    if np.any(width.max(axis=0) <= SMALLEST):
        raise RefusedError("a leaf is not excluded: a piece of it that is tiny is left")
    joint = np.where(width[joint, each] > 1, joint, np.argmax(width, axis=0))
    middle = (boxes.low + boxes.high)[joint, each] >> 1
    first = Boxes(boxes.of, boxes.low, boxes.high.copy())
    second = Boxes(boxes.of, boxes.low.copy(), boxes.high)
    first.high[joint, each] = middle
    second.low[joint, each] = middle
    return joined([first, second])
