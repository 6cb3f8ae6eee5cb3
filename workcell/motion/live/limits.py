"""`LiveLimits`: how fast joints may move, and how fast that may change."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike

from workcell.errors import InputError
from workcell.pose import Array, read_only


@dataclass(frozen=True, slots=True)
class LiveLimits:
    """Hard limits of each joint, symmetric; infinite: none.

    Attributes:
        velocity: (n,) radians or metres a second (Eq. 8).
        acceleration: (n,) per second squared.
        jerk: (n,) per second cubed.

    Raises:
        InputError: limits that are not positive, of different lengths, or a velocity without an end.
    """

    velocity: Array
    acceleration: Array
    jerk: Array

    def __post_init__(self) -> None:
        for name in ("velocity", "acceleration", "jerk"):
            values = np.atleast_1d(np.asarray(getattr(self, name), dtype=float))
            if values.ndim != 1 or not np.all(values > 0):
                raise InputError(f"a limit that is not positive: {values.tolist()}", where=name)
            object.__setattr__(self, name, read_only(values))
        if not len(self.velocity) == len(self.acceleration) == len(self.jerk):
            raise InputError("limits of different numbers of joints", where="limits")
        if not np.all(np.isfinite(self.velocity)):
            raise InputError("a joint without a velocity limit", where="velocity", remedy="a finite one")

    @staticmethod
    def of(velocity: ArrayLike, acceleration: ArrayLike, jerk: ArrayLike | None = None) -> LiveLimits:
        """With `jerk` None an acceleration is reached within a tenth of a second."""
        a = np.asarray(acceleration, dtype=float)
        return LiveLimits(np.asarray(velocity), a, 10.0 * a if jerk is None else np.asarray(jerk))
