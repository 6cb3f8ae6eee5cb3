"""The function F of a certificate about a mechanism: `constant + sum <N, R> + sum s <m, R a> + sum <o, p>`.

See docs/proofs.md, 12.4. Every row is written with the rotations of links; the places of points go over into
rotations along the tree, slides and floating bodies leave terms of their own.
"""

from __future__ import annotations

import math

import numpy as np

from workcell.ik.mechanisms.problem import MechanismProblem
from workcell.ik.mechanisms.proofs.graph import BLURRED, FARTHEST_TURN, MISSED, TWISTED, Graph
from workcell.ik.mechanisms.proofs.multipliers import Multipliers
from workcell.ik.problem import STEP_SLACK
from workcell.model.mechanism.mechanism import WORLD
from workcell.model.mechanism.placing import place
from workcell.pose import Array


def turned_by(angle: float) -> float:
    """Frobenius norm by which a rotation differs from a goal's that it reaches within an angle, at most."""
    return FARTHEST_TURN * math.sin(0.5 * angle) + BLURRED


class Sum:
    """F, from the mechanism alone.

    Attributes:
        N: (links, 3, 3) what the links' rotations are multiplied by.
        constant: the rest, but for slides, floating bodies, and the half-spaces of limits, which belong to angles.
        m: (n, 3) what the way of a slide is multiplied by: `s_k <m_k, R_(k+1) a_k>`.
        o: (n, 3) what the origin of a floating body is multiplied by.
        touched: (n,) sizes of all that was added to m and o: zero only where they are zero in any arithmetic.
        charges: what the tolerances can add to F, but for those of rotations that count as known.
    """

    def __init__(
        self, problem: MechanismProblem, graph: Graph, m: Multipliers, covered: Array, *, reached: bool = True
    ) -> None:
        n = graph.joints
        self.N, self.constant, self.charges = np.zeros((n + 1, 3, 3)), 0.0, 0.0
        self.m, self.o, self.touched = np.zeros((n, 3)), np.zeros((n, 3)), np.zeros(n)
        self._graph = graph
        self._joints(m)
        self._ties(problem, m, covered)
        self._goals(problem, m, covered if reached else np.zeros(4), covered)
        self._regions(problem, m, covered)
        self._references(problem, m)

    def place(self, m: Array, link: int, local: Array, until: int = WORLD) -> None:
        """Add `m . p`, p a point of a link, without what the origin of the link `until`, one of those before, adds."""
        graph = self._graph
        while link != until:
            self.N[link] += np.outer(m, local)
            k = link - 1
            if graph.kinds[k] == "free":
                self.o[k] += m
                self.touched[k] += float(np.abs(m).sum())
                return
            if graph.kinds[k] == "slide":
                self.m[k] += m
                self.touched[k] += float(np.abs(m).sum())
            local, link = graph.xyz[k], int(graph.parent[k])
        self.N[link] += np.outer(m, local)

    def _joints(self, m: Multipliers) -> None:
        graph = self._graph
        for k, parent in enumerate(graph.parent.tolist()):
            if graph.kinds[k] == "hinge":
                self.N[parent] += np.outer(m.axes[k], graph.along[k]) + np.outer(m.limits[k], graph.turned[k])
                self.N[k + 1] -= np.outer(m.axes[k], graph.axis[k]) + np.outer(m.limits[k], graph.across[k])
                self.constant += float(np.linalg.norm(m.limits[k])) * 2.0 * math.sin(0.5 * graph.half[k])
            if graph.kinds[k] in ("hinge", "ball"):
                self.N[parent] += m.turns[k] @ graph.rest[k].T
                self.N[k + 1] -= m.turns[k]
                turned = FARTHEST_TURN * math.sin(0.5 * graph.half[k])
                self.constant += float(np.linalg.norm(m.turns[k])) * turned
            if graph.kinds[k] == "ball" and graph.steps is not None:
                self.N[parent] += m.steps[k] @ graph.steps.rest[k].T
                self.N[k + 1] -= m.steps[k]
                turned = FARTHEST_TURN * math.sin(0.5 * graph.steps.half[k])
                self.constant += float(np.linalg.norm(m.steps[k])) * turned

    def _ties(self, problem: MechanismProblem, m: Multipliers, covered: Array) -> None:
        for c, closure in enumerate(problem.mechanism.closures):
            (a, b), (F, G) = closure.links, closure.frames
            common = self._common(a, b)
            self.place(m.closures[c], a, F.position, common)
            self.place(-m.closures[c], b, G.position, common)
            self.charges += MISSED * float(covered[2]) * float(np.linalg.norm(m.closures[c]))
            if closure.kind == "weld":
                self.N[a] += m.welds[c] @ F.rotation.T
                self.N[b] -= m.welds[c] @ G.rotation.T
                self.charges += TWISTED * float(covered[2]) * float(np.linalg.norm(m.welds[c]))

    def _common(self, a: int, b: int) -> int:
        """The last link that both hang on; parents come before their children."""
        while a != b:
            if a > b:
                a = int(self._graph.parent[a - 1])
            else:
                b = int(self._graph.parent[b - 1])
        return a

    def _goals(self, problem: MechanismProblem, m: Multipliers, missed: Array, covered: Array) -> None:
        turned = turned_by(float(missed[1])) if missed[1] else 0.0
        for g, goal in enumerate(problem.goals):
            frame = problem.mechanism.frame(goal.frame)
            T = frame.T_link_frame
            if goal.position is not None:
                self.place(m.positions[g], frame.link, T.position)
                self.constant -= float(m.positions[g] @ goal.position)
                self.charges += float(missed[0]) * float(np.linalg.norm(m.positions[g]))
            if goal.rotation is not None:
                self.N[frame.link] += m.rotations[g] @ T.rotation.T
                self.constant -= float(np.sum(m.rotations[g] * goal.rotation))
                self.charges += turned * float(np.linalg.norm(m.rotations[g]))
            if goal.axis is not None and goal.direction is not None:
                axis, wide = T.rotation @ goal.axis, min(goal.within + float(covered[1]), math.pi)
                self.N[frame.link] += np.outer(m.directions[g] + m.cones[g] * goal.direction, axis)
                self.constant -= float(m.directions[g] @ goal.direction)
                self.constant -= float(m.cones[g]) * math.cos(wide)
                self.charges += (float(covered[1]) + BLURRED) * float(np.linalg.norm(m.directions[g]))
                self.charges += BLURRED * float(m.cones[g])

    def _regions(self, problem: MechanismProblem, m: Multipliers, covered: Array) -> None:
        first = 0
        for region in problem.regions:
            mu = m.regions[first : first + len(region.b)]
            first += len(region.b)
            frame = problem.mechanism.frame(region.frame)
            for value, normal in zip(mu.tolist(), region.A, strict=True):
                if value:
                    self.place(-value * normal, frame.link, frame.T_link_frame.apply(region.point))
            self.constant += float(mu @ region.b)
            self.charges += float(covered[3]) * float(np.abs(mu).sum())

    def _references(self, problem: MechanismProblem, m: Multipliers) -> None:
        if problem.q_reference is None:
            return
        most = np.full(len(m.links), FARTHEST_TURN)
        if problem.max_link_rotation is not None:
            most = np.minimum(most, problem.max_link_rotation + STEP_SLACK)
        if (steps := self._graph.steps) is not None:
            loose = self._graph.has("free")
            most[1:][loose] = np.minimum(most[1:], FARTHEST_TURN * np.sin(0.5 * steps.half))[loose]
        reference = place(problem.mechanism, problem.q_reference).R
        self.N += m.links[:, None, None] * reference
        self.constant -= float(m.links @ (3.0 - 0.5 * most * most))
