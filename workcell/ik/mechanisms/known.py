"""What a question says of links before anything is solved: those that nothing moves, poses that goals fix."""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np

from workcell.ik.mechanisms.problem import MechanismTolerances
from workcell.model.mechanism.mechanism import Mechanism
from workcell.model.mechanism.placing import place
from workcell.pose import Array

SAME = 1e-9
"""Metres, or sine, below which points or directions are the same."""


@dataclass
class Known:
    """What is known of one link.

    Attributes:
        name: the link's.
        fixed: whether no joint moves it.
        rotation: (3, 3) in the world; None: unknown.
        by: what says so, for messages.
        points: places (3,) on the link, in the world, and what says so.
    """

    name: str
    fixed: bool = False
    rotation: Array | None = None
    by: str = ""
    points: list[tuple[Array, Array, str]] = field(default_factory=list)

    def world(self, local: Array) -> tuple[Array, float, str] | None:
        """Where a point (3,) of the link is, how far that is from a point that was given, and what says so."""
        for at, place_of, by in self.points:
            away = float(np.linalg.norm(local - at))
            if self.rotation is not None:
                return (
                    place_of + self.rotation @ (local - at),
                    away,
                    " and ".join(dict.fromkeys([self.by, by])),
                )
            if away < SAME:
                return place_of, 0.0, by
        return None

    def metres(self, lever: float, tolerances: MechanismTolerances) -> float:
        """How far a point may be from where `world` has it when what says so holds within tolerances."""
        return 0.0 if self.fixed else tolerances.position + lever * tolerances.rotation


def fixed_links(mechanism: Mechanism) -> dict[int, Known]:
    """Links that nothing moves: the world, and what hangs on it by hinges and slides that are held at one value."""
    held = {one.joint: float(one.coefficients[0]) for one in mechanism.followers if one.leader < 0}
    q, fixed = np.array(mechanism.home), [0]
    for k, joint in enumerate(mechanism.joints):
        if joint.kind in ("hinge", "slide") and joint.lower == joint.upper:
            held.setdefault(k, joint.lower)
        if k in held and joint.parent in fixed:
            q[mechanism.value_slices[k]] = held[k]
            fixed.append(k + 1)
    placed = place(mechanism, q)
    return {
        link: Known(
            mechanism.link_names[link],
            True,
            placed.R[link],
            "nothing moves it",
            [(np.zeros(3), placed.p[link], "nothing moves it")],
        )
        for link in fixed
    }
