"""The ways that robots are on through a run, and the cuboids that the solver had the links in where they are."""

from __future__ import annotations

import json
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray

from workcell.model.robot import Robot
from workcell.model.scene_parts import SceneRobot
from workcell.pose import Array
from workcell.record.write.free_solids import FreeSolids
from workcell.record.write.rrd import Indexes, RrdWriter, entity
from workcell.record.write.waypoints import Waypoint, Waypoints

IN_USE, OUTSIDE, BY = "cuboids_in_use", "spheres_outside", "outside_cuboids"
"""Names of the metrics of a robot: how many cuboids the solver had its spheres in, how many of these spheres are not
wholly inside their cuboid where the robot really is, and by how many metres the farthest sticks out (0: none)."""

WAYS = "ways"
"""Below it, by robot, a document whenever it comes to another way: its name (`what`) and who answered there (`by`)."""
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
ROUNDING_M = 1e-6
"""A sphere that sticks out by less is inside."""


@dataclass(frozen=True, slots=True)
class LinkState:
    """Where the solver had a link's spheres: numbers of cuboids, and how many spheres are not wholly inside theirs."""

    solids: tuple[int, ...] = ()
    outside: int = 0


@dataclass(slots=True)
class _Follower:
    """A robot or mechanism with answered queries: its waypoints, and what was last told of it.

    Told of its links by number, and where it is.

    `addresses` are those of its waypoints' values in raw positions. Of a mechanism there is no `robot`, and no cuboid.
    `outlined` are the links that were in a polytope some time.
    """

    name: str
    addresses: NDArray[np.int64]
    robot: SceneRobot | None = None
    waypoints: Waypoints = field(default_factory=Waypoints)
    told: dict[int, LinkState] = field(default_factory=dict)
    outlined: set[int] = field(default_factory=set)
    place: str = ""


class CuboidUse:
    """Follows the robots along their planned ways.

    A configuration that was found among cuboids has each sphere of the robot in one of them: the solver's assignment,
    which is what kept the robot clear. It is shown while the robot is nearer to this waypoint than to the others of
    its way. Where the robot is on no way that queries answered, or the answer was not found among cuboids, no cuboid
    decided, and none is shown.
    """

    def __init__(self, writer: RrdWriter, solids: FreeSolids) -> None:
        self._writer, self._solids = writer, solids
        self._followers: dict[str, _Follower] = {}

    def add_answer(self, robot: SceneRobot, waypoint: Waypoint) -> None:
        """A robot's query was answered."""
        mine = _Follower(robot.name, robot.qpos_addresses, robot)
        follower = self._followers.setdefault(robot.name, mine)
        follower.waypoints.add(waypoint)
        if waypoint.cover is None or waypoint.solids is None:
            return
        for link in np.unique(waypoint.cover.link[waypoint.solids >= 0]).tolist():
            if link not in follower.told:
                follower.told[link] = LinkState()
                path, rgb = self._path(robot, link), _LINK_RGB[(link - 1) % len(_LINK_RGB)]
                self._writer.log_box_style(path, (*rgb, 1.0), _EDGE_M)
                self._writer.log_numbers(path, link=link)

    def add_mechanism_answer(self, name: str, addresses: NDArray[np.int64], waypoint: Waypoint) -> None:
        """A question about a mechanism was answered; its waypoints have values at `addresses` of raw positions."""
        self._followers.setdefault(name, _Follower(name, addresses)).waypoints.add(waypoint)

    def send(self, indexes: Indexes, qpos: Array) -> None:
        """Where every robot is at some times; qpos (T, nq). Cuboids of robots that none decided about are left out."""
        for follower in self._followers.values():
            robot, q = follower.robot, qpos[:, follower.addresses]
            waypoints = follower.waypoints.along(q)
            self._send_places(indexes, follower, waypoints)
            if not follower.told or robot is None:
                continue
            states: dict[int, list[LinkState]] = {link: [] for link in follower.told}
            metrics = []
            for waypoint, rows in _runs(waypoints):
                now, measured = self._during(robot.robot, q[rows], waypoint)
                metrics.append(measured)
                for link, past in states.items():
                    past += now.get(link, [LinkState()] * len(measured))
            for name, column in zip((IN_USE, OUTSIDE, BY), np.concatenate(metrics).T, strict=True):
                self._writer.send_scalars(f"metrics/{name}/{entity(robot.name)}", indexes, column)
            for link, past in states.items():
                self._send_link(indexes, follower, robot, link, past)

    def _send_places(
        self, indexes: Indexes, follower: _Follower, waypoints: Sequence[Waypoint | None]
    ) -> None:
        """The rows at which a robot comes to another way, or to where somebody else answered."""
        rows: list[int] = []
        texts: list[str] = []
        for k, waypoint in enumerate(waypoints):
            place = {} if waypoint is None else {"what": waypoint.what, "by": waypoint.by}
            if (text := json.dumps(place)) != follower.place:
                rows.append(k)
                texts.append(text)
                follower.place = text
        if rows:
            index = (indexes[0][rows], indexes[1][rows])
            self._writer.send_documents(f"{WAYS}/{entity(follower.name)}", index, texts)

    def _during(
        self, robot: Robot, q: Array, waypoint: Waypoint | None
    ) -> tuple[dict[int, list[LinkState]], Array]:
        """The links' states at q (T, n) near one waypoint, and the metrics (T, 3): nan where no cuboid decided."""
        none = np.tile([0.0, np.nan, np.nan], (len(q), 1))
        if waypoint is None or waypoint.cover is None or waypoint.solids is None:
            return {}, none
        cover, mine = waypoint.cover, np.flatnonzero(waypoint.solids >= 0)
        if not len(mine):
            return {}, none
        centres = cover.centres_world(robot.link_transforms(q))[:, mine]
        solids, links, radii = waypoint.solids[mine], cover.link[mine], cover.radius[mine]
        depth = np.zeros((len(q), len(mine)))
        for number in np.unique(solids).tolist():
            its = solids == number
            depth[:, its] = self._solids[number].depth_outside(centres[:, its], radii[its])
        out = depth > ROUNDING_M
        states = {}
        for link in np.unique(links).tolist():
            its, counts = links == link, out[:, links == link].sum(axis=1)
            numbers = tuple(np.unique(solids[its]).tolist())
            states[link] = [LinkState(numbers, count) for count in counts.tolist()]
        used = np.full(len(q), len(np.unique(solids)))
        return states, np.column_stack([used, out.sum(axis=1), depth.max(axis=1).clip(min=0.0)])

    def _send_link(
        self,
        indexes: Indexes,
        follower: _Follower,
        robot: SceneRobot,
        link: int,
        past: Sequence[LinkState],
    ) -> None:
        """The rows at which a link's cuboids, or the number of its spheres outside of them, change."""
        before = [follower.told[link], *past[:-1]]
        rows = [k for k, state in enumerate(past) if state != before[k]]
        if not rows:
            return
        follower.told[link] = past[-1]
        path, index = self._path(robot, link), (indexes[0][rows], indexes[1][rows])
        changes = [past[k] for k in rows]
        self._writer.send_boxes(path, index, [self._boxes(link, state.solids) for state in changes])
        lines = [self._outlines(state.solids) for state in changes]
        if link in follower.outlined or any(lines):
            follower.outlined.add(link)
            self._writer.send_strips(path, index, lines)
        self._writer.send_lists(path, index, cuboids=[state.solids for state in changes])
        self._writer.send_numbers(path, index, spheres_outside=[state.outside for state in changes])

    def _boxes(self, link: int, solids: Sequence[int]) -> tuple[Array, Array, list[str]]:
        """Lower and upper corners (k, 3) of the cuboids among solids, and their numbers."""
        boxes = {number: box for number in solids if (box := self._solids[number].box) is not None}
        lower, upper = np.array(list(boxes.values())).reshape(-1, 2, 3).swapaxes(0, 1)
        inset = np.minimum(_INSET_M * (link - 1), 0.25 * (upper - lower))
        return lower + inset, upper - inset, [str(number) for number in boxes]

    def _outlines(self, solids: Sequence[int]) -> list[tuple[Array, str]]:
        """Edges of the polytopes among solids, and their numbers."""
        return [(self._solids[k].outline, str(k)) for k in solids if self._solids[k].box is None]

    @staticmethod
    def _path(robot: SceneRobot, link: int) -> str:
        return f"world/{IN_USE}/{entity(robot.name, robot.robot.link_names[link])}"


def _runs(waypoints: Sequence[Waypoint | None]) -> Iterator[tuple[Waypoint | None, slice]]:
    """Each waypoint with the rows, one after the other, at which it is the one."""
    begin = 0
    for end in range(1, len(waypoints) + 1):
        if end == len(waypoints) or waypoints[end] is not waypoints[begin]:
            yield waypoints[begin], slice(begin, end)
            begin = end
