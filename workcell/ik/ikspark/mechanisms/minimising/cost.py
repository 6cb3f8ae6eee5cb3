"""Problem 2b's cost: the squared errors of goals' poses (Eq. 36), minimised over a relaxation.

Errors are variables of their own behind the others, so that the quadratic part stays diagonal however long a chain is.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from workcell.ik.ikspark.mechanisms.program import Multipliers, Program
from workcell.ik.ikspark.mechanisms.relaxation import Relaxation
from workcell.ik.ikspark.mechanisms.users.constraints import UserRows
from workcell.ik.shared.conic import Cones, ConicSolution, ConicSolver
from workcell.pose import Array

NUMBERS = 12
"""Errors of a goal's pose: of its rotation (9, row by row), then of its position (3)."""


@dataclass(frozen=True, slots=True)
class PoseCost:
    """The cost `f(x) = |rows (x, 1)|^2` of variables x (N,), square metres and squares of entries of rotations.

    Attributes:
        rows: (m, N + 1) errors of what goals ask of positions and rotations.
        places: (m,) where among all `NUMBERS` errors of all goals they are.
        goals: how many goals there are.
    """

    rows: Array
    places: NDArray[np.int64]
    goals: int

    @staticmethod
    def of(relaxation: Relaxation) -> PoseCost:
        """The cost of a question, over the variables of its relaxation without the goals' poses."""
        lift, problem = relaxation.lift, relaxation.problem
        rows, places = [np.zeros((0, lift.size + 1))], [np.zeros(0, dtype=np.int64)]
        for g, goal in enumerate(problem.goals):
            frame = lift.mechanism.frame(goal.frame)
            T = frame.T_link_frame
            if goal.rotation is not None:
                R = np.einsum("ijx,jk->ikx", lift.rotations[frame.link], T.rotation).reshape(9, -1)
                rows.append(_less(R, goal.rotation.ravel()))
                places.append(NUMBERS * g + np.arange(9))
            if goal.position is not None:
                rows.append(_less(lift.point(frame.link, T.position), goal.position))
                places.append(NUMBERS * g + np.arange(9, NUMBERS))
        return PoseCost(np.concatenate(rows), np.concatenate(places), len(problem.goals))

    def errors(self, x: Array) -> Array:
        """(goals, NUMBERS) errors at x (N,), zero where nothing is asked."""
        found = np.zeros(self.goals * NUMBERS)
        found[self.places] = self.rows[:, :-1] @ x + self.rows[:, -1]
        return found.reshape(-1, NUMBERS)

    def at(self, x: Array) -> float:
        """f(x)."""
        return float(np.sum(self.errors(x) ** 2))


class CostProgram(Program):
    """The program of a relaxation with its cost added to what is minimised.

    Args:
        relaxation: made without the goals' poses.
        extra: users' rows.
        tolerance: of Clarabel.
    """

    def __init__(
        self, relaxation: Relaxation, extra: UserRows | None = None, *, tolerance: float = 1e-7
    ) -> None:
        super().__init__(relaxation.lift.size, relaxation.rows, extra, tolerance=tolerance)
        self.cost = PoseCost.of(relaxation)

    def closest(self, *, tolerance: float | None = None) -> ConicSolution:
        """Minimise the cost over the set; `x` and `z` as of `solve`.

        Sets with next to nothing in them can make Clarabel panic: that is a solve that failed.
        """
        try:
            return self.solve(np.zeros(self.size), tolerance=tolerance)
        except BaseException as error:
            # a panic in Clarabel's Rust code arrives outside the Exception hierarchy
            if type(error).__name__ != "PanicException":
                raise
            self.cut(self._cuts)
            nothing = np.zeros(0)
            return ConicSolution("failed", nothing, nothing, np.nan, 0)

    def multipliers(self, z: Array) -> Multipliers | None:
        """A dual z by families of rows, those of the errors left out; see `Program.multipliers`."""
        return super().multipliers(z[len(self.cost.rows) :])

    def _padded(self, q: Array) -> Array:
        return np.concatenate([super()._padded(q), np.zeros(len(self.cost.rows))])

    def _made(self, tolerance: float) -> ConicSolver:
        from scipy import sparse

        A, b, cones = self._assembled()
        m, others = len(self.cost.rows), A.shape[1] - self.size
        E = sparse.csc_matrix(self.cost.rows[:, :-1])
        top = sparse.hstack([E, sparse.csc_matrix((m, others)), -sparse.identity(m)])
        below = sparse.hstack([A, sparse.csc_matrix((A.shape[0], m))])
        P = sparse.diags(np.concatenate([np.zeros(A.shape[1]), np.full(m, 2.0)])).tocsc()
        P.eliminate_zeros()
        return ConicSolver(
            sparse.vstack([top, below]).tocsc(),
            np.concatenate([-self.cost.rows[:, -1], b]),
            _with_more(cones, m),
            tolerance=tolerance,
            P=P,
        )


def _with_more(cones: Cones, equalities: int) -> Cones:
    return replace(cones, zero=cones.zero + equalities)


def _less(rows: Array, target: Array) -> Array:
    found = np.array(rows)
    found[:, -1] -= target
    return found
