"""Nodes whose rotation is known but for one angle: they hang by hinges of one direction on a known one.

A certificate says for each node which joint, tie or goal it hangs by (docs/proofs.md, 12.5); here that is followed to
the world or to a goal. What hinges are parallel but for, and what welds may miss, becomes a bound on the departure.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, field, replace

import numpy as np
from numpy.typing import NDArray

from workcell.ik.mechanisms.problem import MechanismProblem
from workcell.ik.mechanisms.proofs.graph import FARTHEST_TURN, TWISTED, Graph
from workcell.model.mechanism.mechanism import WORLD
from workcell.pose import Array

ALONE = -1
"""A node that hangs by nothing: its rotation may be any."""


@dataclass(frozen=True, slots=True)
class Hang:
    """A node's rotation: `root Rot(axis, sign psi) C` up to a departure; `root C` where it has no axis.

    Attributes:
        goal: whose rotation the root has, within its tolerance; -1: the root is the world.
        root: (3, 3).
        C: (3, 3).
        axis: (3,) unit vector, or None.
        joint: the hinge whose value psi is exactly, if it is the node's own; -1 else.
        sign: 1 or -1.
        off: Frobenius norm of the departure, at most.
    """

    goal: int
    root: Array
    C: Array
    axis: Array | None = None
    joint: int = -1
    sign: float = 1.0
    off: float = 0.0


@dataclass(slots=True)
class Hangs:
    """Follows what a certificate says.

    Attributes:
        problem, graph: what it is about.
        by: (links,) for the first link of every node what it hangs by: joints first, then ties, then goals, then joints
            again, as what holds it in the middle of their range; -1: nothing.
        twisted: what a weld's tolerance makes of it, radians.
        reached: whether goals' rotations are known.
    """

    problem: MechanismProblem
    graph: Graph
    by: NDArray[np.int64]
    twisted: float
    reached: bool = True
    _known: dict[int, Hang | None] = field(default_factory=dict)
    _asked: set[int] = field(default_factory=set)

    def of(self, node: int) -> Hang | None:
        """How a node is known; None: it is not.

        Raises:
            ValueError: it hangs by what does not hold it, or on itself.
        """
        if node not in self._known:
            if node in self._asked:
                raise ValueError(f"link {node} hangs on itself")
            self._asked.add(node)
            self._known[node] = self._follow(node)
        return self._known[node]

    def tried(self, node: int, by: int) -> Hang | None:
        """How a node that hangs by nothing would be known if it hung by something else; it does from now on."""
        self.by[node] = by
        self._asked.discard(node)
        self._known.pop(node, None)
        return self.of(node)

    def _follow(self, node: int) -> Hang | None:
        if node == WORLD:
            return Hang(-1, np.eye(3), np.eye(3))
        by, joints = int(self.by[node]), self.graph.joints
        if by == ALONE:
            return None
        if by < joints:
            return self._by_hinge(node, by)
        by -= joints
        if by < (ties := len(self.problem.mechanism.closures)):
            return self._by_weld(node, by)
        by -= ties
        if by < (goals := len(self.problem.goals)):
            return self._by_goal(node, by)
        return self._by_limits(node, by - goals)

    def fixed(self, link: int) -> tuple[Hang, Array] | None:
        """How the node of a link is known, and the link's rotation (3, 3) then; None where it can turn, or is not."""
        node = int(self.graph.node[link])
        hang = self.of(node)
        if hang is None or hang.axis is not None:
            return None
        return hang, hang.root @ hang.C @ self.graph.inner[link]

    def _above(self, node: int, other: int) -> Hang:
        if other == node or (hang := self.of(other)) is None:
            raise ValueError(f"link {node} hangs on link {other}, whose rotation is not known")
        return hang

    def _by_hinge(self, node: int, k: int) -> Hang:
        graph = self.graph
        parent = int(graph.parent[k])
        before, J, X = int(graph.node[parent]), graph.turn[k], graph.inner[parent]
        if graph.kinds[k] != "hinge" or node not in (before, k + 1):
            raise ValueError(f"link {node} does not hang by a hinge {k}")
        if node == k + 1:
            hang = self._above(node, before)
            C = hang.C @ X @ J
            return _turned(hang, C @ graph.axis[k], C, k, 1.0)
        hang = self._above(node, k + 1)
        return _turned(hang, hang.C @ graph.axis[k], hang.C @ J.T @ X.T, k, -1.0)

    def _by_limits(self, node: int, k: int) -> Hang:
        graph = self.graph
        parent = int(graph.parent[k])
        before, X = int(graph.node[parent]), graph.inner[parent]
        if graph.kinds[k] not in ("hinge", "ball") or node not in (before, k + 1):
            raise ValueError(f"link {node} is not held by joint {k}")
        off = FARTHEST_TURN * abs(math.sin(0.5 * graph.half[k]))
        down = node == k + 1
        hang = self._above(node, before if down else k + 1)
        C = hang.C @ (X @ graph.rest[k] if down else graph.rest[k].T @ X.T)
        return replace(hang, C=C, joint=-1, off=hang.off + off)

    def _by_weld(self, node: int, c: int) -> Hang:
        graph, closure = self.graph, self.problem.mechanism.closures[c]
        (a, b), (F, G) = closure.links, closure.frames
        if graph.node[a] != node:
            (a, b), (F, G) = (b, a), (G, F)
        if closure.kind != "weld" or graph.node[a] != node:
            raise ValueError(f"link {node} does not hang by a weld {c}")
        hang = self._above(node, int(graph.node[b]))
        C = hang.C @ graph.inner[b] @ G.rotation @ F.rotation.T @ graph.inner[a].T
        return replace(hang, C=C, joint=-1, off=hang.off + TWISTED * self.twisted)

    def _by_goal(self, node: int, g: int) -> Hang:
        goal = self.problem.goals[g]
        frame = self.problem.mechanism.frame(goal.frame)
        if not self.reached or goal.rotation is None or self.graph.node[frame.link] != node:
            raise ValueError(f"link {node} does not hang by a goal {g}")
        inner = self.graph.inner[frame.link] @ frame.T_link_frame.rotation
        return Hang(g, goal.rotation @ inner.T, np.eye(3))


def _turned(hang: Hang, axis: Array, C: Array, k: int, sign: float) -> Hang:
    """What hangs by a hinge about `axis` (seen from the root) on what is known."""
    if hang.axis is None:
        return replace(hang, C=C, axis=axis, joint=k, sign=sign)
    apart = min(float(np.linalg.norm(axis - hang.axis)), float(np.linalg.norm(axis + hang.axis)))
    return replace(hang, C=C, joint=-1, off=hang.off + 4.0 * apart)
