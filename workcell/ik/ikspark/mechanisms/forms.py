"""The two lifts of a rotation: 7x7 of Prop. 2 (Eq. 16-20), and 4x4 of unit quaternions (Eq. 77-78).

Both are kept homogeneous: a block Y stands for `weight * R`, with weight 1 for a rotation itself. So the part t R of a
slide that is out by t is a block of weight t of the same form.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import lru_cache
from typing import Literal

import numpy as np

from workcell.ik.ikspark.lift import rotation_map
from workcell.ik.shared.conic import smat, svec, triangle
from workcell.pose import Array, read_only

FormName = Literal["quaternion", "rotation"]


@dataclass(frozen=True, slots=True)
class Form:
    """One way to lift a rotation.

    Attributes:
        name: see `FormName`.
        order: of the PSD block.
        rotation: (3, 3, size) `weight * R` as a linear function of the block's triangle.
        weight: (size,) the weight as one.
        structure: (k, size) what is zero for every block.
        trace: of the block of a rotation, which is its largest eigenvalue.
    """

    name: FormName
    order: int
    rotation: Array
    weight: Array
    structure: Array
    trace: float

    @property
    def size(self) -> int:
        """Numbers of a block's triangle."""
        return len(self.weight)

    def lift(self, R: Array) -> Array:
        """Triangles (..., size) of rotations (..., 3, 3)."""
        if self.name == "quaternion":  # products of a quaternion's numbers are linear in its rotation
            products: Array = R.reshape(*R.shape[:-2], 9) @ _PRODUCTS[:9] + _PRODUCTS[9]
            return products
        y = np.concatenate([R[..., 0], R[..., 1], np.ones((*R.shape[:-2], 1))], axis=-1)
        return svec(y[..., :, None] * y[..., None, :])

    def top(self, x: Array) -> tuple[Array, Array]:
        """Largest eigenvalues (k,) of blocks (k, size), and the gradients (k, size) of them."""
        values, vectors = np.linalg.eigh(smat(x, self.order))
        v = vectors[:, :, -1]
        return values[:, -1], svec(v[:, :, None] * v[:, None, :])

    def second(self, x: Array) -> Array:
        """Second largest eigenvalues (k,) of blocks (k, size)."""
        return np.asarray(np.linalg.eigvalsh(smat(x, self.order))[:, -2], dtype=float)


def _trace_of(order: int) -> Array:
    rows, columns, _ = triangle(order)
    return np.asarray(rows == columns, dtype=float)


_PRODUCTS = np.linalg.inv(np.vstack([rotation_map().reshape(9, 10), _trace_of(4)[None]])).T
"""(10, 10) the triangle of q q^T from the entries of its rotation, row by row, and one."""


@lru_cache(maxsize=2)
def form_of(name: FormName) -> Form:
    """The form of that name."""
    return _quaternion() if name == "quaternion" else _rotation()


def _quaternion() -> Form:
    return Form("quaternion", 4, read_only(rotation_map()), read_only(_trace_of(4)), np.zeros((0, 10)), 1.0)


def _rotation() -> Form:
    rows, columns, factor = triangle(7)
    place = {(int(i), int(j)): k for k, (i, j) in enumerate(zip(rows, columns, strict=True))}
    size = len(rows)

    def entry(i: int, j: int) -> Array:
        row = np.zeros(size)
        k = place[(min(i, j), max(i, j))]
        row[k] = 1.0 / factor[k]
        return row

    R = np.zeros((3, 3, size))
    for i in range(3):
        R[i, 0], R[i, 1] = entry(i, 6), entry(3 + i, 6)
        j, k = (i + 1) % 3, (i + 2) % 3
        R[i, 2] = entry(j, 3 + k) - entry(k, 3 + j)
    weight = entry(6, 6)
    structure = [
        sum((entry(i, i) for i in range(3)), np.zeros(size)) - weight,
        sum((entry(3 + i, 3 + i) for i in range(3)), np.zeros(size)) - weight,
        sum((entry(i, 3 + i) for i in range(3)), np.zeros(size)),
    ]
    return Form("rotation", 7, read_only(R), read_only(weight), read_only(structure), 3.0)
