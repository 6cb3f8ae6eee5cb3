"""Parts of a relaxation that no row ties together, each solved by itself: two arms that hold what has a goal.

The origin of a floating body that a goal determines ties nothing together: it is put in.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from workcell.ik.ikspark.mechanisms.blocks import Blocks
from workcell.ik.ikspark.mechanisms.program import Multipliers, Program
from workcell.ik.ikspark.mechanisms.relaxation import Relaxation
from workcell.ik.ikspark.mechanisms.rows import Rows
from workcell.ik.ikspark.mechanisms.users.constraints import UserRows
from workcell.pose import Array

_NONE = 1e-13
"""Entries below this are none."""


@dataclass(frozen=True, slots=True, eq=False)
class Part:
    """Some of the variables.

    Attributes:
        columns: (k,) which.
        blocks: the blocks among them.
        program: the set of all values that they can have.
    """

    columns: NDArray[np.int64]
    blocks: Blocks
    program: Program


@dataclass(frozen=True, slots=True)
class Parts:
    """All parts of a relaxation.

    Attributes:
        parts: in the order of their first variable.
        fixed: (N,) values of the variables that are determined; nan of the others.
        rows: of the whole relaxation.
        whole: the program of all rows together, with those that spheres and curves add.
    """

    parts: tuple[Part, ...]
    fixed: Array
    rows: tuple[Rows, ...]
    whole: Program

    @staticmethod
    def of(relaxation: Relaxation, extra: UserRows | None) -> Parts:
        """The parts of a relaxation; users' rows tie all of them together."""
        lift, rows = relaxation.lift, relaxation.rows
        whole = Program(lift.size, rows, extra)
        floating = [at + k for at in lift.floating.values() for k in range(3)] if extra is None else []
        fixed = _fixed(rows, lift.size, floating)
        label = np.zeros(lift.size, dtype=np.int64) if extra is not None else _components(rows, fixed)
        parts = []
        for number in range(int(label.max(initial=-1)) + 1):
            columns = np.flatnonzero(label == number)
            if len(columns) == lift.size:
                return Parts((Part(columns, lift.blocks, whole),), fixed, rows, whole)
            own = [part for one in rows if (part := _own(one, columns, fixed)) is not None]
            parts.append(Part(columns, lift.blocks.among(columns), Program(len(columns), own)))
        return Parts(tuple(parts), fixed, rows, whole)

    @property
    def solves(self) -> int:
        """Cone programs solved so far."""
        own = sum(part.program.solves for part in self.parts if part.program is not self.whole)
        return self.whole.solves + own

    def multipliers(self, part: Part, z: Array) -> Multipliers | None:
        """A part's dual by families of rows, with those of the rows that determine variables."""
        found = part.program.multipliers(z)
        if found is None or part.program is self.whole:
            return found
        missing = np.zeros(len(self.fixed) + 1)
        for one in self.rows:
            if (one.family, one.index) in found:
                missing += found[(one.family, one.index)] @ _kept(one, part.columns, self.fixed)
        for one in self.rows:
            if one.cone == "zero" and (one.family, one.index) not in found:
                found[(one.family, one.index)] = _balancing(one, missing, self.fixed)
        return found


def _fixed(rows: Sequence[Rows], size: int, among: Sequence[int]) -> Array:
    """(N,) values of those of some variables that an equality with no other one determines; nan of the others."""
    values = np.full(size, np.nan)
    for one in rows:
        if one.cone != "zero":
            continue
        count = (np.abs(one.rows[:, :-1]) > _NONE).sum(axis=1)
        for row in one.rows[count == 1]:
            column = int(np.argmax(np.abs(row[:-1])))
            if column in among:
                values[column] = -row[-1] / row[column]
    return values


def _components(rows: Sequence[Rows], fixed: Array) -> NDArray[np.int64]:
    """(N,) the part of each variable, -1 of those that are determined."""
    from scipy.sparse import csr_matrix
    from scipy.sparse.csgraph import connected_components

    tied = [np.abs(one.rows[:, :-1]) > _NONE for one in rows]
    together = [
        np.any(each, axis=0)[None] for one, each in zip(rows, tied, strict=True) if one.cone in ("soc", "psd")
    ]
    free = np.isnan(fixed)
    pattern = csr_matrix(np.vstack([*tied, *together])[:, free], dtype=float)
    label = np.full(len(fixed), -1, dtype=np.int64)
    label[free] = connected_components(pattern.T @ pattern, directed=False)[1]
    return label


def _own(one: Rows, columns: NDArray[np.int64], fixed: Array) -> Rows | None:
    """Rows over some of the variables, with what is determined put in; None: they have none of these variables."""
    kept = one.rows[:, columns]
    if not np.any(np.abs(kept) > _NONE):
        return None
    constant = one.rows[:, -1] + one.rows[:, :-1] @ np.nan_to_num(fixed)
    rows = np.hstack([kept, constant[:, None]])
    if one.cone in ("zero", "nonneg"):
        # a row that is only about what is determined is none of this part
        rows[~np.any(np.abs(kept) > _NONE, axis=1)] = 0.0
        if one.cone == "nonneg":
            rows = rows[np.any(rows != 0.0, axis=1)]
    return Rows(one.family, one.index, one.cone, rows)


def _kept(one: Rows, columns: NDArray[np.int64], fixed: Array) -> Array:
    """The rows of `_own`, as long as its multipliers, over all variables."""
    if one.cone != "nonneg":
        return one.rows
    return one.rows[np.any(np.abs(one.rows[:, columns]) > _NONE, axis=1)]


def _balancing(one: Rows, missing: Array, fixed: Array) -> Array:
    """Multipliers of equalities that determine variables, so that these drop out of the sum `missing` (N + 1,)."""
    z = np.zeros(len(one.rows))
    for k, row in enumerate(one.rows):
        columns = np.flatnonzero(np.abs(row[:-1]) > _NONE)
        if len(columns) == 1 and not np.isnan(fixed[columns[0]]) and missing[columns[0]] != 0.0:
            z[k] = -missing[columns[0]] / row[columns[0]]
            missing += z[k] * row
    return z
