"""An upper bound of the function F of a certificate about a mechanism, node by node.

See docs/proofs.md, 12.6. Nothing is taken from the solver: neither its rows nor its idea of which axes are parallel.
"""

from __future__ import annotations

import itertools
import math

import numpy as np

from workcell.ik.claims.chain import quaternion_forms, skew
from workcell.ik.claims.eigenvalue import largest_eigenvalue
from workcell.ik.mechanisms.proofs.graph import Graph
from workcell.ik.mechanisms.proofs.hangs import Hang, Hangs
from workcell.ik.mechanisms.proofs.multipliers import Multipliers
from workcell.ik.mechanisms.proofs.sums import Sum, turned_by
from workcell.pose import Array

ROUNDING = 2e-9
"""Part of F (for multipliers of unit length) that is kept back for rounding.

With u = 2^-53: products of up to 64 rotations err by less than 16 u each, a sum has fewer than 1500 terms, sines,
norms and the rest add less than 300 u: together below (1024 + 1500 + 300) u < 3.2e-13 of the terms' sizes. There are
fewer than 750 multipliers (vectors and matrices), each times lengths below `LONGEST` and at most eight rotations, so
that the sizes add up to less than sqrt(3) (8 + LONGEST) sqrt(750) < 2760.
"""
MOST_CORNERS = 6
"""Slides of a node whose ends are all combined; what further ones add is bounded one by one."""


class Node:
    """What F has of one node's rotation: `<N + sum s_k M_k, R>`, `M_k = m_k w_k^T`, s_k between its ends."""

    def __init__(self, graph: Graph, total: Sum, node: int) -> None:
        links = np.flatnonzero(graph.node == node)
        self.N: Array = sum((total.N[link] @ graph.inner[link].T for link in links), np.zeros((3, 3)))
        chosen = [
            link - 1
            for link in links
            if link and graph.kinds[link - 1] == "slide" and total.touched[link - 1] > 0.0
        ]
        self.ends = graph.ends[chosen]
        self.m = total.m[chosen]
        self.M = self.m[:, :, None] * np.array([graph.inner[k + 1] @ graph.axis[k] for k in chosen]).reshape(
            -1, 1, 3
        )

    @property
    def bounded(self) -> bool:
        """Whether all of its slides that count have ends."""
        return bool(np.all(np.isfinite(self.ends)))

    def middle(self) -> tuple[Array, float]:
        """N with all slides in their middles, and the Frobenius norm by which it is off elsewhere."""
        half = 0.5 * (self.ends[:, 1] - self.ends[:, 0])
        N = self.N + np.einsum("k,kij->ij", 0.5 * (self.ends[:, 1] + self.ends[:, 0]), self.M)
        return N, float(np.abs(half) @ np.linalg.norm(self.m, axis=1))

    def corners(self) -> tuple[Array, float]:
        """(2^k, 3, 3) N at the ends of the first slides, the others in their middles, and what those add."""
        first, rest = self.ends[:MOST_CORNERS], self.ends[MOST_CORNERS:]
        N = self.N + np.einsum("k,kij->ij", 0.5 * (rest[:, 1] + rest[:, 0]), self.M[MOST_CORNERS:])
        more = float(np.abs(0.5 * (rest[:, 1] - rest[:, 0])) @ np.linalg.norm(self.m[MOST_CORNERS:], axis=1))
        chosen = np.array(list(itertools.product(*first.tolist()))).reshape(2 ** len(first), len(first))
        return N + np.einsum("vk,kij->vij", chosen, self.M[: len(first)]), more


def upper_bound(graph: Graph, m: Multipliers, total: Sum, hangs: Hangs, covered: Array) -> float:
    """No less than F at any configuration that the claim is about; infinite where nothing bounds it.

    Raises:
        ValueError: a node hangs by what does not hold it.
    """
    constant = _half_spaces(graph, m, total, hangs, covered)
    values = [constant, total.constant, total.charges, _floating(graph, total)]
    roots: dict[int, tuple[Array, float]] = {}
    for link in np.unique(graph.node).tolist():
        node, hang = Node(graph, total, link), hangs.of(link)
        if not node.bounded:
            return math.inf
        if hang is None:
            values.append(_anyhow(node))
            continue
        N, spread = node.middle()
        chord = float(m.chords[hang.joint]) if hang.joint >= 0 else 0.0
        values.append(_known(node, hang, chord, graph))
        values.append(hang.off * (float(np.linalg.norm(N)) + spread))
        if hang.goal >= 0:
            fixed, moved = roots.get(hang.goal, (np.zeros((3, 3)), 0.0))
            more, turned = _parts(N @ hang.C.T, hang.axis)
            roots[hang.goal] = fixed + more, moved + turned + spread
    for fixed, moved in roots.values():
        values.append(turned_by(float(covered[1])) * (float(np.linalg.norm(fixed)) + moved))
    return math.fsum(values)


def _half_spaces(graph: Graph, m: Multipliers, total: Sum, hangs: Hangs, covered: Array) -> float:
    """Adds to F the half-spaces of hinges next to a link whose rotation is known, and what they add besides.

    Those of a node that hangs by that hinge are added where its angle is.
    """
    added = 0.0
    for k in np.flatnonzero(m.chords > 0.0).tolist():
        value, parent = float(m.chords[k]), int(graph.parent[k])
        if any((hang := hangs.of(int(graph.node[link]))) and hang.joint == k for link in (parent, k + 1)):
            continue
        if (fixed := hangs.fixed(parent)) is not None:
            total.N[k + 1] += value * np.outer(fixed[1] @ graph.turned[k], graph.across[k])
        elif (fixed := hangs.fixed(k + 1)) is not None:
            total.N[parent] += value * np.outer(fixed[1] @ graph.across[k], graph.turned[k])
        else:
            raise ValueError(f"the half-space of joint {k} is next to no link whose rotation is known")
        astray = fixed[0].off + (turned_by(float(covered[1])) if fixed[0].goal >= 0 else 0.0)
        added += value * (astray - math.cos(float(graph.half[k])))
    return added


def _floating(graph: Graph, total: Sum) -> float:
    """What the origins of floating bodies add, at most."""
    added = 0.0
    for k in np.flatnonzero(graph.has("free") & (total.touched > 0.0)):
        most = float(np.linalg.norm(total.o[k])) * float(graph.reach[k + 1])
        if (steps := graph.steps) is not None and bool(np.all(np.isfinite(steps.room[k]))):
            near = float(total.o[k] @ steps.origin[k]) + float(np.abs(total.o[k]) @ steps.room[k])
            most = min(most, near)
        if not math.isfinite(graph.reach[k + 1]):
            return math.inf
        added += most
    return added


def _anyhow(node: Node) -> float:
    """Over all rotations: convex in the slides, so greatest at their ends."""
    N, more = node.corners()
    return max(largest_eigenvalue(K) for K in quaternion_forms(N)) + more


def _known(node: Node, hang: Hang, chord: float, graph: Graph) -> float:
    """Over the one angle that is left, its half-space with it; or at the rotation itself, every slide by itself."""
    if hang.axis is None:
        R = hang.root @ hang.C
        steps = np.einsum("kij,ij->k", node.M, R)
        return float(np.sum(node.N * R)) + float(np.sum(np.max(node.ends * steps[:, None], axis=1)))
    N, more = node.corners()
    d, middle = hang.axis, float(graph.middle[hang.joint])
    M = hang.root.T @ N @ hang.C.T
    fixed = np.einsum("i,vij,j->v", d, M, d)
    c = np.trace(M, axis1=1, axis2=2) - fixed + chord * math.cos(middle)
    s = hang.sign * np.einsum("vij,ij->v", M, skew(d)) + chord * math.sin(middle)
    return float(np.max(fixed + np.hypot(c, s))) + more - chord * math.cos(float(graph.half[hang.joint]))


def _parts(M: Array, axis: Array | None) -> tuple[Array, float]:
    """M Rot(axis, .)^T: what does not turn, and the size of what does, at most."""
    if axis is None:
        return M, 0.0
    along = np.outer(axis, axis)
    turned = math.hypot(float(np.linalg.norm(M @ (np.eye(3) - along))), float(np.linalg.norm(M @ skew(axis))))
    return M @ along, turned
