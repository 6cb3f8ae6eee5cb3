"""Which free-space cuboids the robots' links are inside, followed through a run and written where it changes."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from workcell.geometry.free_space.cuboids import holds_spheres
from workcell.geometry.types import FreeSpace, SphereCover
from workcell.model.scene_parts import SceneRobot
from workcell.pose import Array
from workcell.record.shapes import polytope_shape
from workcell.record.write.rrd import Indexes, RrdWriter, entity

IN_USE, OUTSIDE = "cuboids_in_use", "spheres_in_no_cuboid"
"""Names of the metrics: how many cuboids a robot is in, and how many of its moving spheres are wholly inside none."""

_FREE_RGBA = (0.25, 0.75, 0.35, 0.12)
_LINK_RGB = (
    (0.12, 0.47, 0.71),
    (0.84, 0.15, 0.16),
    (0.58, 0.40, 0.74),
    (1.00, 0.50, 0.05),
    (0.09, 0.75, 0.81),
    (0.89, 0.47, 0.76),
    (0.55, 0.34, 0.29),
    (0.74, 0.74, 0.13),
)
"""Colours of the moving links' cuboids, in the order of the links, over and over."""
_EDGE_M = 0.003
_INSET_M = 0.006
"""Boxes are drawn so much smaller for each further link, so that links in one cuboid are all seen."""


class CuboidUse:
    """The cuboids of a recording, numbered as they come, and who is inside them.

    A sphere counts for one cuboid: it keeps the one it is in until it leaves it, and then goes to the one that holds
    most of its link's spheres. That is geometry alone, whatever the planner was.
    """

    def __init__(self, writer: RrdWriter) -> None:
        self._writer = writer
        self._numbers: dict[bytes, int] = {}
        self._bounds = np.zeros((2, 0, 3))
        self._number = np.zeros(0, dtype=np.int64)
        self._followers: dict[str, _Follower] = {}

    def add_free_space(self, free_space: FreeSpace) -> NDArray[np.int64]:
        """Draws the cuboids and polytopes that are not yet there; returns the numbers of the cuboids."""
        numbers, fresh = [], []
        for lower, upper in zip(free_space.lower, free_space.upper, strict=True):
            number, new = self._number_of(lower.tobytes() + upper.tobytes())
            numbers.append(number)
            if new:
                fresh.append((lower, upper))
                self._number = np.append(self._number, number)
                self._writer.log_box(f"world/free_space/{number}", lower, upper, _FREE_RGBA)
        if fresh:
            self._bounds = np.concatenate([self._bounds, np.array(fresh).swapaxes(0, 1)], axis=1)
        for polytope in free_space.polytopes:
            number, new = self._number_of(polytope.A.tobytes() + polytope.b.tobytes())
            if new:
                shape = polytope_shape(polytope, np.array(_FREE_RGBA))
                self._writer.log_shape(f"world/free_space/{number}", shape)
        return np.array(numbers, dtype=np.int64)

    def _number_of(self, key: bytes) -> tuple[int, bool]:
        """The number of a solid, and whether it is a new one."""
        new = key not in self._numbers
        return self._numbers.setdefault(key, len(self._numbers)), new

    @property
    def count(self) -> int:
        """Cuboids and polytopes so far."""
        return len(self._numbers)

    def add_cover(self, robot: SceneRobot, cover: SphereCover) -> None:
        """Follow the moving spheres of a robot; a second cover takes the place of the first."""
        follower = _Follower(robot, cover)
        self._followers[robot.name] = follower
        for link, name in follower.links.items():
            rgb = _LINK_RGB[(link - 1) % len(_LINK_RGB)]
            path = self._path(robot.name, name)
            self._writer.log_box_style(path, (*rgb, 1.0), _EDGE_M)
            self._writer.log_numbers(path, link=link)

    @property
    def robots(self) -> frozenset[str]:
        """Names of the robots with a cover."""
        return frozenset(self._followers)

    def send(self, indexes: Indexes, qpos: Array) -> None:
        """Where every robot is at some times; qpos (T, nq)."""
        if not self._bounds.size:
            return
        for name, follower in self._followers.items():
            homes = follower.follow(qpos, self._bounds)
            inside = homes >= 0
            used = [len(np.unique(row[row >= 0])) for row in homes]
            self._writer.send_scalars(
                f"metrics/{IN_USE}/{entity(name)}", indexes, np.array(used, dtype=float)
            )
            outside = np.count_nonzero(~inside, axis=1).astype(float)
            self._writer.send_scalars(f"metrics/{OUTSIDE}/{entity(name)}", indexes, outside)
            for link, link_name in follower.links.items():
                self._send_link(indexes, follower, link, self._path(name, link_name), homes)

    def _send_link(
        self, indexes: Indexes, follower: _Follower, link: int, path: str, homes: NDArray[np.int64]
    ) -> None:
        """The rows at which a link's cuboids, or the number of its spheres in none of them, change."""
        mine = homes[:, follower.link == link]
        rows, boxes, outside = [], [], []
        for k, row in enumerate(mine):
            found = np.unique(row)
            state = (*found.tolist(), int(np.count_nonzero(row < 0)))
            if follower.told.get(link) == state:
                continue
            follower.told[link] = state
            used = found[found >= 0]
            labels = [str(self._number[i]) for i in used]
            rows.append(k)
            lower, upper = self._bounds[:, used]
            inset = np.minimum(_INSET_M * (link - 1), 0.25 * (upper - lower))
            boxes.append((lower + inset, upper - inset, labels))
            outside.append(state[-1])
        if rows:
            times, steps = indexes[0][rows], indexes[1][rows]
            self._writer.send_boxes(path, (times, steps), boxes)
            self._writer.send_numbers(path, (times, steps), spheres_outside=outside)

    @staticmethod
    def _path(robot: str, link: str) -> str:
        return f"world/{IN_USE}/{entity(robot, link)}"


class _Follower:
    """The moving spheres of one robot, and the cuboid that each is in."""

    def __init__(self, robot: SceneRobot, cover: SphereCover) -> None:
        moving = cover.link > 0
        self._robot = robot
        self._part = SphereCover(cover.link[moving], cover.centre[moving], cover.radius[moving])
        self.link = self._part.link
        self.links = {int(link): robot.robot.link_names[link] for link in np.unique(self.link)}
        self.told: dict[int, tuple[int, ...]] = {}
        self._home = np.full(len(self.link), -1, dtype=np.int64)
        self._of_link = (self.link[:, None] == np.array(list(self.links))).astype(float)

    def follow(self, qpos: Array, bounds: Array) -> NDArray[np.int64]:
        """(T, m) index of the cuboid of each sphere, -1 in none; bounds (2, k, 3)."""
        q = qpos[:, self._robot.qpos_addresses]
        centres = self._part.centres_world(self._robot.robot.link_transforms(q))
        radius, homes = self._part.radius[:, None], np.empty((len(q), len(self.link)), dtype=np.int64)
        for k, at in enumerate(centres):
            lower, upper = bounds[:, self._home]
            out = (self._home < 0) | np.any((at - radius < lower) | (at + radius > upper), axis=1)
            if out.any():
                self._move(at, out, bounds)
            homes[k] = self._home
        return homes

    def _move(self, centres: Array, out: NDArray[np.bool_], bounds: Array) -> None:
        """New cuboids for the spheres that are out of theirs."""
        held = holds_spheres(FreeSpace(bounds[0], bounds[1]), centres, self._part.radius)
        fellows = self._of_link @ (self._of_link.T @ held)
        score = np.where(held[out], fellows[out], -1.0)
        self._home[out] = np.where(held[out].any(axis=1), score.argmax(axis=1), -1)
