"""A relaxation with the numbers of one problem, on a Clarabel instance that is reused from problem to problem."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass, replace
from functools import lru_cache
from typing import Any

import numpy as np
from numpy.typing import NDArray

from workcell.errors import InputError
from workcell.ik.ikspark.lift import Lift, goal_vector
from workcell.ik.ikspark.relaxation import Relaxation
from workcell.ik.problem import IKProblem
from workcell.ik.shared.conic import Cones, ConicSolution, ConicSolver
from workcell.ik.shared.limits import Interval
from workcell.model.robot import Robot
from workcell.pose import Array

_INCONSISTENT = 1e-9


class Structure:
    """A `Relaxation`, the sparsity pattern that holds at every goal, and idle solvers of that pattern."""

    def __init__(self, relaxation: Relaxation, tensor: Array, tolerance: float) -> None:
        self.relaxation, self.tolerance = relaxation, tolerance
        mask = np.any(tensor[:, :-1] != 0.0, axis=-1)
        first = relaxation.first_halfspace
        mask[first : first + relaxation.halfspaces] = True
        if relaxation.deficient:
            # the equalities are replaced by as many dense rows as they have independent ones
            zero = relaxation.cones.zero
            mask = np.vstack([np.ones((relaxation.rank, mask.shape[1]), dtype=bool), mask[zero:]])
        mask = np.vstack([mask, relaxation.tail_A != 0.0])
        self.columns, self.rows = np.nonzero(mask.T)
        self.shape = mask.shape
        self.cones = (
            replace(relaxation.cones, zero=relaxation.rank) if relaxation.deficient else relaxation.cones
        )
        self.idle: list[ConicSolver] = []

    def solver(self, A: Array, b: Array) -> tuple[ConicSolver, bool]:
        """A solver of this pattern, and whether it is new (then it holds these numbers already)."""
        if self.idle:
            return self.idle.pop(), False
        from scipy.sparse import csc_matrix

        starts = np.searchsorted(self.columns, np.arange(self.shape[1] + 1))
        sparse = csc_matrix((A[self.rows, self.columns], self.rows, starts), shape=self.shape)
        return ConicSolver(sparse, b, self.cones, tolerance=self.tolerance), True


class Instance:
    """One problem's relaxation, ready to be minimised over.

    Attributes:
        relaxation, goal, interval: structure, goal vector (13,), joint intervals.
        head: (head, N + 1) the changing rows at this goal.
        contradiction: (rows,) a ray that proves the equalities inconsistent, or None.
        solves: number of cone programs solved so far.
    """

    def __init__(self, problem: IKProblem, structure: Structure) -> None:
        self.problem, self._structure = problem, structure
        self.relaxation = structure.relaxation
        self.goal = goal_vector(problem.T_base_tool)
        self.interval = Interval.of(problem)
        self.head = self.relaxation.tensor(self.interval, problem) @ self.goal
        self.contradiction: Array | None = None
        self.solves = 0
        self._basis: Array | None = None
        self._solver: ConicSolver | None = None
        self._stale = True
        if self.relaxation.deficient:
            self._reduce()

    @property
    def lift(self) -> Lift:
        """The meaning of the variables."""
        return self.relaxation.lift

    @property
    def solved_cones(self) -> Cones:
        """Of the rows as solved: without dependent equalities."""
        return self._structure.cones

    def _reduce(self) -> None:
        """Replace dependent equalities by an orthonormal basis of their row combinations; note a contradiction."""
        zero, rank = self.relaxation.cones.zero, self.relaxation.rank
        A, b = -self.head[:zero, :-1], self.head[:zero, -1]
        left = np.linalg.svd(A)[0]
        self._basis = left[:, :rank]
        residual = left[:, rank:] @ (left[:, rank:].T @ b)
        if np.linalg.norm(residual) > _INCONSISTENT:
            self.contradiction = np.zeros(self.relaxation.cones.rows)
            self.contradiction[:zero] = -residual / np.linalg.norm(residual)

    def set_halfspaces(self, rows: Array) -> None:
        """Demand `rows (x, 1) >= 0`, rows (k, N + 1) with k up to the structure's slots; earlier ones are forgotten."""
        first, slots = self.relaxation.first_halfspace, self.relaxation.halfspaces
        if len(rows) > slots:
            raise InputError(f"{len(rows)} half-spaces do not fit into {slots} slots", where="rows")
        self.head[first : first + slots] = 0.0
        self.head[first : first + slots, -1] = 1.0
        self.head[first : first + len(rows)] = rows
        self._stale = True

    def numbers(self) -> tuple[Array, Array]:
        """A (rows, N) and b (rows,) as solved."""
        A, b = self.relaxation.dense(self.head)
        return self.independent(A, b)

    def independent(self, A: Array, b: Array) -> tuple[Array, Array]:
        """The rows with dependent equalities replaced by independent combinations, where there are such."""
        if self._basis is None:
            return A, b
        zero = self.relaxation.cones.zero
        return np.vstack([self._basis.T @ A[:zero], A[zero:]]), np.concatenate(
            [self._basis.T @ b[:zero], b[zero:]]
        )

    def solve(self, q: Array) -> ConicSolution:
        """Minimise q.x (N,) over the relaxation; `z` is over the relaxation's own rows."""
        values: Array | None = None
        b: Array | None = None
        if self._stale:
            A, b = self.numbers()
            fresh = False
            if self._solver is None:
                self._solver, fresh = self._structure.solver(A, b)
            values = A[self._structure.rows, self._structure.columns]
            if fresh:
                b = values = None
            self._stale = False
        assert self._solver is not None  # set on the first solve, which is always stale
        self.solves += 1
        solution = self._solver.solve(q, b=b, values=values)
        return solution if self._basis is None else replace(solution, z=self.original(solution.z))

    def original(self, z: Array) -> Array:
        """A dual over the rows as solved, over the relaxation's own rows."""
        if self._basis is None:
            return z
        rank = self.relaxation.rank
        return np.concatenate([self._basis @ z[:rank], z[rank:]])

    def release(self) -> None:
        """Hand the solver back for the next problem of this structure."""
        if self._solver is not None:
            self._structure.idle.append(self._solver)
            self._solver = None
            self._stale = True


@dataclass(frozen=True, slots=True, eq=False)
class _Key:
    """What a structure depends on; robots are compared by their numbers."""

    robot: Robot
    numbers: bytes
    rest: tuple[Any, ...]

    def __hash__(self) -> int:
        return hash((self.numbers, self.rest))

    def __eq__(self, other: object) -> bool:
        return isinstance(other, _Key) and self.numbers == other.numbers and self.rest == other.rest


@lru_cache(maxsize=32)
def _lift(key: _Key) -> Lift:
    return Lift(key.robot)


@lru_cache(maxsize=32)
def _relaxation(key: _Key) -> Relaxation:
    limited, link_rotation, halfspaces = key.rest
    lift = _lift(_Key(key.robot, key.numbers, ()))
    return Relaxation(lift, limited, link_rotation=link_rotation, halfspaces=halfspaces)


@lru_cache(maxsize=32)
def _structure(key: _Key, tolerance: float) -> Structure:
    relaxation = _relaxation(key)
    return Structure(relaxation, relaxation.pattern(), tolerance)


def _key(problem: IKProblem, halfspaces: int) -> _Key:
    if problem.max_link_rotation is not None and problem.q_reference is None:
        raise InputError("max_link_rotation needs q_reference", where="max_link_rotation")
    robot, tool = problem.robot, problem.robot.tool().T_link_tool
    arrays: tuple[NDArray[Any], ...] = (robot.joint_xyz, robot.joint_rotation, robot.axis, robot.prismatic)
    numbers = b"".join(a.tobytes() for a in (*arrays, tool.position, tool.quat_wxyz))
    limited = tuple((Interval.of(problem).half < np.pi).tolist())
    return _Key(robot, numbers, (limited, problem.max_link_rotation is not None, halfspaces))


def relaxation_of(problem: IKProblem, *, halfspaces: int = 0) -> Relaxation:
    """The structure of a problem's relaxation, built once for a robot and shared from then on.

    Raises:
        InputError: a prismatic joint, a tree, or `max_link_rotation` without `q_reference`.
    """
    return _relaxation(_key(problem, halfspaces))


@contextmanager
def instance_of(problem: IKProblem, *, halfspaces: int = 0, tolerance: float = 1e-6) -> Iterator[Instance]:
    """A problem's relaxation with room for `halfspaces` more rows; raises as `relaxation_of`."""
    instance = Instance(problem, _structure(_key(problem, halfspaces), tolerance))
    try:
        yield instance
    finally:
        instance.release()
