"""The paper's lifts of a slide and its direction: an 8x8 matrix (Prop. 3), or three 4x4 parts of it (Remark 2)."""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np

from workcell.ik.ikspark.mechanisms.plain.forms import Expression, symmetric
from workcell.pose import Array


@dataclass(frozen=True, eq=False)
class PaperSlide:
    """Y = y y^T of y = (sqrt(t) d, sqrt(1 - t) d, sqrt(t), sqrt(1 - t)), 8x8, trace 2 (Eq. 23-28)."""

    direction: Expression
    lower: float
    upper: float
    block: Expression = field(default_factory=lambda: symmetric(8))

    @property
    def value(self) -> Expression:
        """Metres (Eq. 26)."""
        return self.lower + (self.upper - self.lower) * self.block[6, 6]

    @property
    def product(self) -> Expression:
        """(3,) value times direction (Eq. 28)."""
        return self.lower * self.direction + (self.upper - self.lower) * self.block[:3, 6]

    @property
    def blocks(self) -> list[Expression]:
        """The one matrix."""
        return [self.block]

    @property
    def constraints(self) -> list[Expression]:
        """Positive semidefinite, and the seven relations of Eq. 24."""
        import cvxpy as cp

        Y = self.block
        return [
            Y >> 0,
            cp.trace(Y) == 2,
            cp.trace(Y[:3, :3]) == Y[6, 6],
            cp.trace(Y[3:6, 3:6]) == Y[7, 7],
            Y[3:6, 6] == Y[:3, 7],
            cp.trace(Y[:3, 3:6]) == Y[6, 7],
            Y[6, 6] >= 0,
            Y[6, 6] <= 1,
            Y[6, 7] >= 0,
            Y[:3, 6] + Y[3:6, 7] == self.direction,
        ]

    def put(self, value: float, direction: Array) -> None:
        """Make it that of a value and a direction (3,)."""
        y = _lifted(value, direction, self.lower, self.upper)
        self.block.value = np.outer(y, y)


@dataclass(frozen=True, eq=False)
class ThreeSlide:
    """The 8x8 matrix's submatrices of rows (i, i + 3, 6, 7) for i = 0, 1, 2: all that its relations speak of."""

    direction: Expression
    lower: float
    upper: float
    blocks: list[Expression] = field(default_factory=lambda: [symmetric(4) for _ in range(3)])

    @property
    def value(self) -> Expression:
        """Metres."""
        return self.lower + (self.upper - self.lower) * self.blocks[0][2, 2]

    @property
    def product(self) -> Expression:
        """(3,) value times direction."""
        import cvxpy as cp

        share = cp.hstack([Y[0, 2] for Y in self.blocks])
        return self.lower * self.direction + (self.upper - self.lower) * share

    @property
    def constraints(self) -> list[Expression]:
        """Positive semidefinite, one and the same lower right block, and the seven relations of Eq. 24."""
        import cvxpy as cp

        first, *others = self.blocks
        total = first[2, 2] + first[3, 3]
        rows = [Y >> 0 for Y in self.blocks] + [Y[2:, 2:] == first[2:, 2:] for Y in others]
        rows += [
            sum(Y[0, 0] + Y[1, 1] for Y in self.blocks) + total == 2,
            sum(Y[0, 0] for Y in self.blocks) == first[2, 2],
            sum(Y[1, 1] for Y in self.blocks) == first[3, 3],
            sum(Y[0, 1] for Y in self.blocks) == first[2, 3],
            first[2, 2] >= 0,
            first[2, 2] <= 1,
            first[2, 3] >= 0,
            cp.hstack([Y[0, 2] + Y[1, 3] for Y in self.blocks]) == self.direction,
        ]
        return rows + [Y[1, 2] == Y[0, 3] for Y in self.blocks]

    def put(self, value: float, direction: Array) -> None:
        """Make it that of a value and a direction (3,)."""
        y = _lifted(value, direction, self.lower, self.upper)
        for i, block in enumerate(self.blocks):
            part = y[[i, i + 3, 6, 7]]
            block.value = np.outer(part, part)


def _lifted(value: float, direction: Array, lower: float, upper: float) -> Array:
    """(8,) the vector whose outer product Eq. 23 is."""
    share = float(np.clip((value - lower) / (upper - lower), 0.0, 1.0))
    low, high = np.sqrt(share), np.sqrt(1.0 - share)
    return np.concatenate([low * direction, high * direction, [low, high]])
