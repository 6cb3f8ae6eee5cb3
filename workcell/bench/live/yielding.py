"""How what moves leaves arms a way out, decided before arms move, by their last configurations alone.

The way out that a mover leaves is to brake. Of going on as it likes, braking, and keeping its velocity it does the
first that keeps 3 cm from arms that brake, at all times until both are at rest, by the compiled model's distances.
Where none does, as when arms have come nearer by themselves, it does what keeps farthest; a way out is left where
that touches nothing. The arms' brake is the bench's own: the shortest polynomial within the joints' limits that ends
at rest.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from workcell.bench.live.contacts import Contacts
from workcell.bench.live.movers import Mover, arrived
from workcell.bench.live.traces import PERIOD
from workcell.pose import Array, Pose

ROOM = 0.03
"""Metres that a mover leaves to arms that brake."""
NEAR = 0.5
"""Metres from which on a mover looks: farther than both together go before they rest."""
_LOOKS = 2
"""Frames between two looks along a brake."""
_STUCK = 0.05
"""Chance that a mover that rests far from its aim takes another."""


class Yielding:
    """Moves movers around arms.

    Args:
        contacts: distances of the scene up to `NEAR`, without the arms' own.
        movers: who moves.
        aims: for each of them, where it may go, one after the other at random.
        acceleration, jerk: (n,) the arms' limits.
        rng: of the choices.
    """

    def __init__(
        self,
        contacts: Contacts,
        movers: Sequence[Mover],
        aims: Sequence[Sequence[Array]],
        acceleration: Array,
        jerk: Array,
        rng: np.random.Generator,
    ) -> None:
        self._contacts, self.movers, self._aims = contacts, list(movers), aims
        self._limits, self._rng = (acceleration, jerk), rng

    def places(self) -> dict[str, Pose]:
        """Where everything is now."""
        return {name: pose for mover in self.movers for name, pose in mover.bodies().items()}

    def twists(self) -> dict[str, tuple[Array, Array]]:
        """How everything moves now."""
        return {name: twist for mover in self.movers for name, twist in mover.twists().items()}

    def advance(self, past: Array) -> bool:
        """A frame goes by, for arms whose last four configurations are (4, n); whether a way out was left to them."""
        left = True
        self._contacts.place(self.places())
        if self._contacts.distance(past[-1]) >= NEAR:
            for mover in self.movers:
                mover.go(mover.liked())
        else:
            stop = brake(past, *self._limits)
            for mover in self.movers:
                left &= self._one(mover, stop)
        for mover, aims in zip(self.movers, self._aims, strict=True):
            stuck = np.linalg.norm(mover.rates) < 0.02 and self._rng.random() < _STUCK
            if arrived(mover) or stuck:
                mover.aim = aims[int(self._rng.integers(len(aims)))]
        return left

    def _one(self, mover: Mover, stop: Array) -> bool:
        best, chosen = -np.inf, mover.braked()
        for rates, goes_on in ((mover.liked(), False), (mover.braked(), False), (mover.rates, True)):
            least = self._least(mover, rates, goes_on, stop)
            if least > best:
                best, chosen = least, rates
            if best > ROOM:
                break
        mover.go(chosen)
        return best > 0.0

    def _least(self, mover: Mover, rates: Array, goes_on: bool, stop: Array) -> float:
        """Metres from arms that brake to a mover that brakes after this frame, or goes on until they rest."""
        ghost = mover.ghost()
        ghost.go(rates)
        k, least = 0, np.inf
        while True:
            last = k >= len(stop) - 1 and (goes_on or not ghost.rates.any())
            if k % _LOOKS == 0 or last:
                self._contacts.place(ghost.bodies())
                q = stop[min(k, len(stop) - 1)]
                least = min(least, *(self._contacts.distance_to(name, q) for name in ghost.bodies()))
            if last or least < 0.0:
                return least
            ghost.go(ghost.rates if goes_on else ghost.braked())
            k += 1


def brake(past: Array, acceleration: Array, jerk: Array) -> Array:
    """(k, n) the shortest stop, frame by frame, from the last four configurations (4, n), the latest last.

    Velocities are cubic polynomials of time that end at rest with no acceleration: the shortest of up to two seconds
    whose accelerations and jerks are within the limits; a state beyond them is let be.
    """
    _, old, last, q = past
    a = (q - 2.0 * last + old) / PERIOD**2
    v = (q - last) / PERIOD + 0.5 * PERIOD * a
    highest = np.maximum(acceleration, 1.05 * np.abs(a))
    for frames in range(2, 101):
        T = frames * PERIOD
        s = np.linspace(0.0, 1.0, frames + 1)[1:, None]
        # Hermite's polynomial of v and a where it begins, of zero where it ends
        rising = ((6 * s**2 - 6 * s) * v + (3 * s**2 - 4 * s + 1) * T * a) / T
        jerks = ((12 * s - 6) * v + (6 * s - 4) * T * a) / T**2
        if np.all(np.abs(rising) <= highest) and np.all(np.abs(jerks[:-1]) <= jerk):
            break
    moved = (0.5 * s**4 - s**3 + s) * v + (s**4 / 4 - 2 * s**3 / 3 + s**2 / 2) * T * a
    stop: Array = q + T * moved
    return stop
