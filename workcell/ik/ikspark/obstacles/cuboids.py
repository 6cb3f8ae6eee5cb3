"""IKSPARK's obstacle model (section VII): every sphere inside one of several regions, relaxed by perspectives.

The relaxation (69), (71) holds, for one sphere, exactly the convex hull of its regions. A sphere with one region alone
has that region's rows, without any relaxation.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from workcell.geometry.types import FreeSpace
from workcell.ik.ikspark.instance import Instance
from workcell.ik.ikspark.lift import Lift
from workcell.ik.ikspark.obstacles.centres import moving_maps
from workcell.ik.ikspark.obstacles.pairs import region_pairs
from workcell.ik.ikspark.obstacles.regions import Regions
from workcell.ik.ikspark.obstacles.sparse_rows import SparseRows, stacked
from workcell.ik.problem import IKProblem
from workcell.ik.shared.conic import Cones, ConicSolution, ConicSolver
from workcell.pose import Array


@dataclass(frozen=True, slots=True, eq=False)
class Home:
    """A sphere, and the regions that it may be in.

    Attributes:
        sphere: its index among the moving spheres.
        centre: (3, N + 1) its centre in the world over (x, 1).
        needed: metres that its centre keeps from a region's faces.
        regions: indices of regions, one or more.
    """

    sphere: int
    centre: Array
    needed: float
    regions: tuple[int, ...]


class CuboidSet:
    """The relaxation with some spheres in their regions; a convex set as `rank.ascend` takes it.

    Variables are x and, for every region of a sphere that has several, z (3) and delta. The copies p of the paper are
    redundant.

    Attributes:
        homes: the spheres and their regions.
        shares: for each sphere, delta of its regions at the last solve.
    """

    def __init__(
        self,
        instance: Instance,
        regions: Regions,
        homes: Sequence[Home],
        *,
        relax_all: bool = False,
        tolerance: float = 1e-6,
    ) -> None:
        """Build the set.

        Args:
            instance: the relaxation of the problem.
            regions: what `homes` count.
            homes: spheres that must be in a region.
            relax_all: z and delta for spheres with one region too, so that a ray has multipliers of their places.
            tolerance: of the cone programs.
        """
        self._instance, self._regions = instance, regions
        self.homes = tuple(homes)
        self.shares = [np.ones(len(home.regions)) for home in homes]
        self._relaxed = [k for k, home in enumerate(homes) if relax_all or len(home.regions) > 1]
        sizes = [4 * len(homes[k].regions) for k in self._relaxed]
        self._first = self.lift.size + np.cumsum([0, *sizes])
        self._solver = self._build(tolerance)

    @property
    def lift(self) -> Lift:
        """The meaning of x."""
        return self._instance.lift

    def best(self) -> dict[int, int]:
        """For each sphere, the region that had the largest share of it at the last solve."""
        return {
            home.sphere: home.regions[int(share.argmax())]
            for home, share in zip(self.homes, self.shares, strict=True)
        }

    def _build(self, tolerance: float) -> ConicSolver:
        ties, inside = SparseRows(), SparseRows()
        relaxed = set(self._relaxed)
        for k, first in zip(self._relaxed, self._first[:-1].tolist(), strict=True):
            self._add_relaxed(self.homes[k], first, ties, inside)
        for k, home in enumerate(self.homes):
            if k not in relaxed:
                rows, offsets, _ = self._faces(home)
                inside.add_dense(rows @ home.centre[:, :-1], offsets - rows @ home.centre[:, -1])
        A, b = self._instance.independent(*self._instance.relaxation.dense(self._instance.head))
        cones = self._instance.solved_cones
        zero, nonneg = cones.zero, cones.zero + cones.nonneg
        parts = (
            *(SparseRows.of(A[:zero], b[:zero]), ties),
            *(SparseRows.of(A[zero:nonneg], b[zero:nonneg]), inside),
            SparseRows.of(A[nonneg:], b[nonneg:]),
        )
        self._spans = (zero, ties.count, cones.nonneg, inside.count)
        grown = Cones(zero + ties.count, cones.nonneg + inside.count, cones.soc, cones.psd)
        return ConicSolver(*stacked(parts, int(self._first[-1])), grown, tolerance=tolerance)

    def _faces(self, home: Home) -> tuple[Array, Array, NDArray[np.int64]]:
        """Normals (f, 3) and offsets (f,) of all faces of a sphere's regions, and which region each belongs to."""
        spans = [self._regions.rows(region) for region in home.regions]
        rows = np.concatenate([np.arange(span.start, span.stop) for span in spans])
        owner = np.repeat(np.arange(len(spans)), [span.stop - span.start for span in spans])
        return self._regions.normals[rows], self._regions.offsets[rows] - home.needed, owner

    def _add_relaxed(self, home: Home, first: int, ties: SparseRows, inside: SparseRows) -> None:
        """Eq. 69 and 71d-e: the regions' shares of the centre sum up to it, each inside its scaled region."""
        z = first + 4 * np.arange(len(home.regions))
        place = ties.add(-home.centre[:, -1])
        axis, column = np.nonzero(home.centre[:, :-1])
        ties.put(place + axis, column, home.centre[axis, column])
        for axis_of_z in range(3):
            ties.put(np.full(len(z), place + axis_of_z), z + axis_of_z, -1.0)
        whole = ties.add(np.ones(1))
        ties.put(np.full(len(z), whole), z + 3, 1.0)
        normals, offsets, owner = self._faces(home)
        row = inside.add(np.zeros(len(offsets)))
        face, axis = np.nonzero(normals)
        inside.put(row + face, z[owner[face]] + axis, normals[face, axis])
        inside.put(row + np.arange(len(offsets)), z[owner] + 3, -offsets)

    def solve(self, q: Array) -> ConicSolution:
        """Minimise q.x (N,); `z` is over the relaxation's rows, then (3 m,) of the relaxed spheres.

        Those are the multipliers of the ties between a sphere's place and its regions' shares.
        """
        N = self.lift.size
        objective = np.zeros(int(self._first[-1]))
        objective[:N] = q
        solution = self._solver.solve(objective)
        for k, first in zip(self._relaxed, self._first[:-1].tolist(), strict=True):
            self.shares[k] = solution.x[first + 3 : first + 4 * len(self.homes[k].regions) : 4]
        zero, tied, nonneg, inside = self._spans
        z = solution.z
        own = np.concatenate([z[:zero], z[zero + tied :][:nonneg], z[zero + tied + nonneg + inside :]])
        places = z[zero : zero + tied].reshape(-1, 4)[:, :3].ravel()
        return replace(solution, x=solution.x[:N], z=np.concatenate([self._instance.original(own), places]))


def whole_set(
    instance: Instance, problem: IKProblem, free_space: FreeSpace, *, tolerance: float = 1e-6
) -> CuboidSet | None:
    """The set with every moving sphere in a region that distances along the chain allow, all of them relaxed.

    None where there is a sphere that no region allows.
    """
    assert problem.cover is not None
    regions = Regions.of(free_space)
    allowed = region_pairs(problem, regions, steps=False)
    if not allowed.any(axis=1).all():
        return None
    needed = problem.cover.radius[problem.cover.link > 0] + problem.tolerances.safety_margin
    maps = moving_maps(instance.lift, problem) @ instance.goal
    homes = [
        Home(j, maps[j], float(needed[j]), tuple(np.flatnonzero(allowed[j]).tolist()))
        for j in range(len(maps))
    ]
    return CuboidSet(instance, regions, homes, relax_all=True, tolerance=tolerance)
