"""The memory of a search among obstacles that has not begun, and the compiled kernels that work in it."""

from __future__ import annotations

import functools
import importlib
from typing import TYPE_CHECKING, Any

import numpy as np

from workcell.geometry.packing import random_state

if TYPE_CHECKING:
    from workcell.ik.hjcd.kernels.search import Memory


@functools.cache
def kernels() -> Any:
    """The compiled kernels (`workcell.ik.hjcd.kernels.entries`), imported on first use: numba takes half a second."""
    return importlib.import_module("workcell.ik.hjcd.kernels.entries")


def new_memory(dof: int, seed: int) -> Memory:
    """A search that has not begun."""
    entries = kernels()
    counts = np.zeros(8)
    counts[entries.ARC], counts[entries.BEST] = -1.0, np.inf
    misses = np.full((entries.MISSES, dof + 3), -1e3)
    points = np.empty((entries.MEMORY, 2 * dof + 1))
    memory: Memory = entries.Memory(
        random_state(seed), counts, points, np.zeros(1), np.zeros(dof), np.zeros(dof), misses
    )
    return memory
