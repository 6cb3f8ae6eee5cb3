"""CIDGIK's Algorithm 1 as the paper runs it: once, from C = I, at most ten iterations, no polish.

The relaxation, Problem 5 and the angles are those of `workcell.ik.cidgik`; what is not the paper's in its solver is
left out: no restart from another objective, no rows added later (every joint point keeps out of every sphere from the
first cone program on), no polish. Ranks are weighed over the points that the paper has as variables, also those that
the goal fixes, which the solver leaves out; only axes that are normal to both their neighbours are no variables here
(of the UR10 there are none).
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from workcell.ik.cidgik.instance import Instance
from workcell.ik.cidgik.model import relaxation_at
from workcell.ik.cidgik.recover import joint_angles
from workcell.ik.cidgik.reduction import stack
from workcell.ik.cidgik.workspace.keeper import Keeper
from workcell.ik.problem import IKProblem
from workcell.pose import Array, read_only

ITERATIONS = 10
"""Cone programs (Problem 4) at most: the paper, section V."""
LOW_RANK = 1e-6
"""Excess rank h(Z) at which it stops: the supplement."""
STANDSTILL, SLOWEST = 1e-6, 1e-3
"""It also stops where h changes by less than the first, or by less than the second times h: the authors' code."""
_FIXED = 1e-9


@dataclass(frozen=True, slots=True)
class OneStart:
    """What one run of Algorithm 1 came to.

    Attributes:
        q: (n,) angles read from the last point, as they are; None where there was no point.
        gaps: excess rank after each cone program.
    """

    q: Array | None
    gaps: tuple[float, ...]

    def __post_init__(self) -> None:
        if self.q is not None:
            object.__setattr__(self, "q", read_only(self.q))


def run_one_start(problem: IKProblem, iterations: int = ITERATIONS) -> OneStart:
    """Algorithm 1 on a problem whose obstacles are spheres.

    Raises:
        InputError: a robot that points and distances can't describe.
    """
    instance, keeper = relaxation_at(problem)
    _weigh_known_points(instance)
    if keeper is not None:
        instance.set_slots(_sphere_rows(instance, keeper, len(problem.obstacles)))
    gaps: list[float] = []
    q: Array | None = None
    C = instance.nuclear()
    for _ in range(iterations):
        solution = instance.solve(C)
        if not solution.usable:
            break
        Z = instance.matrix(solution.x)
        gap, C = instance.excess(Z)
        q = joint_angles(instance.structure.skeleton, instance.directions(Z))
        gaps.append(gap)
        if gap < LOW_RANK or (len(gaps) > 1 and abs(gap - gaps[-2]) < max(STANDSTILL, SLOWEST * gaps[-2])):
            break
    instance.release()
    return OneStart(q, tuple(gaps))


def _sphere_rows(instance: Instance, keeper: Keeper, spheres: int) -> Array:
    """(m, f + 1) Eq. 6 for every point that moves and every sphere."""
    moving = np.flatnonzero(np.any(np.abs(keeper.points[:, :-3]) > _FIXED, axis=1))
    pairs = [keeper.inequality(("ball", int(i), j), 0.0) for i in moving for j in range(spheres)]
    return instance.reduced(
        np.array([packed for packed, _, _ in pairs]), np.array([least for _, least, _ in pairs])
    )


def _weigh_known_points(instance: Instance) -> None:
    """Count the points p_i, q_i of joints 2 to n that base and goal fix in h(Z): variables in the paper too."""
    structure, reduction = instance.structure, instance.structure.reduction
    points = []
    for link in range(2, structure.skeleton.robot.dof + 1):
        origin = reduction.point(link, np.zeros(3))
        points += [origin, origin.plus(reduction.directions[link].one(0))]
    known = [point for point in points if not np.any(point.alpha)]
    W = stack(known, reduction.like).at(instance.G)[:, structure.keep]
    gram = instance.metric @ instance.metric.T + W.T @ W
    instance.metric = np.linalg.cholesky(gram)
