"""IKSPARK's obstacle model (section VII): every sphere inside one of several cuboids, relaxed by perspectives.

The relaxation (69), (71) holds, for one sphere, exactly the convex hull of its cuboids. Pairs of sphere and cuboid
that cannot meet are dropped by distances along the chain.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from workcell.errors import InputError
from workcell.geometry.types import FreeSpace
from workcell.ik.ikspark.instance import Instance
from workcell.ik.ikspark.lift import Lift
from workcell.ik.problem import IKProblem
from workcell.ik.shared.conic import Cones, ConicSolution, ConicSolver
from workcell.pose import Array


@dataclass(frozen=True, slots=True)
class Pairs:
    """Which cuboids each moving sphere may be in.

    Attributes:
        sphere: (m,) indices into the cover of the spheres that joints move.
        lower, upper: (m, k, 3) where the centre of a sphere is when it lies in a cuboid; world frame.
        allowed: (m, k) pairs that are not ruled out.
    """

    sphere: NDArray[np.int64]
    lower: Array
    upper: Array
    allowed: NDArray[np.bool_]


def reachable_pairs(problem: IKProblem, free_space: FreeSpace) -> Pairs:
    """Pairs that the triangle inequality along the chain allows, from the base and from the target.

    The target may move by the problem's tolerances, so that a dropped pair is impossible for all that counts as
    reaching it.
    """
    cover, robot = problem.cover, problem.robot
    assert cover is not None
    sphere = np.flatnonzero(cover.link > 0)
    needed = (cover.radius[sphere] + problem.tolerances.safety_margin)[:, None, None]
    lower, upper = free_space.lower[None] + needed, free_space.upper[None] - needed
    allowed = np.all(lower <= upper, axis=-1)
    link, local = cover.link[sphere], cover.centre[sphere]
    length = np.linalg.norm(robot.joint_xyz, axis=1)
    first = robot.T_world_base.apply(robot.joint_xyz[0])
    along = np.concatenate([[0.0], np.cumsum(length[1:])])
    from_base = along[link - 1] + np.linalg.norm(local, axis=1)
    tool = robot.tool().T_link_tool
    last = (problem.target @ tool.inverse()).position
    next_joint = np.vstack([robot.joint_xyz[1:], np.zeros(3)])[link - 1]
    beyond = np.concatenate([np.cumsum(length[:0:-1])[::-1], [0.0, 0.0]])[link]
    from_goal = np.linalg.norm(next_joint - local, axis=1) + beyond
    from_goal += problem.tolerances.position + problem.tolerances.rotation * float(
        np.linalg.norm(tool.position)
    )
    for anchor, radius in ((first, from_base), (last, from_goal)):
        outside = np.maximum(np.maximum(lower - anchor, anchor - upper), 0.0)
        allowed &= np.linalg.norm(outside, axis=-1) <= radius[:, None] + 1e-9
    if free_space.admissible is not None:
        if len(free_space.admissible) != len(cover):
            raise InputError(
                f"the free space's table is of {len(free_space.admissible)} spheres, the cover has {len(cover)}",
                where="free_space.admissible",
                remedy="make it for this cover (workcell.geometry.free_space.admissible.with_table)",
            )
        allowed &= free_space.admissible[sphere]
    return Pairs(sphere, lower, upper, allowed)


def sphere_maps(lift: Lift, problem: IKProblem, spheres: NDArray[np.int64]) -> Array:
    """(m, 3, N + 1, 13) world centres of spheres."""
    cover, base = problem.cover, problem.robot.T_world_base
    assert cover is not None
    points = np.stack([lift.point(int(cover.link[j]), cover.centre[j]) for j in spheres])
    maps: Array = np.einsum("ab,mbxg->maxg", base.rotation, points)
    maps[:, :, -1, 0] += base.position
    return maps


class CuboidSet:
    """The relaxation with every sphere in its cuboids; a convex set as `rank.ascend` takes it.

    Variables are x and, for every allowed pair, z (3) and delta. The copies p of the paper are redundant.
    """

    def __init__(self, instance: Instance, pairs: Pairs, maps: Array, *, tolerance: float = 1e-6) -> None:
        self._instance, self._pairs = instance, pairs
        self._shares = np.zeros(int(pairs.allowed.sum()))
        self.empty_sphere = (
            int(np.argmin(pairs.allowed.any(axis=1))) if not pairs.allowed.any(axis=1).all() else -1
        )
        if self.empty_sphere < 0:
            self._solver = self._build(maps @ instance.goal, tolerance)

    @property
    def lift(self) -> Lift:
        """The meaning of x."""
        return self._instance.lift

    def _build(self, centres: Array, tolerance: float) -> ConicSolver:
        from scipy.sparse import csc_matrix

        pairs, N = self._pairs, self.lift.size
        m = len(pairs.sphere)
        sphere, cuboid = np.nonzero(pairs.allowed)
        count = len(sphere)
        A0, b0 = self._instance.independent(*self._instance.relaxation.dense(self._instance.head))
        cones = self._instance.solved_cones
        zero, nonneg = cones.zero, cones.nonneg
        width = N + 4 * count
        link, one = np.zeros((3 * m, width)), np.zeros((m, width))
        link[:, :N] = centres[..., :-1].reshape(-1, N)
        z = N + 4 * np.arange(count)
        for axis in range(3):
            link[3 * sphere + axis, z + axis] = -1.0
        one[sphere, z + 3] = 1.0
        inside = np.zeros((6 * count, width))
        for axis in range(3):
            for side, bound, sign in ((0, pairs.lower, -1.0), (1, pairs.upper, 1.0)):
                row = 6 * np.arange(count) + 2 * axis + side
                inside[row, z + axis] = sign
                inside[row, z + 3] = -sign * bound[sphere, cuboid, axis]
        base = np.hstack([A0, np.zeros((len(A0), width - N))])
        A = np.vstack([base[:zero], link, one, base[zero : zero + nonneg], inside, base[zero + nonneg :]])
        b = np.concatenate(
            [
                b0[:zero],
                -centres[..., -1].ravel(),
                np.ones(m),
                b0[zero : zero + nonneg],
                np.zeros(6 * count),
                b0[zero + nonneg :],
            ]
        )
        self._spans = (zero, 4 * m, nonneg, 6 * count)
        grown = Cones(zero + 4 * m, nonneg + 6 * count, cones.soc, cones.psd)
        return ConicSolver(csc_matrix(A), b, grown, tolerance=tolerance)

    def solve(self, q: Array) -> ConicSolution:
        """Minimise q.x; `z` is over the relaxation's rows, then the multipliers (3 m,) of the spheres' places."""
        N = self.lift.size
        padded = np.concatenate([q, np.zeros(4 * int(self._pairs.allowed.sum()))])
        solution = self._solver.solve(padded)
        self._shares = solution.x[N + 3 :: 4]
        zero, tied, nonneg, inside = self._spans
        z, m = solution.z, len(self._pairs.sphere)
        own = np.concatenate(
            [z[:zero], z[zero + tied : zero + tied + nonneg], z[zero + tied + nonneg + inside :]]
        )
        places = z[zero : zero + 3 * m]
        return replace(solution, x=solution.x[:N], z=np.concatenate([self._instance.original(own), places]))

    def assignment(self, spheres: int) -> NDArray[np.int64]:
        """(spheres,) of the cover, the cuboid that holds most of each sphere at the last solve.

        -1 where no joint moves the sphere.
        """
        shares = np.full(self._pairs.allowed.shape, -1.0)
        shares[self._pairs.allowed] = self._shares
        chosen = np.full(spheres, -1, dtype=np.int64)
        chosen[self._pairs.sphere] = shares.argmax(axis=1)
        return chosen
