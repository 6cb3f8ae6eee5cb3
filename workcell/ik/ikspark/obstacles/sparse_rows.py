"""Rows of a sparse system, collected piece by piece."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from workcell.pose import Array


class SparseRows:
    """Rows `a . v <= b` or `a . v = b` as triplets and right-hand sides.

    Attributes:
        count: rows so far.
    """

    def __init__(self) -> None:
        self.count = 0
        self._rows: list[NDArray[np.int64]] = []
        self._columns: list[NDArray[np.int64]] = []
        self._values: list[Array] = []
        self._levels: list[Array] = []

    @staticmethod
    def of(A: Array, b: Array) -> SparseRows:
        """All rows of a dense system."""
        rows = SparseRows()
        rows.add_dense(A, b)
        return rows

    def add(self, levels: Array) -> int:
        """Appends empty rows with right-hand sides `levels` (k,); returns the index of the first."""
        first = self.count
        self.count += len(levels)
        self._levels.append(levels)
        return first

    def add_dense(self, A: Array, b: Array) -> None:
        """Appends the rows of a dense system in the first columns."""
        first = self.add(b)
        row, column = np.nonzero(A)
        self.put(first + row, column, A[row, column])

    def put(self, rows: NDArray[np.int64], columns: NDArray[np.int64], values: ArrayLike) -> None:
        """Entries (k,) of rows that were added; a single value stands for all."""
        self._rows.append(rows)
        self._columns.append(columns)
        self._values.append(np.broadcast_to(np.asarray(values, dtype=float), rows.shape))


def stacked(parts: Sequence[SparseRows], width: int) -> tuple[Any, Array]:
    """The parts' rows one below the other, as a scipy CSC matrix (rows, width), and the right-hand sides."""
    from scipy.sparse import csc_matrix

    starts = np.cumsum([0, *(part.count for part in parts)])
    rows = [row + start for part, start in zip(parts, starts, strict=False) for row in part._rows]
    columns = [column for part in parts for column in part._columns]
    values = [value for part in parts for value in part._values]
    levels = [level for part in parts for level in part._levels]
    triplets = (np.concatenate(values), (np.concatenate(rows), np.concatenate(columns)))
    return csc_matrix(triplets, shape=(int(starts[-1]), width)), np.concatenate(levels)
