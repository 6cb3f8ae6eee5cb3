"""`MechanismPath` and `MechanismMotion`: configurations of a whole mechanism one after the other, and over time."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from workcell.errors import InputError
from workcell.model.mechanism.following import Closed, close, given_rates
from workcell.model.mechanism.mechanism import Mechanism
from workcell.model.mechanism.placing import difference, moved, place
from workcell.pose import Array, quat_to_matrix, read_only, rotation_vector

_TIME_TOLERANCE = 1e-9
_SAME = 1e-9


@dataclass(frozen=True, slots=True)
class MechanismPath:
    """Configurations between which motors move straight, and all other joints as the ties have them.

    Attributes:
        mechanism: what moves.
        configurations: (k, size), k >= 2, read-only.

    Raises:
        InputError: fewer than two configurations, a wrong size, or not finite.
    """

    mechanism: Mechanism
    configurations: Array

    def __post_init__(self) -> None:
        q = np.asarray(self.configurations, dtype=float)
        if q.ndim != 2 or len(q) < 2 or q.shape[1] != self.mechanism.size or not np.all(np.isfinite(q)):
            raise InputError(
                f"a path of {self.mechanism.name} takes two or more rows of {self.mechanism.size} finite numbers",
                where="path",
            )
        object.__setattr__(self, "configurations", read_only(q))

    def __len__(self) -> int:
        return len(self.configurations)

    def __add__(self, other: MechanismPath) -> MechanismPath:
        """This path, then one that begins where this one ends."""
        gap = float(np.abs(difference(self.mechanism, self.end, other.start)).max())
        if self.mechanism is not other.mechanism or gap > _SAME:
            raise InputError(f"the second path begins {gap:.3g} away from the end of the first", where="path")
        return MechanismPath(self.mechanism, np.vstack([self.configurations, other.configurations[1:]]))

    @property
    def start(self) -> Array:
        """(size,) the first configuration."""
        return np.array(self.configurations[0])

    @property
    def end(self) -> Array:
        """(size,) the last configuration."""
        return np.array(self.configurations[-1])

    def reversed(self) -> MechanismPath:
        """The same path, travelled backwards."""
        return MechanismPath(self.mechanism, self.configurations[::-1])

    @property
    def steps(self) -> Array:
        """(k - 1, dof) tangents from each configuration to the next."""
        return tangents(self.mechanism, self.configurations)

    @property
    def largest_step(self) -> float:
        """Largest change of what motors move between neighbours, radians or metres."""
        return float(np.abs(self.steps[:, given_rates(self.mechanism)]).max(initial=0.0))

    @property
    def largest_link_rotation(self) -> float:
        """Largest change of any link's world rotation between neighbours (Frobenius norm; Eq. 75 of IKSPARK)."""
        R = np.array([place(self.mechanism, q).R for q in self.configurations])
        return float(np.linalg.norm(np.diff(R, axis=0), axis=(-2, -1)).max())

    def at(self, k: int, share: float) -> Closed:
        """The configuration a share of the way from the k-th to the next, its ties closed."""
        before, after = self.configurations[k], self.configurations[k + 1]
        step = share * difference(self.mechanism, before, after)
        return close(self.mechanism, moved(self.mechanism, before, step))


@dataclass(frozen=True, slots=True)
class MechanismMotion:
    """A mechanism's motion over time, sampled at a constant step.

    Attributes:
        mechanism: what moves.
        time: (T,) seconds, from 0, evenly spaced.
        q: (T, size) configurations; the ties hold in each of them.

    Raises:
        InputError: fewer than two samples, shapes that don't fit, uneven times, or not finite.
    """

    mechanism: Mechanism
    time: Array
    q: Array

    def __post_init__(self) -> None:
        for name in ("time", "q"):
            object.__setattr__(self, name, read_only(getattr(self, name)))
        if len(self.time) < 2 or self.q.shape != (len(self.time), self.mechanism.size):
            raise InputError(
                f"a motion takes two or more samples of {self.mechanism.size} numbers", where="motion"
            )
        if not (np.all(np.isfinite(self.q)) and np.all(np.isfinite(self.time))):
            raise InputError("a motion must be finite", where="motion")
        steps = np.diff(self.time)
        if not steps.min() > 0 or np.ptp(steps) > _TIME_TOLERANCE * max(1.0, self.time[-1]):
            raise InputError("a motion's time steps must be equal and positive", where="motion")

    def __len__(self) -> int:
        return len(self.time)

    @property
    def dt(self) -> float:
        """Seconds between samples."""
        return self.duration / (len(self.time) - 1)

    @property
    def duration(self) -> float:
        """Seconds from the first sample to the last."""
        return float(self.time[-1] - self.time[0])

    def rates(self) -> tuple[Array, Array]:
        """Velocities and accelerations (T, dof) that MuJoCo's semi-implicit integration takes from sample to sample.

        Backward differences of the positions, forward differences of those: at rest at both ends.
        """
        steps = tangents(self.mechanism, self.q) / self.dt
        rest = np.zeros((1, self.mechanism.dof))
        velocity = np.vstack([rest, steps])
        return velocity, np.vstack([np.diff(velocity, axis=0) / self.dt, rest])


def tangents(mechanism: Mechanism, q: Array) -> Array:
    """(k - 1, dof) what leads from each of some configurations (k, size) to the next in unit time."""
    found = np.zeros((len(q) - 1, mechanism.dof))
    for joint, at, rate in zip(mechanism.joints, mechanism.value_slices, mechanism.rate_slices, strict=True):
        steps = np.diff(q[:, at], axis=0)
        if joint.kind in ("hinge", "slide"):
            found[:, rate] = steps
            continue
        if joint.kind == "free":
            found[:, rate.start : rate.start + 3] = steps[:, :3]
        R = quat_to_matrix(q[:, at.stop - 4 : at.stop])
        found[:, rate.stop - 3 : rate.stop] = rotation_vector(np.swapaxes(R[:-1], -1, -2) @ R[1:])
    return found


def resting(mechanism: Mechanism, q: Array, seconds: float, dt: float) -> MechanismMotion:
    """Stand still at a configuration (size,)."""
    count = max(round(seconds / dt), 1) + 1
    return MechanismMotion(mechanism, dt * np.arange(count, dtype=float), np.tile(q, (count, 1)))
