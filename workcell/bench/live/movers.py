"""What moves in a cell of the live guards, and how it leaves the arms a way out.

A mover wanders at bounded speed and acceleration. At the beginning of a frame it looks at the arms, by their last
configurations alone: the way out that it leaves them is to brake. Of going on as it likes, braking, and keeping its
velocity it does the first that keeps 3 cm from arms that brake, at all times until both are at rest, by the compiled
model's distances. Where none does, as when arms have come nearer by themselves, it does what keeps farthest; a way out
is left where that touches nothing. The arms' brake is the bench's own: the shortest polynomial within the joints'
limits that ends at rest.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace

import numpy as np

from workcell.bench.live.contacts import Contacts
from workcell.bench.live.traces import PERIOD
from workcell.pose import Array, Pose, axis_angle_to_matrix

FASTEST, HASTE = 0.5, 1.5
"""Metres a second, and per second squared, of a mover at most."""
SPIN, SPIN_HASTE = 1.0, 4.0
"""Radians a second, and per second squared."""
ROOM = 0.03
"""Metres that a mover leaves to arms that brake."""
_NEAR = 0.45
"""Metres from which on a mover looks: farther than both together go before they rest."""
_LOOKS = 2
"""Frames between two looks along a brake."""


@dataclass(slots=True)
class Mover:
    """A mover's state.

    Attributes:
        name: of its object.
        pose: where it is.
        velocity, spin: (3,) and (3,) metres and radians a second, now.
        aim: (3,) where it is going.
        pace: metres a second that it likes; turning: (3,) and the spin.
    """

    name: str
    pose: Pose
    aim: Array
    pace: float
    turning: Array
    velocity: Array = field(default_factory=lambda: np.zeros(3))
    spin: Array = field(default_factory=lambda: np.zeros(3))

    def liked(self) -> tuple[Array, Array]:
        """Velocity and spin of the next frame's end, on the way to its aim."""
        away = self.aim - self.pose.position
        far = float(np.linalg.norm(away))
        # so that it can still stop there
        fast = min(self.pace, np.sqrt(1.2 * HASTE * far))
        wanted = away * (fast / far) if far > 1e-9 else np.zeros(3)
        return _towards(self.velocity, wanted, HASTE), _towards(self.spin, self.turning, SPIN_HASTE)

    def braked(self) -> tuple[Array, Array]:
        """Velocity and spin of the next frame's end, as near to rest as can be."""
        return _towards(self.velocity, np.zeros(3), HASTE), _towards(self.spin, np.zeros(3), SPIN_HASTE)

    def after(self, velocity: Array, spin: Array, seconds: float = PERIOD) -> Pose:
        """Where it is when its velocities have become these, evenly."""
        turn = 0.5 * seconds * (self.spin + spin)
        angle = float(np.linalg.norm(turn))
        R = axis_angle_to_matrix(turn / angle, angle) if angle > 1e-12 else np.eye(3)
        position = self.pose.position + 0.5 * seconds * (self.velocity + velocity)
        return Pose.from_rotation(position, R @ self.pose.rotation)

    def go(self, velocity: Array, spin: Array) -> None:
        """A frame goes by."""
        self.pose = self.after(velocity, spin)
        self.velocity, self.spin = velocity, spin


def _towards(now: Array, wanted: Array, haste: float) -> Array:
    """As near to a velocity as a frame's acceleration allows."""
    change = wanted - now
    size, most = float(np.linalg.norm(change)), haste * PERIOD
    reached: Array = wanted if size <= most else now + change * (most / size)
    return np.array(reached)


def brake(past: Array, acceleration: Array, jerk: Array) -> Array:
    """(k, n) the shortest stop, frame by frame, from the last four configurations (4, n), the latest last.

    Velocities are cubic polynomials of time that end at rest with no acceleration. The shortest of up to two seconds
    whose accelerations and jerks are within the limits; limits that the state itself is outside of are not asked for.
    """
    _, old, last, q = past
    a = (q - 2.0 * last + old) / PERIOD**2
    v = (q - last) / PERIOD + 0.5 * PERIOD * a
    highest = np.maximum(acceleration, 1.05 * np.abs(a))
    for frames in range(2, 101):
        T = frames * PERIOD
        s = np.linspace(0.0, 1.0, frames + 1)[1:, None]
        # v(s) = v h00 + T a h10, Hermite's; its derivatives over T
        rising = ((6 * s**2 - 6 * s) * v + (3 * s**2 - 4 * s + 1) * T * a) / T
        if np.all(np.abs(rising) <= highest):
            jerks = ((12 * s - 6) * v + (6 * s - 4) * T * a) / T**2
            if np.all(np.abs(jerks[:-1]) <= jerk):
                break
    moved = (0.5 * s**4 - s**3 + s) * v + (s**4 / 4 - 2 * s**3 / 3 + s**2 / 2) * T * a
    stop: Array = q + T * moved
    return stop


class Crowding:
    """Moves movers around arms.

    Args:
        contacts: distances of the scene, without the arms' own.
        movers: who moves.
        acceleration, jerk: (n,) the arms' limits.
        somewhere: makes the next place to go to.
    """

    def __init__(
        self,
        contacts: Contacts,
        movers: Sequence[Mover],
        acceleration: Array,
        jerk: Array,
        rng: np.random.Generator,
        aims: Sequence[Array],
    ) -> None:
        self._contacts, self.movers = contacts, list(movers)
        self._limits, self._rng, self._aims = (acceleration, jerk), rng, list(aims)

    def advance(self, past: Array) -> bool:
        """A frame goes by, for arms whose last four configurations are (4, n); whether a way out was left to them."""
        before = {mover.name: mover.pose for mover in self.movers}
        left = True
        self._contacts.place(before)
        if self._contacts.distance(past[-1]) >= _NEAR:
            for mover in self.movers:
                mover.go(*mover.liked())
        else:
            stop = brake(past, *self._limits)
            for mover in self.movers:
                left &= self._one(mover, stop)
        for mover in self.movers:
            arrived = np.linalg.norm(mover.aim - mover.pose.position) < 0.02
            stuck = np.linalg.norm(mover.velocity) < 0.02 and self._rng.random() < 0.05
            if arrived or stuck:
                mover.aim = self._aims[int(self._rng.integers(len(self._aims)))]
        return left

    def _one(self, mover: Mover, stop: Array) -> bool:
        best, chosen = -np.inf, mover.braked()
        for velocity, spin, goes_on in (
            (*mover.liked(), False),
            (*mover.braked(), False),
            (mover.velocity, mover.spin, True),
        ):
            least = self._least(mover, velocity, spin, goes_on, stop)
            if least > best:
                best, chosen = least, (velocity, spin)
            if best > ROOM:
                break
        mover.go(*chosen)
        return best > 0.0

    def _least(self, mover: Mover, velocity: Array, spin: Array, goes_on: bool, stop: Array) -> float:
        """Metres from arms that brake to a mover that brakes after this frame, or goes on until they rest."""
        ghost = replace(mover)
        ghost.go(velocity, spin)
        k, least = 0, np.inf
        while True:
            moving = not goes_on and bool(ghost.velocity.any() or ghost.spin.any())
            last = k >= len(stop) - 1 and not moving
            if k % _LOOKS == 0 or last:
                self._contacts.place({ghost.name: ghost.pose})
                least = min(least, self._contacts.distance_to(ghost.name, stop[min(k, len(stop) - 1)]))
            if last or least < 0.0:
                return least
            ghost.go(*((ghost.velocity, ghost.spin) if goes_on else ghost.braked()))
            k += 1

    def places(self) -> Mapping[str, Pose]:
        """Where everything is now."""
        return {mover.name: mover.pose for mover in self.movers}
