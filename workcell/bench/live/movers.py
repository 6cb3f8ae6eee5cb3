"""What moves in a cell of the live guards: shapes that wander, and arms of three capsules that reach about."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field
from typing import Protocol, Self

import numpy as np

from workcell.bench.live.traces import PERIOD
from workcell.pose import Array, Pose, axis_angle_to_matrix, rotation_vector

FASTEST, HASTE = 0.5, 1.5
"""Metres a second, and per second squared, of a shape at most."""
SPIN, SPIN_HASTE = 1.0, 4.0
"""Radians a second, and per second squared."""
REACHING, REACHING_HASTE = 0.5, 1.5
"""The same of a reaching arm's joints, together."""
_CLOSE = 0.02
"""Metres or radians from an aim that count as there."""
_X, _Y, _Z = np.eye(3)


class Mover(Protocol):
    """What moves at bounded rates, that change boundedly; aims come from outside.

    Attributes:
        rates: its velocities now.
        aim: where it is going.
    """

    rates: Array
    aim: Array

    def bodies(self) -> dict[str, Pose]:
        """Where its objects are, by name."""

    def twists(self) -> dict[str, tuple[Array, Array]]:
        """Their velocities (3,) and (3,), metres and radians a second in the world."""

    def liked(self) -> Array:
        """Rates at a frame's end, on the way to its aim."""

    def braked(self) -> Array:
        """Rates at a frame's end, as near to rest as can be."""

    def go(self, rates: Array) -> None:
        """A frame goes by, in which the rates become these, evenly."""

    def ghost(self) -> Self:
        """A copy that may go on alone."""

    def left(self) -> float:
        """Metres, or radians, to its aim."""


@dataclass(slots=True)
class Wanderer:
    """A shape on its way from one place to the next, turning as it likes.

    Attributes:
        name: of its object.
        pose: where it is.
        aim: (3,) where it is going.
        pace: metres a second that it likes; turning: (3,) and the spin.
        rates: (6,) metres and radians a second.
    """

    name: str
    pose: Pose
    aim: Array
    pace: float
    turning: Array
    rates: Array = field(default_factory=lambda: np.zeros(6))

    def bodies(self) -> dict[str, Pose]:
        """See `Mover`."""
        return {self.name: self.pose}

    def twists(self) -> dict[str, tuple[Array, Array]]:
        """See `Mover`."""
        return {self.name: (self.rates[:3], self.rates[3:])}

    def liked(self) -> Array:
        """See `Mover`."""
        wanted = _on_the_way(self.aim - self.pose.position, self.pace, HASTE)
        return self._towards(wanted, self.turning)

    def braked(self) -> Array:
        """See `Mover`."""
        return self._towards(np.zeros(3), np.zeros(3))

    def _towards(self, velocity: Array, spin: Array) -> Array:
        parts = towards(self.rates[:3], velocity, HASTE), towards(self.rates[3:], spin, SPIN_HASTE)
        return np.concatenate(parts)

    def go(self, rates: Array) -> None:
        """See `Mover`."""
        mean = 0.5 * (self.rates + rates) * PERIOD
        self.pose = Pose.from_rotation(self.pose.position + mean[:3], _turn(mean[3:]) @ self.pose.rotation)
        self.rates = rates

    def ghost(self) -> Wanderer:
        """See `Mover`."""
        return Wanderer(self.name, self.pose, self.aim, self.pace, self.turning, self.rates)

    def left(self) -> float:
        """See `Mover`."""
        return float(np.linalg.norm(self.aim - self.pose.position))


@dataclass(slots=True)
class Reacher:
    """An arm of capsules, one on the end of the other, that reaches from one configuration to the next.

    Attributes:
        names: of its capsules' objects, from the base on; each lies along the z axis of its object.
        base: (3,) where it stands.
        lengths: (k,) of the capsules, metres.
        pace: radians a second that it likes.
        q: (k + 1,) about the vertical, and then the bend of each capsule to the one before; all zero: upright.
        rates: (k + 1,) radians a second.
    """

    names: Sequence[str]
    base: Array
    lengths: Array
    pace: float
    q: Array
    aim: Array
    rates: Array

    def bodies(self) -> dict[str, Pose]:
        """See `Mover`."""
        return dict(zip(self.names, _links(self.base, self.lengths, self.q), strict=True))

    def twists(self) -> dict[str, tuple[Array, Array]]:
        """See `Mover`; by central differences."""
        h = 1e-5
        before, after = (_links(self.base, self.lengths, self.q + sign * h * self.rates) for sign in (-1, 1))
        return {
            name: (
                (b.position - a.position) / (2.0 * h),
                rotation_vector(b.rotation @ a.rotation.T) / (2.0 * h),
            )
            for name, a, b in zip(self.names, before, after, strict=True)
        }

    def liked(self) -> Array:
        """See `Mover`."""
        return towards(self.rates, _on_the_way(self.aim - self.q, self.pace, REACHING_HASTE), REACHING_HASTE)

    def braked(self) -> Array:
        """See `Mover`."""
        return towards(self.rates, np.zeros(len(self.q)), REACHING_HASTE)

    def go(self, rates: Array) -> None:
        """See `Mover`."""
        self.q = self.q + 0.5 * (self.rates + rates) * PERIOD
        self.rates = rates

    def ghost(self) -> Reacher:
        """See `Mover`."""
        return Reacher(self.names, self.base, self.lengths, self.pace, self.q, self.aim, self.rates)

    def left(self) -> float:
        """See `Mover`."""
        return float(np.linalg.norm(self.aim - self.q))


def arrived(mover: Mover) -> bool:
    """Whether it is where it wanted to be."""
    return mover.left() < _CLOSE


def towards(now: Array, wanted: Array, haste: float) -> Array:
    """As near to wanted rates as a frame's acceleration allows."""
    change = wanted - now
    size, most = float(np.linalg.norm(change)), haste * PERIOD
    return np.array(wanted if size <= most else now + change * (most / size))


def _on_the_way(away: Array, pace: float, haste: float) -> Array:
    """Rates towards what is so far away, from which it can still stop there."""
    far = float(np.linalg.norm(away))
    return away * (min(pace, np.sqrt(1.2 * haste * far)) / far) if far > 1e-9 else np.zeros(len(away))


def _turn(vector: Array) -> Array:
    angle = float(np.linalg.norm(vector))
    turned: Array = axis_angle_to_matrix(vector / angle, angle) if angle > 1e-12 else np.eye(3)
    return turned


def _links(base: Array, lengths: Array, q: Array) -> list[Pose]:
    R, end, found = _turn(q[0] * _Z), base, []
    for length, bend in zip(lengths, q[1:], strict=True):
        R = R @ _turn(bend * _Y)
        found.append(Pose.from_rotation(end + 0.5 * length * R[:, 2], R))
        end = end + length * R[:, 2]
    return found
