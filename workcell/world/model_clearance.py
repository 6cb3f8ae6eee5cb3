"""`ModelClearance`: a robot's clearance on the compiled model, and which of its spheres may hit each other."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike, NDArray

from workcell.geometry.self_collision import SelfCollisionPairs, self_collision_pairs
from workcell.geometry.types import SphereCover
from workcell.identity_cache import ByIdentity
from workcell.ik.problem import Checks, Clearance
from workcell.model.collision_model import CollisionModel
from workcell.model.robot import Robot
from workcell.pose import Array

_SAMPLES = 200
"""Configurations that tell which pairs of a cover's spheres always touch."""
_known = ByIdentity()


@dataclass(frozen=True, slots=True)
class ModelClearance:
    """The truth about collisions in a world: the `checker` of its problems, and of what is planned and proved there.

    Whoever needs no more calls it. Proofs that can ask pair by pair find the model in `collision`.

    Attributes:
        collision: the compiled model's distances for the world's robot and what it holds.
    """

    collision: CollisionModel

    def __call__(self, q: Array) -> Clearance:
        """Smallest signed distance at a configuration (n,)."""
        found = self.collision.distance(q)
        return Clearance(found.distance, found.pair, found.reason)

    def second_opinion(self, q: Array) -> Clearance | None:
        """What MuJoCo's own collision pipeline has in contact at a configuration (n,); None: nothing."""
        found = self.collision.contact(q)
        return None if found is None else Clearance(found.distance, found.pair)

    @property
    def checks(self) -> Checks:
        """What it looks at: pairs of geoms that MuJoCo may bring into contact."""
        own = self.collision.own_pairs
        return Checks(int(np.count_nonzero(~own)), int(np.count_nonzero(own)))

    def self_pairs(
        self, robot: Robot, cover: SphereCover, known_free: ArrayLike | None = None
    ) -> NDArray[np.int64]:
        """(p, 2) spheres of a cover that must keep clear of each other: those of links that the model collides.

        What the hand carries must keep clear of all links but the one that carries it. Pairs that always touch are the
        cover's overshoot, and so are those that touch where the robot is known to be free.

        Args:
            robot: the world's, serial.
            cover: its spheres, with or without their overshoot.
            known_free: configurations (n,) or (c, n); None: `home`, where the model has nothing against it.

        Raises:
            InputError: configurations of the wrong shape, or not finite.
        """
        names = self.collision.carried_geoms
        carried = tuple(k for k, name in enumerate(cover.source) if name in names)
        pairs = _collidable(robot, cover, self.collision.self_links, carried)
        if known_free is None:
            if not self.collision.distance(robot.home).distance > 0:
                return pairs.pairs
            known_free = robot.home
        return pairs.tolerating(robot, cover, known_free).pairs


def _collidable(
    robot: Robot, cover: SphereCover, links: frozenset[tuple[int, int]], carried: tuple[int, ...]
) -> SelfCollisionPairs:
    """The pairs of a cover by the links that can collide, made once: they depend on nothing else."""
    made: dict[object, SelfCollisionPairs] = _known.get((robot, cover), dict)
    key = links, carried
    if key not in made:
        made[key] = self_collision_pairs(
            robot, cover, links=links, carried=carried, samples=_SAMPLES, prove=False
        )
    return made[key]
