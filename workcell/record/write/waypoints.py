"""The configurations that a robot's queries answered, and which of them it is at while it moves."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from workcell.geometry.types import SphereCover
from workcell.pose import Array

OFF_WAY = 0.01
"""Radians or metres of a joint by which a robot on a way may be off the straight line between two waypoints."""
_ALIKE = 1e-3
"""Stretches whose distances differ by less are equally near: a way in and the same way back out are."""
_SAME = 1e-9


@dataclass(frozen=True, slots=True)
class Waypoint:
    """One answered configuration.

    Attributes:
        what: the name of the way or the goal that was asked for.
        by: who answered.
        q: (n,).
        before: (n,) the configuration from which a step was asked for; `q` itself where there was none.
        cover: spheres in link frames that the query was about.
        solids: (m,) by sphere the number of the cuboid or polytope that the solver had it in, -1: in none; None: the
            answer was not found among cuboids.
    """

    what: str
    by: str
    q: Array
    before: Array
    cover: SphereCover | None
    solids: NDArray[np.int64] | None


class Waypoints:
    """All of one robot, in the order of the answers."""

    def __init__(self) -> None:
        self._all: list[Waypoint] = []
        self._begins: list[int] = []
        self._latest: dict[bytes, int] = {}
        self._stretch, self._share, self._direction, self._furthest = 0, 0.0, 0, -1

    def add(self, waypoint: Waypoint) -> None:
        """One more; steps begin at an earlier one, or where none was answered."""
        number = len(self._all)
        self._begins.append(self._latest.get(waypoint.before.tobytes(), number))
        self._latest[waypoint.q.tobytes()] = number
        self._all.append(waypoint)

    def along(self, q: Array) -> list[Waypoint | None]:
        """For each of some configurations (T, n), one after the other, the waypoint that is nearest on its way.

        None: it is on none of the stretches between waypoints, as in a joint motion between two ways.
        """
        if not self._all:
            return [None] * len(q)
        ends = np.array([waypoint.q for waypoint in self._all])
        begins = np.array([waypoint.before for waypoint in self._all])
        stretch = ends - begins
        length = np.linalg.norm(stretch, axis=1)
        square = np.maximum(length**2, 1e-300)
        from_begin = q[:, None] - begins
        share = np.clip(np.einsum("tkn,kn->tk", from_begin, stretch) / square, 0.0, 1.0)
        off = np.abs(from_begin - share[..., None] * stretch).max(axis=2)
        near = off <= np.minimum(off.min(axis=1, keepdims=True) + _ALIKE, OFF_WAY)
        found: list[Waypoint | None] = [None] * len(q)
        for row in np.flatnonzero(near.any(axis=1)).tolist():
            k = self._go_on(np.flatnonzero(near[row]), share[row], length)
            at_end = share[row, k] >= 0.5 or length[k] < _SAME
            found[row] = self._all[k if at_end else self._begins[k]]
        return found

    def _go_on(self, alike: NDArray[np.int64], share: Array, length: Array) -> int:
        """Of stretches that are equally near, the one that a motion is on that does not turn round.

        A way is executed as it was planned, or backwards all of it; what was planned later is executed later. Where all
        would turn round, a way begins that the motion has not been on yet.
        """
        last, moved = self._stretch, length * (share - self._share)
        goes_on = self._direction * (alike - last) > 0
        goes_on |= (alike == last) & (self._direction * moved[alike] > -_ALIKE)
        fresh = alike[alike > self._furthest]
        if self._direction == 0 or goes_on.any():
            able = alike if self._direction == 0 else alike[goes_on]
            k = int(able[np.abs(able - last).argmin()])
        else:
            k = int(fresh[0] if len(fresh) else alike[np.abs(alike - last).argmin()])
        self._furthest = max(self._furthest, k)
        if k != last:
            self._direction = 1 if self._begins[k] == last else -1 if self._begins[last] == k else 0
        elif abs(moved[k]) >= _ALIKE:
            self._direction = 1 if moved[k] > 0 else -1
        else:
            return k  # its share is kept, so that slow motions add up
        self._stretch, self._share = k, float(share[k])
        return k
