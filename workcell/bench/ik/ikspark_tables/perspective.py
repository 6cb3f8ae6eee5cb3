"""The set of Problem 6 as the paper writes it: spheres in cuboids, all pairs at once (Eqs. 69, 71).

The solver adds a sphere's rows when a point violates them; here all rows are there from the first cone program. The
copies p of the paper are redundant: for every pair there are z (3) and delta, with delta (low + r) <= z <=
delta (up - r), and the z of a sphere sum up to its centre, the deltas to one.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from workcell.geometry.types import FreeSpace
from workcell.ik.ikspark.instance import Instance
from workcell.ik.ikspark.lift import Lift
from workcell.ik.problem import IKProblem
from workcell.ik.shared.conic import Cones, ConicSolution, ConicSolver
from workcell.pose import Array


def sphere_centres(problem: IKProblem, instance: Instance) -> tuple[Array, Array]:
    """World centres (m, 3, N + 1), linear in (x, 1), and radii (m,) of the spheres that joints move."""
    cover, base = problem.cover, problem.robot.T_world_base
    assert cover is not None
    moving = np.flatnonzero(cover.link > 0)
    points = [instance.lift.point(int(cover.link[j]), cover.centre[j]) @ instance.goal for j in moving]
    centres: Array = base.rotation @ np.array(points)
    centres[:, :, -1] += base.position
    return centres, cover.radius[moving]


class PerspectiveSet:
    """The relaxation with m spheres in k cuboids, as `algorithm1` takes a set."""

    def __init__(
        self, problem: IKProblem, instance: Instance, space: FreeSpace, allowed: NDArray[np.bool_]
    ) -> None:
        """Build the cone program; `allowed` (m, k) is which pairs are not ruled out, one of each sphere at least."""
        self._instance = instance
        centres, radii = sphere_centres(problem, instance)
        sphere, cuboid = np.nonzero(allowed)
        lower, upper = space.lower[cuboid] + radii[sphere, None], space.upper[cuboid] - radii[sphere, None]
        fits = np.all(lower <= upper, axis=1)
        self._solver = self._program(centres, sphere[fits], lower[fits], upper[fits])

    @property
    def lift(self) -> Lift:
        """The meaning of x."""
        return self._instance.lift

    def solve(self, q: Array) -> ConicSolution:
        """Minimise q.x over the set, x (N,)."""
        solution = self._solver.solve(np.concatenate([q, np.zeros(self._width - len(q))]))
        return replace(solution, x=solution.x[: len(q)])

    def _program(self, centres: Array, sphere: NDArray[np.int64], lower: Array, upper: Array) -> ConicSolver:
        from scipy.sparse import csc_matrix

        m, pairs, N = len(centres), np.arange(len(sphere)), self.lift.size
        self._width = N + 4 * len(pairs)
        z, delta = N + 4 * pairs, N + 4 * pairs + 3
        ties, inside = np.zeros((4 * m, self._width)), np.zeros((6 * len(pairs), self._width))
        for axis in range(3):
            rows = 4 * np.arange(m) + axis
            ties[rows, :N] = centres[:, axis, :-1]
            ties[4 * sphere + axis, z + axis] = -1.0
            inside[6 * pairs + axis, z + axis], inside[6 * pairs + axis, delta] = -1.0, lower[:, axis]
            inside[6 * pairs + 3 + axis, z + axis], inside[6 * pairs + 3 + axis, delta] = 1.0, -upper[:, axis]
        ties[4 * sphere + 3, delta] = 1.0
        tied = np.column_stack([-centres[:, :, -1], np.ones(m)]).ravel()
        instance, cones = self._instance, self._instance.solved_cones
        A, b = instance.independent(*instance.relaxation.dense(instance.head))
        own = np.hstack([A, np.zeros((len(A), 4 * len(pairs)))])
        zero, nonneg = cones.zero, cones.zero + cones.nonneg
        rows = np.vstack([own[:zero], ties, own[zero:nonneg], inside, own[nonneg:]])
        right = np.concatenate([b[:zero], tied, b[zero:nonneg], np.zeros(len(inside)), b[nonneg:]])
        grown = Cones(zero + 4 * m, cones.nonneg + len(inside), cones.soc, cones.psd)
        return ConicSolver(csc_matrix(rows), right, grown)
