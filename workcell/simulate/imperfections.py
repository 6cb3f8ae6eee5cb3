"""What a real cell has and a perfect simulation lacks: wrong masses, noisy sensors, pushes. All seeded."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass

import numpy as np

from workcell.errors import InputError
from workcell.pose import Array


@dataclass(frozen=True, slots=True)
class Pulse:
    """A push: a constant force on a body's centre of mass for a while.

    Attributes:
        body: the body's name in the compiled model, e.g. `sawyer/right_l6`.
        force: (3,) newtons, world frame.
        start, duration: simulated seconds.
    """

    body: str
    force: tuple[float, float, float]
    start: float
    duration: float

    def __post_init__(self) -> None:
        if len(self.force) != 3 or not np.all(np.isfinite(self.force)):
            raise InputError(f"the force of a pulse is {self.force}", where="pulse", remedy="three newtons")
        if not (self.duration > 0 and self.start >= 0):
            raise InputError(
                f"a pulse of {self.duration} s from {self.start} s",
                where="pulse",
                remedy="a duration above zero, from zero or later",
            )


@dataclass(frozen=True, slots=True)
class Imperfections:
    """How the simulated cell differs from what the controller believes and is told. The default is a perfect cell.

    Attributes:
        payload_error: the controller believes a held object to have (1 + this) times its mass and inertia.
        link_error: it believes each link to have its mass and inertia times a factor, drawn once from 1 +- this.
        noise_q, noise_qd: standard deviations of the measured joint positions and velocities (radians, radians a
            second; metres for slides), white, drawn at every control step.
        pulses: pushes.
        seed: of everything that is drawn.
    """

    payload_error: float = 0.0
    link_error: float = 0.0
    noise_q: float = 0.0
    noise_qd: float = 0.0
    pulses: tuple[Pulse, ...] = ()
    seed: int = 0

    def __post_init__(self) -> None:
        if not (self.payload_error > -1.0 and 0.0 <= self.link_error < 1.0):
            raise InputError(
                f"a payload error of {self.payload_error} and a link error of {self.link_error}",
                where="imperfections",
                remedy="payload_error above -1, link_error in [0, 1): masses stay positive",
            )
        if not (self.noise_q >= 0 and self.noise_qd >= 0):
            raise InputError("noise is a standard deviation: zero or more", where="imperfections")

    def link_factors(self, bodies: Iterable[int]) -> dict[int, float]:
        """By what factor the mass of each body is misjudged; the same for a seed, whatever was drawn before."""
        ids = sorted(bodies) if self.link_error else []
        drawn = np.random.default_rng(self.seed).uniform(-self.link_error, self.link_error, len(ids))
        return {body: 1.0 + float(error) for body, error in zip(ids, drawn, strict=True)}

    def sensed(self, q: Array, qd: Array, rng: np.random.Generator) -> tuple[Array, Array]:
        """(n,) positions and velocities as a sensor reports them."""
        if self.noise_q:
            q = q + rng.normal(scale=self.noise_q, size=q.shape)
        if self.noise_qd:
            qd = qd + rng.normal(scale=self.noise_qd, size=qd.shape)
        return q, qd
