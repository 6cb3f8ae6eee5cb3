"""CIDGIK on long chains: small overlapping blocks instead of one large Z (a tree's distance graph is chordal).

Each pair of neighbouring links has a block [X I]^T [X I] of its own, reduced like the whole (`Instance`); blocks that
share a link agree on the inner products of its vectors. By completion of chordal patterns nothing is lost: every
row lies inside a block, and blocks of rank d that agree belong to one configuration. C has the blocks' pattern.
"""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

from workcell.ik.cidgik.instance import Instance
from workcell.ik.cidgik.reduction import Reduction, Vectors, stack
from workcell.ik.cidgik.skeleton import Skeleton
from workcell.ik.cidgik.structure import Structure
from workcell.ik.cidgik.workspace.keeper import Keeper
from workcell.ik.cidgik.workspace.rules import Rules
from workcell.ik.shared.conic import Cones, ConicSolution, ConicSolver, svec
from workcell.ik.trees.query import Goal
from workcell.pose import Array, Pose

_RANK = 1e-6
_STORED = 1e-14


class ChordalStructure:
    """The blocks of a tree and where they overlap.

    Attributes:
        skeleton: of the whole.
        blocks: structures of pairs of links.
        overlaps: `(one block, another, link)` that both hold.
        home: by link, a block that holds it.
        agreed: (k,) rows of the overlaps that are independent, of all that `ChordalInstance` makes.
    """

    def __init__(self, skeleton: Skeleton) -> None:
        self.skeleton = skeleton
        parents = skeleton.robot.parents
        pairs = [
            (int(parents[k]), k + 1)
            for k in range(skeleton.robot.dof)
            if k + 1 not in skeleton.known and int(parents[k]) not in skeleton.known
        ]
        lone = set(range(1, skeleton.robot.dof + 1)) - skeleton.known - {k for pair in pairs for k in pair}
        cliques = [*pairs, *((k,) for k in sorted(lone))]
        self.cliques = [self._with_known(clique) for clique in cliques]
        self.blocks = [Structure(skeleton, links) for links in self.cliques]
        self.home: dict[int, int] = {}
        self.overlaps: list[tuple[int, int, int]] = []
        for index, clique in enumerate(cliques):
            for link in clique:
                if link in self.home:
                    self.overlaps.append((self.home[link], index, link))
                self.home[link] = index
        for index, links in enumerate(self.cliques):
            for link in links:
                self.home.setdefault(link, index)
        self.agreed: NDArray[np.int64] | None = None

    def _with_known(self, clique: tuple[int, ...]) -> tuple[int, ...]:
        """A clique with the known links that its links are joined to: joints between them belong to the block."""
        skeleton = self.skeleton
        parents = skeleton.robot.parents
        joined = {int(parents[k - 1]) for k in clique} & skeleton.known
        joined |= {k for k in skeleton.known - {0} if int(parents[k - 1]) in clique}
        return tuple(sorted({*clique, *joined}))


class ChordalInstance:
    """The relaxation of a query in blocks; Z and C are lists of matrices. As `Instance` otherwise.

    Attributes:
        structure: shared by queries.
        parts: the blocks.
        solves: cone programs so far.
    """

    def __init__(
        self, structure: ChordalStructure, goals: tuple[Goal, ...], middle: Array, half: Array
    ) -> None:
        self.structure = structure
        self.parts = [Instance(block, goals, middle, half) for block in structure.blocks]
        self.contradiction = self.determined = False
        self.solves = 0
        self._sizes = [part.D.shape[1] for part in self.parts]
        self._starts = np.concatenate([[0], np.cumsum(self._sizes)])
        self._agreement = self._independent(self._overlap_rows())
        self._solver: ConicSolver | None = None
        self._loaded: list[Array] = []

    def _overlap_rows(self) -> Array:
        """(m, total + 1) rows over (y, 1) that are zero where the blocks agree on the links they share."""
        rows = []
        d = self.structure.skeleton.dimension
        for one, other, link in self.structure.overlaps:
            both = []
            for index in (one, other):
                part = self.parts[index]
                vectors = part.vector(_of_link(part.structure.reduction, link))
                constants = np.zeros((d, vectors.shape[1]))
                constants[:, -d:] = np.eye(d)
                a, b = np.triu_indices(len(vectors))
                left = np.vstack([vectors[a], np.repeat(vectors, d, axis=0)])
                right = np.vstack([vectors[b], np.tile(constants, (len(vectors), 1))])
                both.append((index, part.rows_of(left, right)))
            block = np.zeros((len(both[0][1]), int(self._starts[-1]) + 1))
            for sign, (index, found) in zip((1.0, -1.0), both, strict=True):
                block[:, self._starts[index] : self._starts[index + 1]] = sign * found[:, :-1]
                block[:, -1] += sign * found[:, -1]
            rows.append(block)
        return np.vstack(rows) if rows else np.zeros((0, int(self._starts[-1]) + 1))

    def _independent(self, rows: Array) -> Array:
        """As many rows as are independent; which ones is found once for all queries."""
        if self.structure.agreed is None:
            from scipy.linalg import qr

            if not len(rows):
                return rows
            _, R, order = qr(rows[:, :-1].T, mode="economic", pivoting=True)
            scale = np.abs(np.diag(R))
            rank = int(np.count_nonzero(scale > _RANK * scale[0]))
            self.structure.agreed = np.sort(order[:rank])
        kept: Array = rows[self.structure.agreed]
        return kept

    def solve(self, C: list[Array]) -> ConicSolution:
        """Minimise the sum of <C_b, Z_b>; x are the blocks' coordinates one after another."""
        q = np.concatenate([part.D.T @ svec(c) for part, c in zip(self.parts, C, strict=True)])
        self.solves += 1
        slots = [part.slots for part in self.parts]
        if self._solver is None or any(a is not b for a, b in zip(slots, self._loaded, strict=True)):
            self._solver, self._loaded = self._assemble(), slots
        return self._solver.solve(q)

    def _assemble(self) -> ConicSolver:
        from scipy.sparse import block_diag, csc_matrix, vstack

        inequality = [np.vstack([part.limit_rows, part.standing, part.slots]) for part in self.parts]
        matrices = [np.column_stack([part.D, part.Z0]) for part in self.parts]
        frames = [part.frame_rows for part in self.parts]
        groups = (inequality, matrices, frames)
        agreement = self._agreement.copy()
        agreement[np.abs(agreement) < _STORED] = 0.0
        A: Any = [csc_matrix(agreement[:, :-1])] + [
            block_diag([r[:, :-1] for r in group]) for group in groups
        ]
        b = [agreement[:, -1]] + [np.concatenate([r[:, -1] for r in group]) for group in groups]
        counts = sum(len(rows) for rows in inequality)
        orders = tuple(part.structure.order for part in self.parts)
        quaternions = (4,) * sum(len(rows) // 10 for rows in frames)
        cones = Cones(len(agreement), counts, (), (*orders, *quaternions))
        return ConicSolver(csc_matrix(-vstack(A)), np.concatenate(b), cones)

    def matrix(self, y: Array) -> list[Array]:
        """The blocks' Z."""
        pieces = np.split(y, self._starts[1:-1])
        return [part.matrix(piece) for part, piece in zip(self.parts, pieces, strict=True)]

    def excess(self, Z: list[Array]) -> tuple[float, list[Array]]:
        """Sum of the blocks' excess ranks, and the objective of Problem 5 for each."""
        found = [part.excess(block) for part, block in zip(self.parts, Z, strict=True)]
        return float(sum(gap for gap, _ in found)), [C for _, C in found]

    def nuclear(self) -> list[Array]:
        """C = I over all points."""
        return [part.nuclear() for part in self.parts]

    def random_objective(self, rng: np.random.Generator) -> list[Array]:
        """Random objectives, block by block."""
        return [part.random_objective(rng) for part in self.parts]

    def toward(self, q: Array) -> list[Array]:
        """The objective that is zero at a configuration (n,)."""
        return [part.toward(q) for part in self.parts]

    def directions(self, Z: list[Array]) -> dict[int, Array]:
        """By link, its basis directions (s, d)."""
        found: dict[int, Array] = {}
        for part, block in zip(self.parts, Z, strict=True):
            found |= part.directions(block)
        return found

    def release(self) -> None:
        """Nothing is shared between queries but the structure."""


def _of_link(reduction: Reduction, link: int) -> Vectors:
    """A link's origin and directions."""
    directions = reduction.directions[link]
    every = [reduction.origins[link], *(directions.one(k) for k in range(len(directions.alpha)))]
    return stack(every, reduction.like)


class ChordalKeeper:
    """The workspace over blocks: each point belongs to one of them. Distances between points are not kept here."""

    def __init__(
        self, instance: ChordalInstance, links: NDArray[np.int64], local: Array, rules: Rules, base: Pose
    ) -> None:
        structure = instance.structure
        # points of a link in no block can't move
        home = np.array([structure.home.get(int(link), -1) for link in links], dtype=np.int64)
        self._keepers: list[tuple[int, Keeper]] = []
        for index, part in enumerate(instance.parts):
            mine = np.flatnonzero(home == index)
            if len(mine):
                points = part.structure.reduction.points(links[mine], local[mine])
                own = rules.of_points(mine)
                self._keepers.append((index, Keeper(part, points, own, base)))

    @property
    def passing(self) -> bool:
        """Whether rows are loaded that not every solution keeps."""
        return any(keeper.passing for _, keeper in self._keepers)

    @property
    def conservative(self) -> bool:
        """Whether rows are loaded for spheres that cover solids."""
        return any(keeper.conservative for _, keeper in self._keepers)

    @property
    def left_out(self) -> int:
        """How many pairs of point and solid are not kept apart."""
        return sum(keeper.left_out for _, keeper in self._keepers)

    def give_way(self) -> int:
        """Drop rows of spheres that may stick out of the robot by as much as they overlap solids; how many."""
        return sum(keeper.give_way() for _, keeper in self._keepers)

    def forget_passing(self) -> None:
        """At a restart: planes chosen before are forgotten."""
        for _, keeper in self._keepers:
            keeper.forget_passing()

    def add_broken(self, Z: list[Array]) -> int:
        """Rows for the rules that points break; how many are broken."""
        return sum(keeper.add_broken(Z[index]) for index, keeper in self._keepers)

    def add_cut_off(self, Z: list[Array]) -> int:
        """Rows for the rules on spheres that Z breaks; how many are new."""
        return sum(keeper.add_cut_off(Z[index]) for index, keeper in self._keepers)
