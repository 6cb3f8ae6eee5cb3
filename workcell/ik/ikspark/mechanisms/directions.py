"""Where ascents begin: at the lift of the best of a few random configurations, part by part.

From the lift of a configuration an ascent ends at rank 1 twice as often as from a random direction, from that of the
best of ten three times as often.
"""

from __future__ import annotations

from collections.abc import Collection

import numpy as np

from workcell.ik.ikspark.mechanisms.lift import MechanismLift
from workcell.ik.ikspark.mechanisms.parts import Part, Parts
from workcell.ik.mechanisms.check import asked_for
from workcell.ik.mechanisms.problem import MechanismProblem
from workcell.ik.mechanisms.proofs.graph import Graph
from workcell.ik.mechanisms.sampling import random_configuration
from workcell.model.mechanism.mechanism import Mechanism
from workcell.model.mechanism.placing import place_many
from workcell.pose import Array

DRAWN = 10
"""Configurations that the best is chosen of."""
_TURNED = 0.15
"""Metres that a radian between two links counts as: places matter more."""


class Directions:
    """Directions of one search.

    Args:
        lift: the variables.
        parts: what they keep.
        rng: draws.
        loose: free joints whose bodies may be anywhere: no point of theirs is farthest along a direction.
    """

    def __init__(
        self, lift: MechanismLift, parts: Parts, rng: np.random.Generator, loose: Collection[int] = ()
    ) -> None:
        self._lift, self._rng = lift, rng
        weighed = [
            one.rows * (_TURNED if one.family in ("axis", "weld", "rotation") else 1.0)
            for one in parts.rows
            if one.cone == "zero"
        ]
        equal = np.vstack(weighed or [np.zeros((0, lift.size + 1))])
        self._equal = {
            part.columns.tobytes(): equal[np.any(equal[:, part.columns] != 0.0, axis=1)]
            for part in parts.parts
        }
        self._drawn: Array | None = None
        self._bounded = np.ones(lift.size)
        for k in loose:
            self._bounded[lift.floating[k] : lift.floating[k] + 3] = 0.0

    def draw(self) -> None:
        """Draw new configurations, for all parts."""
        self._drawn = None

    def of(self, part: Part) -> Array:
        """(k,) the part's variables of the configuration that misses least of its equalities."""
        if self._drawn is None:
            self._drawn = self._lift.lift_many(*self._configurations())
        rows = self._equal[part.columns.tobytes()]
        off = self._drawn @ rows[:, :-1].T + rows[:, -1]
        return self.towards(part, self._drawn[int(np.argmin(np.einsum("mr,mr->m", off, off)))])

    def towards(self, part: Part, x: Array) -> Array:
        """(k,) the direction of a point (N,), as far as a part goes and is bounded."""
        direction: Array = (self._bounded * x)[part.columns]
        return direction

    def nearest(self, part: Part, x: Array) -> Array:
        """(k,) the direction along which a part is farthest near a point (N,): rotations are farthest where they agree.

        Places are not: how far slides are out, and where floating bodies are, has no part in it.
        """
        direction = np.array(x)
        for k, slide in self._lift.slides.items():
            direction[slide.start : slide.start + self._lift.slide_size(k)] = 0.0
        for at in self._lift.floating.values():
            direction[at : at + 3] = 0.0
        return direction[part.columns]

    def _configurations(self) -> tuple[Array, Array, Array]:
        """Random configurations with links placed, floating bodies where the first tie to each has them."""
        mechanism = self._lift.mechanism
        q = np.stack([random_configuration(mechanism, self._rng) for _ in range(DRAWN)])
        R, p = place_many(mechanism, q)
        for k in self._lift.floating:
            tie = _tie_of(mechanism, k)
            if tie is None:
                continue
            (own, F), (other, G) = tie
            there = R[:, other] @ G + p[:, other]
            at = mechanism.value_slices[k].start
            q[:, at : at + 3] = there - R[:, own] @ F
            R, p = place_many(mechanism, q)
        return q, R, p


def loose(problem: MechanismProblem) -> list[int]:
    """Free joints whose bodies neither ties nor goals keep within reach of the world."""
    reach = Graph.of(problem, asked_for(problem)).reach
    return [
        k
        for k, joint in enumerate(problem.mechanism.joints)
        if joint.kind == "free" and not np.isfinite(reach[k + 1])
    ]


def _tie_of(mechanism: Mechanism, free: int) -> tuple[tuple[int, Array], tuple[int, Array]] | None:
    """(link, point) of a floating body, and of what it is tied to first that it does not carry; None: nothing."""
    for closure in mechanism.closures:
        for own, other in ((0, 1), (1, 0)):
            links = closure.links
            if links[own] == free + 1 and not mechanism.ancestors[links[other], free]:
                points = closure.frames[own].position, closure.frames[other].position
                return (links[own], points[0]), (links[other], points[1])
    return None
