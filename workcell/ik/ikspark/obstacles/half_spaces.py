"""Obstacles as half-spaces that spheres must stay in, added where they collide: what `ikspark` falls back to.

Two convex bodies are apart exactly when a plane parts them. Where a sphere collides at a point of the set, the plane
that touches the obstacle nearest to the sphere's centre is demanded as a half-space, and the ascent goes on. This is
not the paper's obstacle model: its answers have a name of their own, `ikspark+cuts`.
"""

from __future__ import annotations

from contextlib import ExitStack

import numpy as np

from workcell.geometry.obstacle_arrays import ObstacleArrays
from workcell.ik.ikspark.instance import Instance
from workcell.ik.ikspark.obstacles.branching import Instances
from workcell.ik.ikspark.obstacles.centres import sphere_maps
from workcell.ik.ikspark.obstacles.own import OwnSpheres
from workcell.ik.ikspark.rank import linearise
from workcell.ik.ikspark.search import Reached, Search
from workcell.ik.problem import IKProblem
from workcell.ik.result import Candidate
from workcell.ik.shared.convex import KEEP_OFF
from workcell.pose import Array

SLOTS = 12
"""Half-spaces that one ascent may carry."""
ROUNDS = 4
"""Ascents with ever more half-spaces, after one whose point collides."""


class Avoidance:
    """Spheres and obstacles of one problem, in the relaxation's variables.

    Attributes:
        centres: (m, 3, N + 1) sphere centres in the world over (x, 1).
        needed: (m,) distance of each centre from an obstacle that counts as clear.
    """

    exhausted = False

    def __init__(
        self, search: Search, instance: Instance, own: OwnSpheres, stack: ExitStack, by: str = ""
    ) -> None:
        """Prepare; `by` is the name that answers get."""
        problem = search.problem
        assert problem.cover is not None
        self._search, self._plain, self._own = search, instance, own
        self.centres = sphere_maps(instance.lift, problem, np.arange(len(problem.cover))) @ instance.goal
        self.needed = problem.cover.radius + problem.tolerances.safety_margin
        self.movable = np.any(np.abs(self.centres[:, :, :-1]) > 1e-9, axis=(1, 2))
        self.obstacles = ObstacleArrays(problem.obstacles)
        self._instances = Instances(problem, stack)
        self._by = by

    def answer(self, q: Array) -> Candidate:
        """The configuration, in the name of this way."""
        return self._search.answer(q, by=self._by)

    def climb(self) -> Reached:
        """One restart: an ascent, then others with half-spaces where spheres collide, up to `ROUNDS`.

        Spheres collide with obstacles, or with each other.

        The first ascent's end is returned where none of them is accepted, for what it may prove.
        """
        search, lift = self._search, self._plain.lift
        first = reached = search.attempt(self._plain, search.direction(lift))
        planes = np.zeros((0, lift.size + 1))
        self._own.restart()
        for _ in range(ROUNDS):
            if reached.accepted or reached.x is None or search.over():
                break
            added = self.planes(reached.x)
            if not self._own.part(reached) and not len(added):
                break
            planes = np.vstack([planes, added])[-SLOTS:]
            search.stages.add("half-spaces", note=f"{len(added)} added, {len(planes)} in all")
            convex = self._instances.with_rows(np.vstack([planes, self._own.rows]))
            direction = self._own.pushed(linearise(lift, reached.x)[1])
            reached = search.attempt(convex, direction, ", with half-spaces")
        return reached if reached.accepted else first

    def planes(self, x: Array) -> Array:
        """(k, N + 1) half-spaces that part the deepest colliding sphere of each obstacle from it, at the point x."""
        at = self.centres[..., :-1] @ x + self.centres[..., -1]
        distance, normal = self.obstacles.distances_and_gradients(at)
        depth = np.where(self.movable[:, None], self.needed[:, None] - distance, -1.0)
        deepest = depth.argmax(axis=0)
        chosen = np.flatnonzero(depth.max(axis=0) > 0)
        if not len(chosen):
            return np.zeros((0, self.centres.shape[-1]))
        spheres = deepest[chosen]
        n = normal[spheres, chosen]
        rows: Array = np.einsum("ka,kax->kx", n, self.centres[spheres])
        level = (
            np.einsum("ka,ka->k", n, at[spheres])
            - distance[spheres, chosen]
            + self.needed[spheres]
            + KEEP_OFF
        )
        rows[:, -1] -= level
        return rows


def has_spheres_and_obstacles(problem: IKProblem) -> bool:
    """Whether anything that joints move has anything to avoid, in the solver's model."""
    return problem.cover is not None and bool(np.any(problem.cover.link > 0)) and bool(problem.obstacles)
