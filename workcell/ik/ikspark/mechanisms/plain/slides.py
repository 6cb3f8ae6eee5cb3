"""Stand-ins for the product of a slide's value and its direction, which turns with an unknown rotation.

    value = lower + t (upper - lower), t in [0, 1]          product = lower d + (upper - lower) (t d)

The paper lifts (t, d) to an 8x8 matrix (Prop. 3), or to three 4x4 submatrices of it (Remark 2), which says the same:
they overlap in one 2x2 block, so that any three of them can be completed. `split` cuts the quaternion block of the
rotation in two, Q = Q1 + Q2 with Q1's trace t: the convex hull of all pairs of a rotation and a value, and as exact
as the rotation is, since what is below a matrix of rank 1 is a multiple of it. `whole` says the same by the 8x8 matrix
of (sqrt(t) q, sqrt(1 - t) q) that has Q1 and Q2 on its diagonal. It is larger, but where rank recovery with its
eigenvalues succeeds it ends at rank 1 to rounding. With `split` what is left shrinks by a factor a step, and a gap of Q
leaves Q1 free by the gap's square root.
"""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import Literal, Protocol

import numpy as np

from workcell.errors import InputError
from workcell.ik.ikspark.mechanisms.plain.forms import (
    Expression,
    Form,
    QuaternionForm,
    homogeneous_rotation,
    symmetric,
)
from workcell.ik.ikspark.mechanisms.plain.paper_slides import PaperSlide, ThreeSlide
from workcell.pose import Array

SlideName = Literal["split", "whole", "paper", "three"]
_NAMES = ("split", "whole", "paper", "three")


class Slide(Protocol):
    """What all of them offer."""

    @property
    def value(self) -> Expression:
        """Metres."""
        ...

    @property
    def product(self) -> Expression:
        """(3,) value times direction."""
        ...

    @property
    def blocks(self) -> list[Expression]:
        """Matrices that are to have rank 1, besides the rotation's own; their traces add up to a constant."""
        ...

    @property
    def constraints(self) -> list[Expression]:
        """What makes it a point of the convex set."""
        ...

    def put(self, value: float, direction: Array) -> None:
        """Make it that of a value and a direction (3,)."""
        ...


def new_slide(
    name: SlideName, form: Form | None, within: Array, direction: Expression, lower: float, upper: float
) -> Slide:
    """A new slide.

    Args:
        name: which stand-in; where the rotation is known none is needed.
        form: the rotation that the direction turns with; None: it is known.
        within: (3,) the direction in the frame of that rotation.
        direction: (3,) the direction in the world, an expression.
        lower, upper: metres.

    Raises:
        InputError: no such stand-in; `split` or `whole` without the quaternion form; no finite limits where they are
            needed.
    """
    if name not in _NAMES:
        raise InputError(f"there is no lift {name!r} of slides", where="slide", remedy=", ".join(_NAMES))
    if form is None:
        return KnownSlide(direction, lower, upper)
    if not (np.isfinite(lower) and np.isfinite(upper)):
        raise InputError(
            f"a slide from {lower:g} to {upper:g} m on a link that turns",
            where="slide",
            remedy="finite limits",
        )
    if lower == upper:
        return HeldSlide(direction, lower)
    if name == "paper":
        return PaperSlide(direction, lower, upper)
    if name == "three":
        return ThreeSlide(direction, lower, upper)
    if not isinstance(form, QuaternionForm):
        raise InputError(
            "slides are split in the quaternion form alone", where="slide", remedy="paper, three"
        )
    return (SplitSlide if name == "split" else WholeSlide)(form, within, lower, upper)


def _scalar() -> Expression:
    import cvxpy as cp

    return cp.Variable()


@dataclass(frozen=True, eq=False)
class KnownSlide:
    """The direction is known: nothing to lift."""

    direction: Expression
    lower: float
    upper: float
    value: Expression = field(default_factory=_scalar)

    @property
    def product(self) -> Expression:
        """(3,) value times direction."""
        return self.value * self.direction

    @property
    def blocks(self) -> list[Expression]:
        """None."""
        return []

    @property
    def constraints(self) -> list[Expression]:
        """The limits."""
        below = [self.value >= self.lower] if np.isfinite(self.lower) else []
        return below + ([self.value <= self.upper] if np.isfinite(self.upper) else [])

    def put(self, value: float, direction: Array) -> None:
        """Make it that of a value."""
        self.value.value = value


@dataclass(frozen=True, eq=False)
class HeldSlide:
    """The value is known: nothing to lift."""

    direction: Expression
    held: float

    @property
    def value(self) -> Expression:
        """Metres, a constant."""
        import cvxpy as cp

        return cp.Constant(self.held)

    @property
    def product(self) -> Expression:
        """(3,) value times direction."""
        return self.held * self.direction

    @property
    def blocks(self) -> list[Expression]:
        """None."""
        return []

    @property
    def constraints(self) -> list[Expression]:
        """None."""
        return []

    def put(self, value: float, direction: Array) -> None:
        """Nothing to set."""


@dataclass(frozen=True, eq=False)
class SplitSlide:
    """The quaternion block in two parts: at the lower limit and at the upper one."""

    form: QuaternionForm
    within: Array
    lower: float
    upper: float
    part: Expression = field(default_factory=lambda: symmetric(4))

    @property
    def value(self) -> Expression:
        """Metres: the part's trace."""
        import cvxpy as cp

        return self.lower + (self.upper - self.lower) * cp.trace(self.part)

    @property
    def product(self) -> Expression:
        """(3,) value times direction."""
        whole, part = self.form.rotation, homogeneous_rotation(self.part)
        return self.lower * (whole @ self.within) + (self.upper - self.lower) * (part @ self.within)

    @property
    def blocks(self) -> list[Expression]:
        """None: where the rotation's own block has rank 1 both parts do."""
        return []

    @property
    def constraints(self) -> list[Expression]:
        """Both parts positive semidefinite."""
        return [self.part >> 0, self.form.block - self.part >> 0]

    def put(self, value: float, direction: Array) -> None:
        """The share of the form's block as it is now, which must have been set before."""
        self.part.value = (value - self.lower) / (self.upper - self.lower) * self.form.block.value


@dataclass(frozen=True, eq=False)
class WholeSlide:
    """M = m m^T of m = (sqrt(t) q, sqrt(1 - t) q), 8x8, trace 1, q the rotation's quaternion."""

    form: QuaternionForm
    within: Array
    lower: float
    upper: float
    block: Expression = field(default_factory=lambda: symmetric(8))

    @property
    def value(self) -> Expression:
        """Metres: the trace of the first diagonal block."""
        import cvxpy as cp

        return self.lower + (self.upper - self.lower) * cp.trace(self.block[:4, :4])

    @property
    def product(self) -> Expression:
        """(3,) value times direction."""
        whole, part = self.form.rotation, homogeneous_rotation(self.block[:4, :4])
        return self.lower * (whole @ self.within) + (self.upper - self.lower) * (part @ self.within)

    @property
    def blocks(self) -> list[Expression]:
        """The one matrix."""
        return [self.block]

    @property
    def constraints(self) -> list[Expression]:
        """Positive semidefinite; diagonal blocks that add up to the rotation's; between them a symmetric one."""
        import cvxpy as cp

        M = self.block
        return [
            M >> 0,
            M[:4, :4] + M[4:, 4:] == self.form.block,
            M[:4, 4:] == M[4:, :4],
            cp.trace(M[:4, 4:]) >= 0,
        ]

    def put(self, value: float, direction: Array) -> None:
        """Make it that of a value and the form's block as it is now, which must have been set before."""
        share = float(np.clip((value - self.lower) / (self.upper - self.lower), 0.0, 1.0))
        ends = np.array([np.sqrt(share), np.sqrt(1.0 - share)])
        self.block.value = np.kron(np.outer(ends, ends), self.form.block.value)
