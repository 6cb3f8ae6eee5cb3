"""`Objective`: the weighted sum of a frame, for optimisers of others."""

from __future__ import annotations

import importlib
from typing import Any

import numpy as np

from workcell.pose import Array


class Objective:
    """What one frame minimises over configurations (n,): the paper's weighted sum (Eq. 1-2).

    Args:
        frame: the frame's arrays for the kernels; box: (2, n) where its configurations are.
    """

    def __init__(self, frame: Any, box: Array) -> None:
        self._frame, self._box, self._gradient = frame, box, np.empty(box.shape[1])
        self._kernel = importlib.import_module("workcell.motion.live.kernels.relax").objective

    def value(self, q: Array) -> float:
        """At q (n,)."""
        return float(self._kernel(self._frame, q, self._gradient))

    def value_and_gradient(self, q: Array) -> tuple[float, Array]:
        """At q (n,), with the gradient (n,), which the next call overwrites."""
        value = float(self._kernel(self._frame, q, self._gradient))
        return value, self._gradient

    def bounds(self) -> tuple[Array, Array]:
        """(n,) and (n,): the velocity limits (Eq. 8) around the last solution, within what the arm can stop in."""
        return self._box[0].copy(), self._box[1].copy()
