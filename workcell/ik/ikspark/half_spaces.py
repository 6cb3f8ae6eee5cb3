"""Obstacles in IKSPARK's convex set: half-spaces that spheres must stay in, added where they collide.

Two convex bodies are apart exactly when a plane parts them. Where a sphere collides at a point of the set, the plane
that touches the obstacle nearest to the sphere's centre is demanded as a half-space, and the ascent goes on.
"""

from __future__ import annotations

from contextlib import ExitStack

import numpy as np

from workcell.geometry.obstacle_arrays import ObstacleArrays
from workcell.ik.ikspark.instance import Instance, instance_of
from workcell.ik.problem import IKProblem
from workcell.ik.shared.convex import KEEP_OFF
from workcell.pose import Array


class Avoidance:
    """Spheres and obstacles of one problem, in the relaxation's variables.

    Attributes:
        centres: (m, 3, N + 1) sphere centres in the world over (x, 1).
        needed: (m,) distance of each centre from an obstacle that counts as clear.
    """

    def __init__(self, problem: IKProblem, instance: Instance, stack: ExitStack) -> None:
        assert problem.cover is not None
        self.problem = problem
        cover, lift = problem.cover, instance.lift
        base = problem.robot.T_world_base
        points = np.stack([lift.point(int(k), c) for k, c in zip(cover.link, cover.centre, strict=True)])
        self.centres = np.einsum("ab,mbx->max", base.rotation, points @ instance.goal)
        self.centres[:, :, -1] += base.position
        self.needed = cover.radius + problem.tolerances.safety_margin
        self.movable = np.any(np.abs(self.centres[:, :, :-1]) > 1e-9, axis=(1, 2))
        self.obstacles = ObstacleArrays(problem.obstacles)
        self._stack = stack
        self._instances: dict[int, Instance] = {}

    @staticmethod
    def of(problem: IKProblem, instance: Instance, stack: ExitStack) -> Avoidance | None:
        """None where the problem has no spheres or no obstacles."""
        if problem.cover is None or len(problem.cover) == 0 or not problem.obstacles:
            return None
        return Avoidance(problem, instance, stack)

    def instance_for(self, planes: int) -> Instance:
        """The relaxation with room for that many half-spaces, in steps of four: empty slots cost time."""
        slots = 4 * -(-planes // 4)
        if slots not in self._instances:
            self._instances[slots] = self._stack.enter_context(instance_of(self.problem, halfspaces=slots))
        return self._instances[slots]

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
