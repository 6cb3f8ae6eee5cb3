"""`Weights`: what the terms of a live step count, and the losses that they go through (RelaxedIK, section 4)."""

from __future__ import annotations

from dataclasses import astuple, dataclass, fields

import numpy as np

from workcell.errors import InputError
from workcell.pose import Array

TERMS = (
    "position", "orientation", "joint_velocity", "joint_acceleration", "joint_jerk", "tool_velocity", "collision"
)  # fmt: skip
"""The seven terms, in the order of arrays."""


@dataclass(frozen=True, slots=True)
class Weights:
    """Weights of the seven terms; velocities, accelerations and jerks are differences of joint values per update.

    Attributes: one for each of `TERMS`.

    Raises:
        InputError: a weight that is negative or not finite, or none above zero.
    """

    position: float = 50.0
    orientation: float = 40.0
    joint_velocity: float = 0.1
    joint_acceleration: float = 1.0
    joint_jerk: float = 2.0
    tool_velocity: float = 0.1
    collision: float = 2.0

    def __post_init__(self) -> None:
        for one in fields(self):
            value = getattr(self, one.name)
            if not 0.0 <= value < np.inf:
                raise InputError(f"a weight of {value}", where=one.name, remedy="0 or more, finite")
        if not any(astuple(self)):
            raise InputError("all weights are zero", where="weights", remedy="one above zero at least")

    @property
    def array(self) -> Array:
        """(7,) in the order of `TERMS`."""
        return np.array(astuple(self), dtype=float)


WEIGHTS_A = Weights()
"""Accurate (the paper's set A)."""
WEIGHTS_B = Weights(10.0, 9.0, 5.0, 4.0, 3.0, 2.0, 5.0)
"""Smooth (the paper's set B)."""
LOSSES = ("groove", "quadratic")
"""The paper's loss (Eq. 3), and the one that it is compared with (Eq. 11)."""
