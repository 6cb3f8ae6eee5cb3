"""All configurations along a tool path that continuous motions reach, in layers: self-motion explored as well.

The solutions of each pose form curves (or surfaces) in joint space. Nodes lie on them about a fixed distance apart.
From every node the arm moves on to the next pose, straight and turned a little to every side along its self-motion
where no node is near already, so that a layer holds whatever can be reached in the sphere model. Neighbours in
consecutive layers are joined; of the paths in that ladder the cheapest is taken, its edges are checked, and without
those that fail the next cheapest, until one holds (edges are checked when they are wanted only: the lazy roadmap of
Bohlin and Kavraki, ICRA 2000).
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray

from workcell.motion.tool_paths.graph import dearness
from workcell.motion.tool_paths.self_motion import APART, Rows, differences, distinct, sideways
from workcell.motion.tool_paths.tracker import LocalTracker
from workcell.pose import Array, Pose

JOINED = 1.3
"""Share of it within which nodes of consecutive layers are joined."""
WIDTH = 800
"""Nodes kept in a layer."""
ROUNDS = 100
"""Steps along the self-motions of the first pose."""
HALVINGS = 3
"""How often the distance between two poses is halved where no node gets from one to the other."""
CHECKS = 60
"""Paths whose edges are checked."""
STARTS, REFUSED = 4, 0.5
"""Starts that the robot may turn out not to get to; radians around one within which others are not asked about."""

Check = Callable[[Array, Array], bool]
Begins = Callable[[Array], bool]


@dataclass(frozen=True, slots=True)
class Layer:
    """Configurations (k, n) at one pose, how dear each is (k,), and edges with their lengths.

    An edge is a column of `edges` (2, e): its row in the layer before, and its row here.
    """

    pose: Pose
    q: Array
    dear: Array
    edges: Rows
    lengths: Array


@dataclass(slots=True)
class Sheet:
    """What continuous motions reach along a tool path.

    Attributes:
        tracker: local tracking in the robot's world.
        poses: of the path.
        clear: clearance (metres) of a configuration (n,), by the problem's own truth; None: it is not asked.
        floor: metres to keep by that truth.
        patient: whether the tool may wait at a pose while the arm moves on along its self-motion.
        layers: as far as they were reached, with poses between the given ones where needed.
        reached: how many of the given poses were reached.
    """

    tracker: LocalTracker
    poses: Sequence[Pose]
    clear: Callable[[Array], float] | None = None
    floor: float = 0.0
    patient: bool = False
    layers: list[Layer] = field(default_factory=list)
    reached: int = 0

    @property
    def complete(self) -> bool:
        """Whether the last pose was reached."""
        return self.reached == len(self.poses)

    @property
    def nodes(self) -> int:
        """Configurations in all layers."""
        return sum(len(layer.q) for layer in self.layers)

    def grow(self, starts: Array, *, spread: bool) -> None:
        """Fill the layers from starts (k, n) at the first pose, and (`spread`) from their self-motions at it."""
        q = starts[distinct(starts, starts[:0])]
        if spread:
            q = self._filled(self.poses[0], q)
        self.layers = [self._layer(self.poses[0], q, np.full(len(q), np.inf), None, None)]
        self.reached = 1
        self._wait()
        for pose in self.poses[1:]:
            if not self._onwards(pose, HALVINGS):
                return
            self.reached += 1
            self._wait()

    def _wait(self) -> None:
        """Layers at the pose that was reached, as long as each has more nodes than the one before."""
        for _round in range(ROUNDS if self.patient else 0):
            before = self.layers[-1]
            q, gap, parent, _ = self._arrivals(before.pose, before)
            if len(before.q) >= WIDTH or len(distinct(q, before.q)) == 0:
                return
            self.layers.append(self._layer(before.pose, q, gap, before, parent))

    def _onwards(self, pose: Pose, halvings: int) -> bool:
        """Add the layer of the next pose; by way of poses between where no node gets there, or hardly any."""
        before = self.layers[-1]
        q, gap, parent, far = self._arrivals(pose, before)
        if halvings > 0 and (not len(q) or far > 0.5 * len(before.q)):
            known = len(self.layers)
            halfway = before.pose.interpolate(pose, 0.5)
            if self._onwards(halfway, halvings - 1) and self._onwards(pose, halvings - 1):
                return True
            del self.layers[known:]
        if not len(q):
            return False
        self.layers.append(self._layer(pose, q, gap, before, parent))
        return True

    def _arrivals(self, pose: Pose, before: Layer) -> tuple[Array, Array, Rows, int]:
        """Configurations at a pose, their clearances and the rows before that they come from; how many step too far."""
        rows = np.arange(len(before.q))
        still = np.zeros_like(before.q)
        q, gap, parent, far = self._moved(pose, before.q, still, rows)
        straight, origin = q, parent
        for wish in sideways(self.tracker.template.robot, self.tracker.tolerance, pose, straight):
            aims = straight + wish
            fresh = distinct(aims, q)
            begin = before.q[origin[fresh]]
            aside, its_gap, its_parent, _ = self._moved(pose, begin, aims[fresh] - begin, origin[fresh])
            kept = distinct(aside, q)
            q = np.concatenate([q, aside[kept]])
            gap = np.concatenate([gap, its_gap[kept]])
            parent = np.concatenate([parent, its_parent[kept]])
        return q, gap, parent, far

    def _moved(self, pose: Pose, starts: Array, wishes: Array, rows: Rows) -> tuple[Array, Array, Rows, int]:
        """Where configurations get to at a pose, distinct and clear; how many would have to step too far."""
        tracker = self.tracker
        out, gap = np.array(starts), np.full(len(starts), -np.inf)
        left, asked = np.arange(len(starts)), np.zeros(len(starts), dtype=bool)
        found = np.zeros(len(starts), dtype=bool)
        for lane in (0, tracker.lanes - 1):
            arrived, q, room = tracker.moved(pose, starts[left], wishes[left], lane)
            out[left], gap[left], found[left] = q, room, arrived
            asked[left] = lane > 0 or tracker.template.cover is None
            left = left[~arrived]
        far = int(np.sum(np.abs(out[left] - starts[left]).max(axis=1, initial=0.0) > 0.99 * tracker.largest))
        good = np.flatnonzero(found)
        good = good[distinct(out[good], out[:0])]
        good = good[np.array([self._is_clear(out[k], bool(asked[k])) for k in good], dtype=bool)]
        return out[good], gap[good], rows[good], far

    def _is_clear(self, q: Array, asked: bool) -> bool:
        """What is clear in the model around the robot is clear; the truth is asked about the rest."""
        return not asked or self.clear is None or self.clear(q) >= self.floor

    def _filled(self, pose: Pose, q: Array) -> Array:
        """Configurations (k, n) of one pose and whatever their self-motions reach."""
        front = q
        for _round in range(ROUNDS):
            fresh = []
            for wish in sideways(self.tracker.template.robot, self.tracker.tolerance, pose, front):
                aims = distinct(front + wish, q)
                fresh.append(self._moved(pose, front[aims], wish[aims], aims)[0])
            moved = np.concatenate(fresh) if fresh else q[:0]
            front = moved[distinct(moved, q)]
            q = np.concatenate([q, front])
            if not len(front) or len(q) > WIDTH:
                break
        return q

    def _layer(self, pose: Pose, q: Array, gap: Array, before: Layer | None, parent: Rows | None) -> Layer:
        if len(q) > WIDTH:
            kept = np.sort(np.random.default_rng(len(q)).permutation(len(q))[:WIDTH])
            q, gap, parent = q[kept], gap[kept], None if parent is None else parent[kept]
        dear = dearness(self.tracker.template.robot, q, gap)
        if before is None or parent is None:
            return Layer(pose, q, dear, np.zeros((2, 0), dtype=np.int64), np.zeros(0))
        apart = differences(before.q, q)
        joined = apart <= JOINED * APART
        joined[parent, np.arange(len(q))] = True
        edges = np.stack(np.nonzero(joined))
        return Layer(pose, q, dear, edges, apart[edges[0], edges[1]] * dear[edges[1]])

    def without_waits(self, motion: Array) -> tuple[Array, tuple[Pose, ...]]:
        """A motion (k, n) through the layers and their poses, those left out where neither tool nor arm moves."""
        poses = [layer.pose for layer in self.layers]
        kept = [0]
        for row in range(1, len(motion)):
            last = kept[-1]
            if np.any(motion[row] != motion[last]) or max(poses[row].error_to(poses[last])) > 0.0:
                kept.append(row)
        return motion[kept], tuple(poses[row] for row in kept)

    def cheapest(
        self, check: Check, begins: Begins | None = None, prices: Array | None = None
    ) -> Array | None:
        """The cheapest motion (k, n) through all layers whose edges hold; None where none was found.

        Args:
            check: whether the straight joint motion between two configurations holds.
            begins: whether a motion may begin at a configuration; None: at any.
            prices: of the first layer's configurations (k,); None: none.
        """
        open_edges = [np.ones(layer.edges.shape[1], dtype=bool) for layer in self.layers]
        cost = np.zeros(len(self.layers[0].q)) if prices is None else prices
        held: set[tuple[int, int]] = set()
        refused = 0
        for _try in range(CHECKS):
            chain = self._shortest(cost, open_edges)
            if chain is None or refused > STARTS:
                return None
            broken = [
                (level, edge)
                for level, edge in enumerate(chain, start=1)
                if (level, edge) not in held and not self._holds(level, edge, check)
            ]
            held |= {(level, edge) for level, edge in enumerate(chain, start=1)} - set(broken)
            for level, edge in broken:
                open_edges[level][edge] = False
            if broken:
                continue
            first = int(self.layers[1].edges[0, chain[0]])
            if begins is None or begins(self.layers[0].q[first]):
                later = [layer.q[layer.edges[1, e]] for layer, e in zip(self.layers[1:], chain, strict=True)]
                return np.stack([self.layers[0].q[first], *later])
            refused += 1
            near = np.abs(self.layers[0].q - self.layers[0].q[first]).max(axis=1) < REFUSED
            open_edges[1] &= ~near[self.layers[1].edges[0]]
        return None

    def _holds(self, level: int, edge: int, check: Check) -> bool:
        a, b = self.layers[level].edges[:, edge]
        return check(self.layers[level - 1].q[a], self.layers[level].q[b])

    def why(self) -> str:
        """Why no node of the last layer gets to the next pose, in words: of the one that is best off."""
        last, pose = self.layers[-1], self.poses[self.reached]
        q = last.q[int(np.argmin(last.dear))]
        tracked = self.tracker.track_anyhow([pose], q)
        if tracked.complete and self.clear is not None:
            return f"only {1e3 * self.clear(tracked.configurations[-1]):.1f} mm of clearance are left"
        return self.tracker.why(pose, tracked, q)

    def _shortest(self, cost: Array, open_edges: Sequence[NDArray[np.bool_]]) -> list[int] | None:
        """Rows of the edges, layer by layer, of the cheapest path; None where none leads to the last layer.

        `cost` is what it costs to begin at each configuration of the first layer.
        """
        arrived_by = []
        for layer, is_open in zip(self.layers[1:], open_edges[1:], strict=True):
            rows = np.flatnonzero(is_open)
            total = cost[layer.edges[0, rows]] + layer.lengths[rows]
            order = np.argsort(-total, kind="stable")
            by = np.full(len(layer.q), -1, dtype=np.int64)
            by[layer.edges[1, rows[order]]] = rows[order]
            cost = np.full(len(layer.q), np.inf)
            cost[layer.edges[1, rows[order]]] = total[order]
            arrived_by.append(by)
        if not np.isfinite(cost).any():
            return None
        at, chain = int(np.argmin(cost)), []
        for layer, by in zip(self.layers[:0:-1], arrived_by[::-1], strict=True):
            edge = int(by[at])
            chain.append(edge)
            at = int(layer.edges[0, edge])
        return chain[::-1]
