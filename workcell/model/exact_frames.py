"""Axes and joint frames that a file of few digits has nearly right, made exact."""

from __future__ import annotations

import numpy as np

from workcell.pose import Array

NEARLY = 1e-6
"""How far axes may be from unit vectors, and joint frames from rotations; they are made exact."""
_ROUNDED = 3e-15
"""How far from exact rounding alone may leave them: such are taken as they are."""


def unit_vectors(vectors: Array) -> Array:
    """Vectors (n, 3) made unit vectors, those that are but for rounding as they are."""
    lengths = np.linalg.norm(vectors, axis=-1, keepdims=True)
    units: Array = np.where(np.abs(lengths - 1.0) > _ROUNDED, vectors / lengths, vectors)
    return units


def rotations(matrices: Array) -> Array:
    """Matrices (n, 3, 3) made the rotations nearest to them, those that are but for rounding as they are."""
    off = np.abs(matrices @ np.swapaxes(matrices, -1, -2) - np.eye(3)).max(axis=(-2, -1))
    if not np.any(off > _ROUNDED):
        return matrices
    left, _, right = np.linalg.svd(matrices)
    exact: Array = np.where((off > _ROUNDED)[:, None, None], left @ right, matrices)
    return exact
