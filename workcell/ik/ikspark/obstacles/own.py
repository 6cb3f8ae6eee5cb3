"""The robot's own spheres, kept apart by half-spaces: where two of them overlap, they are told a side each.

Two balls are apart exactly when there is a direction along which their centres are as far apart as their radii add up
to. Centres are affine in the lifted variables, so for a chosen direction that is one linear row. The paper leaves
self-collision out; like the planes of `half_spaces`, these rows cut off a part of the set, and no proof rests on them.

A row makes corners of the set that are of no rank 1, where ascents get stuck. So they begin along the rows, away from
those corners.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from workcell.ik.ikspark.instance import Instance
from workcell.ik.ikspark.obstacles.centres import all_maps
from workcell.ik.ikspark.search import Reached, Search
from workcell.ik.problem import IKProblem
from workcell.ik.shared.convex import KEEP_OFF
from workcell.pose import Array

SLOTS = 8
"""Rows that one restart may carry."""
MOST_TURNS = 1
"""Other sides that one restart tries, where rows have left nothing."""
GIVEN_AWAY = 0.5
"""Share of the spheres' overshoot that they may overlap by where a checker decides: the cover is larger than the
robot."""
PUSH = 2.0
"""How much of an ascent's first direction is along a row, against what it was to be."""
_STILL = 1e-9
"""Metres: coefficients below are none, and shorter vectors have no direction."""


@dataclass(frozen=True, slots=True, eq=False)
class _Pairs:
    """A problem's pairs of spheres in the relaxation's variables.

    Attributes:
        spheres: (p, 2) of the cover.
        needed: (p,) how far apart their centres have to be, metres.
        maps: (m, 3, N + 1) all spheres' centres over (x, 1).
        sides: (p, 3) from the second centre to the first where steps begin, or None.
    """

    spheres: NDArray[np.int64]
    needed: Array
    maps: Array
    sides: Array | None

    @staticmethod
    def of(instance: Instance) -> _Pairs | None:
        """Those of an instance's problem; None: there are none."""
        problem, cover = instance.problem, instance.problem.cover
        spheres = own_pairs(problem)
        if cover is None or not len(spheres):
            return None
        radius, sides = cover.radius, None
        if problem.checker is not None:
            radius = radius - GIVEN_AWAY * (radius - cover.bare_radius)
        if problem.max_step is not None and problem.q_reference is not None:
            there = cover.centres_world(problem.robot.link_transforms(problem.q_reference))
            sides = there[spheres[:, 0]] - there[spheres[:, 1]]
        needed = radius[spheres].sum(axis=1) + problem.tolerances.safety_margin
        return _Pairs(spheres, needed, all_maps(instance.lift, problem) @ instance.goal, sides)


class OwnSpheres:
    """What keeps a robot's own spheres apart over one restart. Nothing is computed before a point is to be cut off.

    Attributes:
        rows: (k, N + 1) over (x, 1), zero or more where the pairs that were met keep to their sides.
    """

    def __init__(self, search: Search, instance: Instance, *, asked: bool = True) -> None:
        """Prepare; where it is not `asked`, no pair is ever met."""
        self._search, self._instance = search, instance
        self.rows = np.zeros((0, instance.lift.size + 1))
        self._turns, self._cut = 0, (0, np.zeros(3))
        self._made: tuple[_Pairs | None] | None = None if asked else (None,)

    def restart(self) -> None:
        """Forget the rows."""
        self.rows, self._turns = self.rows[:0], 0

    def part(self, reached: Reached) -> bool:
        """Cut off where an ascent ended, if it is refused and spheres overlap there; False: nothing was cut off.

        It begins with a configuration: in a point that is none, spheres are nearer to each other than links bring them.
        """
        if reached.accepted or reached.x is None or (reached.q is None and not len(self.rows)):
            return False
        return self.cut(reached.x)

    def cut(self, x: Array) -> bool:
        """Add a row that the point x (N,) breaks, for the pair that overlaps most there; False: none does."""
        pairs = self._pairs()
        if pairs is None or len(self.rows) == SLOTS:
            return False
        at = pairs.maps[..., :-1] @ x + pairs.maps[..., -1]
        between = at[pairs.spheres[:, 0]] - at[pairs.spheres[:, 1]]
        gaps = np.linalg.norm(between, axis=1) - pairs.needed
        for k in np.argsort(gaps):
            if gaps[k] >= 0.0:
                return False
            side = between[k] if pairs.sides is None else pairs.sides[k]
            row = _row(pairs, int(k), side)
            if row is not None:
                self._cut = int(k), side
                self._add(row)
                return True
        return False

    def turn(self) -> bool:
        """Another side for the pair that was met last, where its row has left nothing; False: enough of that.

        Steps have no other: what a small step takes to the other side of a sphere has come through it.
        """
        if not len(self.rows) or self._turns == MOST_TURNS:
            return False
        pairs = self._pairs()
        assert pairs is not None  # there are rows
        if pairs.sides is not None:
            return False
        self._turns += 1
        k, side = self._cut
        row = _row(pairs, k, _unit(side) + _unit(self._search.rng.standard_normal(3)))
        if row is None:
            return False
        self.rows = self.rows[:-1]
        self._add(row)
        return True

    def pushed(self, direction: Array) -> Array:
        """A direction (N,) to ascend in, turned to where the pairs that were met part; without rows it stays."""
        towards = self.rows[:, :-1]
        if not len(towards):
            return direction
        lengths = np.linalg.norm(towards, axis=1, keepdims=True)
        turned: Array = direction + PUSH * np.linalg.norm(direction) * (towards / lengths).sum(axis=0)
        return turned

    def _add(self, row: Array) -> None:
        self.rows = np.vstack([self.rows, row])
        self._search.stats["own_rows"] += 1
        self._search.stages.add("own spheres", note=f"{len(self.rows)} pairs are told their sides")

    def _pairs(self) -> _Pairs | None:
        if self._made is None:
            self._made = (_Pairs.of(self._instance),)
        return self._made[0]


def own_pairs(problem: IKProblem) -> NDArray[np.int64]:
    """(p, 2) spheres of the cover that must keep clear of each other.

    Where the problem names none and its checker knows which links it looks at, they are those of such links, less those
    that touch where the checker finds nothing against the robot: the cover's overshoot.
    """
    if problem.self_collision is not None:
        return problem.self_collision
    ask = getattr(problem.checker, "self_pairs", None)
    if ask is None or problem.checker is None or problem.cover is None:
        return np.zeros((0, 2), dtype=np.int64)
    known = [q for q in (problem.robot.home, problem.q_reference, problem.q_near) if q is not None]
    free = [q for q in np.unique(known, axis=0) if problem.checker(q).distance > 0.0]
    pairs: NDArray[np.int64] = ask(problem.robot, problem.cover, np.stack(free) if free else None)
    return pairs


def _row(pairs: _Pairs, k: int, side: Array) -> Array | None:
    """Pair k on two sides of a slab across `side` (3,); None where the two don't move against each other."""
    one, two = pairs.spheres[k]
    row: Array = _unit(side) @ (pairs.maps[one] - pairs.maps[two])
    if not np.any(np.abs(row[:-1]) > _STILL):
        return None
    row[-1] -= pairs.needed[k] + KEEP_OFF
    return row


def _unit(vector: Array) -> Array:
    length = float(np.linalg.norm(vector))
    unit: Array = vector / length if length > _STILL else np.array([0.0, 0.0, 1.0])
    return unit
