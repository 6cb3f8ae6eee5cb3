"""The convex set that holds every lifted configuration reaching a target: IKSPARK's Ybar with pose equalities.

Rows are `s = S(goal) (x, 1)` with s in a cone, in Clarabel's order: equalities; half-spaces (limits of the joints next
to the base and the goal, bounds on link rotations, faces to stay outside of); second-order cones (other joint limits,
unit discs); PSD triangles (quaternion blocks). A joint whose interval spans a whole turn has no row.
"""

from __future__ import annotations

import numpy as np

from workcell.ik.ikspark.lift import GOAL, Lift, frame_with_z, goal_vector
from workcell.ik.problem import STEP_SLACK, IKProblem
from workcell.ik.shared.conic import Cones
from workcell.ik.shared.limits import Interval
from workcell.pose import Array

_RANK_TOLERANCE = 1e-7


class Relaxation:
    """Rows of one structure: a chain, which of its joints are limited, and how many half-spaces may be added.

    Attributes:
        lift: the chain's variables and maps.
        cones: of all rows; the last ones (discs and PSD triangles) never change.
        head: number of rows before those.
        deficient: whether the equalities are dependent for every goal (short or degenerate chains).
    """

    def __init__(
        self, lift: Lift, limited: tuple[bool, ...], *, link_rotation: bool, halfspaces: int
    ) -> None:
        self.lift, self.link_rotation, self.halfspaces = lift, link_rotation, halfspaces
        self.chords = tuple(k for k in lift.direct if limited[k])
        self.coned = tuple(k for k in range(lift.robot.dof) if limited[k] and k not in lift.direct)
        self.rotated = (*lift.balls, *(d.link for d in lift.discs)) if link_rotation else ()
        self.first_halfspace = len(lift.equalities) + len(self.chords) + len(self.rotated)
        nonneg = len(self.chords) + len(self.rotated) + halfspaces
        self.cones = Cones(
            zero=len(lift.equalities),
            nonneg=nonneg,
            soc=(4,) * len(self.coned) + (3,) * len(lift.discs),
            psd=(4,) * len(lift.balls),
        )
        self.head = self.cones.zero + nonneg + 4 * len(self.coned)
        self._limit_vectors = self._vectors()
        self.tail_A, self.tail_b = self._tail()
        self._latest: tuple[bytes, Array] = (b"", np.zeros(0))
        self.rank = self._structural_rank()
        self.deficient = self.rank < self.cones.zero

    def _vectors(self) -> tuple[Array, Array, Array]:
        """For each coned joint: e1 and e2 of its frame on the parent's side, e1 on the child's (Eq. 8)."""
        robot, R = self.lift.robot, self.lift.rotations
        shape = (len(self.coned), 3, self.lift.size + 1, GOAL)
        u, v, w = (np.zeros(shape) for _ in range(3))
        for i, k in enumerate(self.coned):
            frame = frame_with_z(robot.axis[k])
            parent = robot.joint_rotation[k] @ frame
            u[i] = np.einsum("abxg,b->axg", R[k], parent[:, 0])
            v[i] = np.einsum("abxg,b->axg", R[k], parent[:, 1])
            w[i] = np.einsum("abxg,b->axg", R[k + 1], frame[:, 0])
        return u, v, w

    def _tail(self) -> tuple[Array, Array]:
        """A and b of the discs |(c, s)| <= 1 and of the blocks Q >= 0."""
        lift = self.lift
        rows = 3 * len(lift.discs) + 10 * len(lift.balls)
        A, b = np.zeros((rows, lift.size)), np.zeros(rows)
        for i, d in enumerate(lift.discs):
            b[3 * i] = 1.0
            A[3 * i + 1, d.start] = A[3 * i + 2, d.start + 1] = -1.0
        first = 3 * len(lift.discs)
        A[first:, : 10 * len(lift.balls)] = -np.eye(10 * len(lift.balls))
        return A, b

    def _structural_rank(self) -> int:
        """Largest rank of the equalities over a few reachable goals."""
        robot, rng = self.lift.robot, np.random.default_rng(0)
        ranks = []
        for q in rng.uniform(-3.0, 3.0, (3, robot.dof)):
            goal = goal_vector(robot.T_world_base.inverse() @ robot.fk(q))
            A = self.lift.at(self.lift.equalities, goal)[:, :-1]
            ranks.append(int(np.linalg.matrix_rank(A, tol=_RANK_TOLERANCE)))
        return max(ranks)

    def pattern(self) -> Array:
        """A tensor like `tensor`'s that is nonzero wherever one may be."""
        rows = np.abs(self._tensor(np.full(self.lift.robot.dof, 0.7), np.ones(self.lift.robot.dof), None))
        coned = rows[self.head - 4 * len(self.coned) :].reshape(len(self.coned), 4, self.lift.size + 1, GOAL)
        u, v, w = self._limit_vectors
        coned[:, 1:] += np.abs(u) + np.abs(v) + np.abs(w)
        return rows

    def tensor(self, interval: Interval, problem: IKProblem) -> Array:
        """S (head, N + 1, 13) of the changing rows; the slots for half-spaces hold `1 >= 0`."""
        key = interval.lower.tobytes() + interval.upper.tobytes()
        if self.rotated or self._latest[0] != key:
            S = self._tensor(interval.middle, np.clip(interval.half, 0.0, np.pi), problem)
            S.flags.writeable = False
            # problems of one robot mostly share their limits
            self._latest = (key, S)
        return self._latest[1]

    def _tensor(self, middle: Array, half: Array, problem: IKProblem | None) -> Array:
        lift, cones = self.lift, self.cones
        S = np.zeros((self.head, lift.size + 1, GOAL))
        S[: cones.zero] = lift.equalities
        at = cones.zero
        for k in self.chords:
            start = lift.direct[k].start
            S[at, [start, start + 1, -1], 0] = np.cos(middle[k]), np.sin(middle[k]), -np.cos(half[k])
            at += 1
        if self.rotated:
            S[at : at + len(self.rotated)] = self._link_rotations(problem)
            at += len(self.rotated)
        S[at : at + self.halfspaces, -1, 0] = 1.0
        at += self.halfspaces
        if self.coned:
            u, v, w = self._limit_vectors
            chosen = list(self.coned)
            c, s = (f(middle[chosen])[:, None, None, None] for f in (np.cos, np.sin))
            rows = S[at:].reshape(len(chosen), 4, lift.size + 1, GOAL)
            rows[:, 0, -1, 0] = 2.0 * np.sin(0.5 * half[chosen])
            rows[:, 1:] = c * u + s * v - w
        return S

    def _link_rotations(self, problem: IKProblem | None) -> Array:
        """Eq. 75 as half-spaces: |R - R_ref|_F^2 = 6 - 2 <R, R_ref> for rotations, and tighter between them."""
        links = list(self.rotated)
        if problem is None or problem.q_reference is None or problem.max_link_rotation is None:
            every: Array = np.abs(self.lift.rotations[links]).sum(axis=(1, 2))
            return every
        T = problem.robot.link_transforms(problem.q_reference)
        R_ref = (T[0, :3, :3].T @ T[:, :3, :3])[links]
        rows: Array = np.einsum("kabxg,kab->kxg", self.lift.rotations[links], R_ref)
        rows[:, -1, 0] -= 3.0 - 0.5 * (problem.max_link_rotation + STEP_SLACK) ** 2
        return rows

    def dense(self, head: Array) -> tuple[Array, Array]:
        """A (rows, N) and b (rows,) from the changing rows S(goal), (head, N + 1)."""
        return np.vstack([-head[:, :-1], self.tail_A]), np.concatenate([head[:, -1], self.tail_b])
