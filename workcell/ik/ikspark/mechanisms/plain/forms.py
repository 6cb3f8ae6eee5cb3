"""Two convex stand-ins for an unknown rotation: the rotation form (Prop. 2) and the quaternion form (Eq. 77-78).

A form has a symmetric block that is positive semidefinite and of fixed trace, of which the rotation is linear. Where
the block has rank 1 the rotation is one. The quaternion form is the convex hull of all rotations; the rotation form
is larger.
"""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import Any, ClassVar, Literal, Protocol

import numpy as np

from workcell.errors import InputError
from workcell.pose import Array, matrix_to_quat

Expression = Any
"""A cvxpy expression; cvxpy carries no types."""
FormName = Literal["quaternion", "rotation"]


class Form(Protocol):
    """What both forms offer.

    Attributes:
        trace: of the block, whatever the rotation.
        block: the symmetric cvxpy variable.
    """

    trace: ClassVar[float]

    @property
    def block(self) -> Expression:
        """The symmetric variable."""
        ...

    @property
    def constraints(self) -> list[Expression]:
        """What makes the block a point of the convex set."""
        ...

    @property
    def rotation(self) -> Expression:
        """The rotation (3, 3), linear in the block."""
        ...

    def put(self, rotation: Array) -> None:
        """Make the block that of a rotation (3, 3)."""
        ...


def new_form(name: FormName) -> Form:
    """A new unknown rotation; raises InputError where there is no such form."""
    if name == "quaternion":
        return QuaternionForm()
    if name == "rotation":
        return RotationForm()
    raise InputError(f"there is no form {name!r}", where="form", remedy="quaternion, rotation")


def symmetric(order: int) -> Expression:
    """A symmetric variable (order, order)."""
    import cvxpy as cp

    return cp.Variable((order, order), symmetric=True)


@dataclass(frozen=True, eq=False)
class QuaternionForm:
    """Q = q q^T of a unit quaternion (r, x, y, z), 4x4, trace 1."""

    trace: ClassVar[float] = 1.0
    block: Expression = field(default_factory=lambda: symmetric(4))

    @property
    def constraints(self) -> list[Expression]:
        """Positive semidefinite, trace 1."""
        import cvxpy as cp

        return [self.block >> 0, cp.trace(self.block) == 1]

    @property
    def rotation(self) -> Expression:
        """Eq. 78, the ones in it replaced by the trace."""
        return homogeneous_rotation(self.block)

    def put(self, rotation: Array) -> None:
        """Make the block that of a rotation (3, 3)."""
        quat = matrix_to_quat(rotation)
        self.block.value = np.outer(quat, quat)


def homogeneous_rotation(Q: Expression) -> Expression:
    """Eq. 78 with its ones replaced by the trace of Q (4, 4): trace(Q) times the rotation where Q has rank 1."""
    import cvxpy as cp

    r, x, y, z = range(4)
    return cp.bmat(
        [
            [Q[r, r] + Q[x, x] - Q[y, y] - Q[z, z], 2 * (Q[x, y] - Q[r, z]), 2 * (Q[x, z] + Q[r, y])],
            [2 * (Q[x, y] + Q[r, z]), Q[r, r] - Q[x, x] + Q[y, y] - Q[z, z], 2 * (Q[y, z] - Q[r, x])],
            [2 * (Q[x, z] - Q[r, y]), 2 * (Q[y, z] + Q[r, x]), Q[r, r] - Q[x, x] - Q[y, y] + Q[z, z]],
        ]
    )


@dataclass(frozen=True, eq=False)
class RotationForm:
    """Y = y y^T of y = (first column, second column, 1), 7x7, trace 3 (Eq. 17)."""

    trace: ClassVar[float] = 3.0
    block: Expression = field(default_factory=lambda: symmetric(7))

    @property
    def constraints(self) -> list[Expression]:
        """Positive semidefinite, with the structure of Eq. 20."""
        import cvxpy as cp

        Y = self.block
        return [
            Y >> 0,
            cp.trace(Y[:3, :3]) == 1,
            cp.trace(Y[3:6, 3:6]) == 1,
            cp.trace(Y[:3, 3:6]) == 0,
            Y[6, 6] == 1,
        ]

    @property
    def rotation(self) -> Expression:
        """Columns from the block's last one, the third their cross product (Eq. 19)."""
        import cvxpy as cp

        Y = self.block
        third = [Y[1, 5] - Y[2, 4], Y[2, 3] - Y[0, 5], Y[0, 4] - Y[1, 3]]
        return cp.bmat([[Y[row, 6], Y[3 + row, 6], third[row]] for row in range(3)])

    def put(self, rotation: Array) -> None:
        """Make the block that of a rotation (3, 3)."""
        y = np.concatenate([rotation[:, 0], rotation[:, 1], [1.0]])
        self.block.value = np.outer(y, y)
