"""`Truth`: what spheres can't tell: pairs of geoms whose spheres overlap though the geoms may be apart.

Spheres are larger than what they cover. Where some of two geoms' spheres overlap as the robot begins, or always, these
pairs of spheres say nothing, and the compiled model's own distances are asked instead, in every frame.
"""

from __future__ import annotations

import importlib
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from workcell.model.collision_model import CollisionModel
from workcell.model.scene_parts import data_at
from workcell.motion.live.packing import between, reach
from workcell.motion.live.surroundings import Arms, Obstacles
from workcell.pose import Array

if TYPE_CHECKING:
    from workcell.motion.live.kernels.limbs import Limbs
    from workcell.motion.live.kernels.motion import Motion

Index = NDArray[np.int64]
_PARTS = (1, 4, 16)
"""Into how many parts a stop is cut, one try after the other."""


@dataclass(frozen=True, slots=True)
class _Asked:
    """The pairs of one robot that the model is asked about, and (p, m) how far joints move the geoms of each."""

    model: CollisionModel
    levers: Array


class Truth:
    """The compiled model's word on the pairs of geoms that the guard's spheres leave open.

    Args:
        arms: the robots.
        obstacles: what they may hit.
        pairs: (p, 2) spheres that the guard keeps apart.
        covered: (s, k) spheres and standing obstacles that it keeps apart.
        never: links, the lower first, that can't touch.
    """

    def __init__(
        self,
        arms: Arms,
        obstacles: Obstacles,
        pairs: Index,
        covered: NDArray[np.bool_],
        never: set[tuple[int, int]],
    ) -> None:
        self._arms, self._never = arms, never
        kept = np.zeros((len(arms.cover), len(arms.cover)), dtype=np.bool_)
        kept[pairs[:, 0], pairs[:, 1]] = kept[pairs[:, 1], pairs[:, 0]] = True
        self._asked = [
            asked
            for k in range(len(arms.worlds))
            if (asked := self._left_open(k, obstacles, kept, covered)) is not None
        ]

    @property
    def count(self) -> int:
        """How many pairs of geoms are asked about in every frame."""
        return sum(len(asked.levers) for asked in self._asked)

    def _left_open(
        self, arm: int, obstacles: Obstacles, kept: NDArray[np.bool_], covered: NDArray[np.bool_]
    ) -> _Asked | None:
        world = self._arms.worlds[arm]
        parts, of_sphere = self._parts()
        members = {part: np.flatnonzero(of_sphere == part) for part in range(int(parts.max(initial=0)) + 1)}
        nothing = np.zeros(0, dtype=np.int64)
        geoms = np.array([piece.geom for piece in obstacles.standing], dtype=np.int64)
        bases = {piece.geom: k for piece, k in zip(obstacles.standing, obstacles.bases, strict=True)}
        moving = {piece.geom for part in obstacles.moving.values() for piece in part}
        shown: dict[tuple[int, int], bool] = {}
        left = []
        for row, (a, b) in enumerate(world.collision.pair_geoms.tolist()):
            other, one = sorted((int(parts[a]), int(parts[b])))
            if other >= 0:
                if (other, one) in self._never:
                    continue
                if (one, other) not in shown:
                    spheres = np.ix_(members[one], members[other])
                    shown[one, other] = bool(kept[spheres].size > 0 and kept[spheres].all())
                if not shown[one, other]:
                    left.append(row)
                continue
            still = a if parts[b] == one else b
            if still in moving or (bases.get(still) == arm and (0, one) in self._never):
                continue
            spheres = np.ix_(members.get(one, nothing), np.flatnonzero(geoms == still))
            if not (covered[spheres].size > 0 and covered[spheres].all()):
                left.append(row)
        if not left:
            return None
        smaller = world.collision.only(left)
        return _Asked(smaller, self._levers(smaller.pair_geoms))

    def _parts(self) -> tuple[Index, Index]:
        """(g,) the part of the robots that each geom belongs to, and (s,) the same for each sphere.

        A part is a link, or what a hand holds; -1 for all other geoms.
        """
        model, links = self._arms.worlds[0].scene.model, self._arms.robot.joint_count + 1
        of_body = np.full(model.nbody, -1, dtype=np.int64)
        of_sphere = np.array(self._arms.cover.link)
        # bases are none: they are pieces that stand
        of_sphere[arms_base := self._arms.cover.link == 0] = -1
        for arm, (world, first) in enumerate(zip(self._arms.worlds, self._arms.first_link, strict=True)):
            mine = (self._arms.owner == arm) & ~arms_base
            for link, bodies in enumerate(world.robot.link_body_ids):
                if link:
                    of_body[list(bodies)] = link + first
            if world.attached is not None:
                of_body[list(world.scene.object(world.attached[0]).body_ids)] = links + arm
                names = world.collision.carried_geoms
                source = self._arms.cover.source
                held = [k for k in np.flatnonzero(mine) if source and source[k] in names]
                of_sphere[held] = links + arm
        return of_body[model.geom_bodyid], of_sphere

    def _levers(self, geoms: Index) -> Array:
        """(p, m) bounds on how far a radian (or metre) of each joint moves the geoms of pairs (p, 2) to each other."""
        world, robot = self._arms.worlds[0], self._arms.robot
        model = world.scene.model
        start = np.concatenate([one.robot.start for one in self._arms.worlds])
        data = data_at(model, self._qpos(start))
        owner, frames = self._owners(), robot.link_transforms(start)
        links = owner[model.geom_bodyid[geoms]]
        made = np.zeros((len(geoms), robot.joint_count))
        for row, (pair, of) in enumerate(zip(geoms, links, strict=True)):
            # a ball around the geom, about the frame of its link
            away = np.linalg.norm(data.geom_xpos[pair] - frames[of, :3, 3], axis=1) + model.geom_rbound[pair]
            reaches = [reach(robot, int(of[k]), float(away[k])) if of[k] else made[0] * 0.0 for k in range(2)]
            made[row] = between(robot, int(of[0]), int(of[1]), reaches[0], reaches[1])
        return made

    def _owners(self) -> Index:
        """(b,) links of all robots' tree that carry each body; 0 for what stands."""
        owner = np.zeros(self._arms.worlds[0].scene.model.nbody, dtype=np.int64)
        for world, first in zip(self._arms.worlds, self._arms.first_link, strict=True):
            for link, bodies in enumerate(world.robot.link_body_ids):
                owner[list(bodies)] = link + first if link else 0
            if world.attached is not None:
                held = world.scene.object(world.attached[0]).body_ids
                owner[list(held)] = world.robot.robot.tool().link + first
        return owner

    def distance(self, q: Array) -> tuple[float, str]:
        """The smallest distance of what is asked about at q (n,), and whose; inf where nothing is."""
        found = [asked.model.distance_at(self._qpos(q)) for asked in self._asked]
        if not found:
            return np.inf, ""
        nearest = min(found, key=lambda one: one.distance)
        return nearest.distance, " and ".join(nearest.pair)

    def refuses(self, frame: Any, limbs: Limbs, motion: Motion, period: float) -> str:
        """Whose distances don't show the next step, and the stop after it, to be clear; empty where they do.

        Args:
            frame: for the kernels; limbs, motion: of it.
            period: seconds of the step.
        """
        if not self._asked:
            return ""
        kernels = importlib.import_module("workcell.motion.live.kernels.commit")
        refused = ""
        for parts in _PARTS:
            q, drifts = np.empty((parts, motion.end.size)), np.empty((parts, limbs.levers.shape[2]))
            kernels.along_stop(frame, period, q, drifts)
            refused = self._not_shown(q, drifts)
            if not refused:
                return ""
        here = self.distance(motion.now[0])[0]
        if here <= 0.0 and self.distance(motion.next[0])[0] > here:
            return ""  # on its way out of a contact
        return refused

    def _not_shown(self, q: Array, drifts: Array) -> str:
        for here, drift in zip(q, drifts, strict=True):
            qpos = self._qpos(here)
            for asked in self._asked:
                moved = asked.levers @ drift
                excess, nearest = asked.model.excess_at(qpos, moved)
                if not excess > 0.0:
                    return " and ".join(nearest.pair)
        return ""

    def _qpos(self, q: Array) -> Array:
        first, *others = self._arms.worlds
        slices = self._arms.slices
        qpos = first.collision.full_qpos(q[slices[0]])
        for world, part in zip(others, slices[1:], strict=True):
            placed = world.collision.full_qpos(q[part])
            addresses = world.robot.joint_qpos_addresses
            qpos[addresses] = placed[addresses]
            for address, _ in (*world.robot.fingers, *world.robot.riders):
                qpos[address] = placed[address]
            if world.attached is not None:
                at = world.scene.object(world.attached[0]).qpos_address
                if at is not None:
                    qpos[at : at + 7] = placed[at : at + 7]
        return qpos
