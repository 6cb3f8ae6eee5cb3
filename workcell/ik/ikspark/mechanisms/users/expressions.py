"""What users' constraints speak of, as cvxpy expressions: points and rotations of frames, values of slides."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Any, Protocol

import numpy as np

from workcell.errors import InputError
from workcell.model.mechanism.mechanism import Mechanism
from workcell.model.mechanism.placing import Placed
from workcell.pose import Array

Expression = Any
"""A cvxpy expression; cvxpy carries no types."""


class AffineModel(Protocol):
    """A lifted model in which links' rotations and origins and slides' values are affine in x (N,).

    Rows have N + 1 columns, the last of which is the constant.
    """

    @property
    def mechanism(self) -> Mechanism:
        """Whose links and joints these are."""
        ...

    @property
    def size(self) -> int:
        """N, how many numbers x has."""
        ...

    def rotation_rows(self, link: int) -> Array:
        """(9, N + 1) a link's rotation in the world, row by row."""
        ...

    def origin_rows(self, link: int) -> Array:
        """(3, N + 1) a link's origin in the world."""
        ...

    def slide_row(self, joint: int) -> Array:
        """(N + 1,) a slide's value."""
        ...


@dataclass(frozen=True)
class Expressions:
    """Expressions of a mechanism, in the world frame, for `UserConstraint.build`.

    Attributes:
        mechanism: whose.
        link_rotation, link_origin: by link, (3, 3) and (3,).
        slide_value: by joint, a scalar.
    """

    mechanism: Mechanism
    link_rotation: Callable[[int], Expression]
    link_origin: Callable[[int], Expression]
    slide_value: Callable[[int], Expression]

    def point(self, frame: str, local: Sequence[float] | Array = (0.0, 0.0, 0.0)) -> Expression:
        """World place (3,) of a point (3,) of a frame; raises UnknownNameError, InputError."""
        placed = self.mechanism.frame(frame)
        position = np.asarray(local, dtype=float)
        if position.shape != (3,) or not np.all(np.isfinite(position)):
            raise InputError(
                f"a point has 3 finite numbers, not {position.tolist()}", where=f"frame {frame!r}"
            )
        on_link = placed.T_link_frame.apply(position)
        return self.link_origin(placed.link) + self.link_rotation(placed.link) @ on_link

    def rotation(self, frame: str) -> Expression:
        """World rotation (3, 3) of a frame: its columns are the frame's axes; raises UnknownNameError."""
        placed = self.mechanism.frame(frame)
        return self.link_rotation(placed.link) @ placed.T_link_frame.rotation

    def slide(self, joint: str) -> Expression:
        """The value of a slide, metres; raises UnknownNameError, and InputError where it is no slide."""
        k = self.mechanism.joint(joint)
        kind = self.mechanism.joints[k].kind
        if kind != "slide":
            raise InputError(
                f"{joint!r} is a {kind} joint: its value is not linear in the model",
                where=self.mechanism.name,
                remedy="points and rotations of frames are",
            )
        return self.slide_value(k)

    @staticmethod
    def of(affine: AffineModel, x: Expression) -> Expressions:
        """Expressions that are affine in a cvxpy variable x (N,)."""
        import cvxpy as cp

        def values(rows: Array) -> Expression:
            return rows[..., :-1] @ x + rows[..., -1]

        return Expressions(
            affine.mechanism,
            lambda link: cp.reshape(values(affine.rotation_rows(link)), (3, 3), order="C"),
            lambda link: values(affine.origin_rows(link)),
            lambda joint: values(affine.slide_row(joint)),
        )

    @staticmethod
    def at(placed: Placed) -> Expressions:
        """Constants: what the expressions are at a configuration."""
        import cvxpy as cp

        slices = placed.mechanism.value_slices
        return Expressions(
            placed.mechanism,
            lambda link: cp.Constant(placed.R[link]),
            lambda link: cp.Constant(placed.p[link]),
            lambda joint: cp.Constant(placed.q[slices[joint].start]),
        )
