"""A layered graph of configurations along a tool path: which start leads all the way.

Some poses of the path are layers. A node is a configuration at a layer that was reached by continuous local tracking
from a node of the layer before (`workcell.motion.tool_paths.tracker`); an edge is that motion. From each node
tracking goes on freely (away from limits, singularities and obstacles). So whatever route the graph holds is
continuous; the cheapest is wanted.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, field
from itertools import pairwise

import numpy as np
from numpy.typing import NDArray

from workcell.model.robot import Robot
from workcell.motion.quality import limit_distance, manipulability
from workcell.motion.tool_paths.tracker import LocalTracker
from workcell.pose import Array, Pose

WIDTH = 16
"""Nodes kept in a layer, the cheapest first."""
SAME = 0.03
"""Radians in every joint within which two nodes are one."""
_COMFORT = (0.1, 0.02, 3e-4)
"""Distance from joint limits (radians), clearance (metres) and manipulability below which a motion becomes dear."""
_DEAREST = 20.0

Layer = NDArray[np.int64]


@dataclass(frozen=True, slots=True)
class Route:
    """A continuous motion through all poses: configurations (k, n), its cost (radians), and the row of its start."""

    configurations: Array
    cost: float
    start: int


@dataclass(frozen=True, slots=True)
class DeadEnd:
    """How far a start led.

    Attributes:
        start: row of the start.
        waypoint: row of the pose that was not reached.
        motion: (k, n) configurations at the first poses, as far as they are sound.
        why: in words.
    """

    start: int
    waypoint: int
    motion: Array
    why: str


@dataclass(frozen=True, slots=True)
class Routes:
    """What the graph holds.

    Attributes:
        complete: routes through all poses, the cheapest first.
        dead_ends: for each start without a route, the furthest that it led to.
        nodes, edges: configurations reached, motions tried.
    """

    complete: tuple[Route, ...]
    dead_ends: tuple[DeadEnd, ...]
    nodes: int
    edges: int

    @property
    def furthest(self) -> DeadEnd | None:
        """The dead end that lies furthest along the path."""
        return max(self.dead_ends, key=lambda end: end.waypoint, default=None)


@dataclass(frozen=True, slots=True)
class _Node:
    q: Array
    motion: Array
    cost: float
    start: int
    parent: _Node | None


def layers_of(count: int, every: int = 6, most: int = 25) -> Layer:
    """Rows of the poses that are layers: about every sixth, the first and the last among them."""
    layers = int(np.clip(np.ceil((count - 1) / every) + 1, 2, most))
    return np.unique(np.round(np.linspace(0, count - 1, layers)).astype(np.int64))


@dataclass(slots=True)
class RouteSearch:
    """Search for routes along one tool path.

    Attributes:
        tracker: local tracking in the robot's world.
        poses: of the path.
        clear: clearance (metres) of a configuration (n,), by the problem's own truth; None: it is not asked.
        floor: metres to keep by that truth.
    """

    tracker: LocalTracker
    poses: Sequence[Pose]
    clear: Callable[[Array], float] | None = None
    floor: float = 0.0
    nodes: int = 0
    edges: int = 0
    ends: dict[int, DeadEnd] = field(default_factory=dict)

    def run(self, starts: Sequence[Array]) -> Routes:
        """Routes from any of the starts (n,), which have the tool at the first pose."""
        layer = [_Node(np.asarray(q), np.asarray(q)[None], 0.0, i, None) for i, q in enumerate(starts)]
        self.nodes, self.edges, self.ends = len(layer), 0, {}
        rows = layers_of(len(self.poses))
        for before, row in pairwise(rows):
            tried = [self._onwards(origin, int(before), int(row)) for origin in layer]
            arrivals = [node for node in tried if node is not None]
            layer = _distinct(sorted(arrivals, key=lambda node: node.cost))[:WIDTH]
            self.nodes += len(layer)
        complete = tuple(Route(_unrolled(node), node.cost, node.start) for node in layer)
        through = {route.start for route in complete}
        ends = tuple(end for start, end in sorted(self.ends.items()) if start not in through)
        return Routes(complete, ends, self.nodes, self.edges)

    def _onwards(self, origin: _Node, before: int, row: int) -> _Node | None:
        """The node of the next layer that one node leads to, if tracking gets there clear; else None, a dead end."""
        self.edges += 1
        poses = self.poses[before + 1 : row + 1]
        tracked = self.tracker.track_anyhow(poses, origin.q)
        motion = tracked.configurations
        if not tracked.complete:
            at = before + 1 + len(motion)
            q_before = motion[-1] if len(motion) else origin.q
            why = self.tracker.why(self.poses[at], tracked, q_before)
            self._note(DeadEnd(origin.start, at, np.concatenate([_unrolled(origin), motion]), why))
            return None
        clearance = np.inf if self.clear is None else self.clear(motion[-1])
        if clearance < self.floor:
            why = f"only {1e3 * clearance:.1f} mm of clearance are left"
            self._note(DeadEnd(origin.start, before + len(motion), _unrolled(origin), why))
            return None
        cost = origin.cost + self._cost(origin.q, motion, min(clearance, tracked.clearance))
        return _Node(motion[-1], motion, cost, origin.start, origin)

    def _note(self, end: DeadEnd) -> None:
        known = self.ends.get(end.start)
        if known is None or end.waypoint > known.waypoint:
            self.ends[end.start] = end

    def _cost(self, q: Array, motion: Array, clearance: float) -> float:
        """Radians of travel (the largest joint's), dearer near limits, singularities and obstacles."""
        travel = np.abs(np.diff(np.vstack([q, motion]), axis=0)).max(axis=1)
        dear = dearness(self.tracker.template.robot, motion, np.full(len(motion), clearance))
        return float((travel * dear).sum())


def dearness(robot: Robot, q: Array, clearance: Array) -> Array:
    """(k,) what a radian costs at configurations (k, n) with that clearance (k,): 1, more near what to avoid."""
    near = np.stack(
        [
            _COMFORT[0] / np.maximum(limit_distance(robot, q), 1e-9),
            _COMFORT[1] / np.maximum(clearance, 1e-9),
            _COMFORT[2] / np.maximum(manipulability(robot, q), 1e-12),
        ]
    )
    dear: Array = 1.0 + np.minimum(near**2, _DEAREST).sum(axis=0)
    return dear


def _distinct(nodes: list[_Node]) -> list[_Node]:
    """Nodes, in their order, without those that are another one again."""
    kept: list[_Node] = []
    for node in nodes:
        if all(float(np.abs(node.q - other.q).max()) > SAME for other in kept):
            kept.append(node)
    return kept


def _unrolled(node: _Node) -> Array:
    """All configurations from a node's start to it."""
    parts = []
    at: _Node | None = node
    while at is not None:
        parts.append(at.motion)
        at = at.parent
    return np.concatenate(parts[::-1])
