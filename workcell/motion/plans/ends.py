"""Starts and goals of a motion: whether they may be one, and the nearest configuration that may."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike

from workcell.errors import InputError
from workcell.ik.problem import Clearance
from workcell.model.robot import Robot
from workcell.motion.body import Upright
from workcell.pose import Array

_DIFFERENCE = 1e-4
"""Joint step of finite differences of the clearance."""
_CLIMBS, _LONGEST = 40, 0.2
"""Steps of the climb out of a collision, and the longest of them (radians)."""
_DRAWS, _RADII = 40, (0.1, 0.2, 0.4, 0.8, 1.6)
"""Random configurations looked at within each distance, where the climb gets stuck."""
_ROUNDS, _NEARER = 12, 0.95
"""Rounds of draws for a nearer one, and the share of the distance so far that it must be within."""


def checked_end(
    robot: Robot,
    q: ArrayLike,
    clearance: Callable[[Array], Clearance],
    where: str,
    *,
    upright: Upright | None = None,
    wanted: float = 0.0,
) -> tuple[Array, float]:
    """A configuration (n,) where a motion may begin or end, and its clearance in metres.

    Raises:
        InputError: wrong size, not finite, outside the joint limits, in collision (which pair, how deep, and the
            nearest free configuration that was found), or tilted beyond `upright`.
    """
    values = robot.configuration(np.asarray(q, dtype=float), where=where)
    robot.check_limits(values, where=where)
    found = clearance(values)
    if not found.distance >= 0:
        first, second = found.pair
        free = nearest_free(
            robot,
            values,
            lambda q: clearance(q).distance,
            wanted=max(wanted, 1e-3),
            allowed=None if upright is None else lambda q: upright.kept(robot, q),
        )
        raise InputError(
            f"{robot.name} collides there: {first} and {second} overlap by {-1e3 * found.distance:.2f} mm",
            where=where,
            remedy=_advice(values, free),
        )
    if upright is not None and not upright.kept(robot, values):
        raise InputError(
            f"the tool is tilted by {upright.tilt(robot, values):.3f} rad there, and may be by {upright.angle:.3f}",
            where=where,
            remedy="choose a configuration with the tool upright, or allow a larger angle",
        )
    return values, found.distance


def _advice(q: Array, free: Array | None) -> str:
    if free is None:
        return "choose a configuration that is free of collisions; none was found near by"
    listed = ", ".join(f"{value:.4f}" for value in free)
    return f"a free configuration {np.abs(free - q).max():.3f} rad away: [{listed}]"


def nearest_free(
    robot: Robot,
    q: Array,
    clearance: Callable[[Array], float],
    *,
    wanted: float = 1e-3,
    allowed: Callable[[Array], bool] | None = None,
    seed: int = 0,
) -> Array | None:
    """A configuration near q (n,), within the limits, with a clearance of `wanted` metres; None: none was found.

    Climbs the gradient of the clearance, else draws at random from growing boxes; then draws from smaller and smaller
    boxes as long as that finds nearer ones, each moved back towards q as far as the clearance lasts. What is returned
    was looked at. It is near (largest change of a joint), not proved nearest.

    Args:
        allowed: what else it must meet; None: nothing.
    """
    free = _Free(clearance, wanted, allowed)
    rng = np.random.default_rng(seed)
    found = _climb(robot, q, free)
    if found is None:
        found = _drawn(robot, q, free, rng)
    if found is None:
        return None
    found = _moved_back(q, found, free)
    for _ in range(_ROUNDS):
        nearer = _drawn_within(robot, q, _NEARER * float(np.abs(found - q).max()), free, rng)
        if nearer is None:
            break
        found = _moved_back(q, nearer, free)
    return found


@dataclass(frozen=True, slots=True)
class _Free:
    """What a free configuration meets."""

    clearance: Callable[[Array], float]
    wanted: float
    allowed: Callable[[Array], bool] | None

    def __call__(self, q: Array) -> bool:
        return self.clearance(q) >= self.wanted and (self.allowed is None or self.allowed(q))


def _moved_back(q: Array, free: Array, meets: _Free) -> Array:
    """The free configuration nearest to q on the line from another free one, by bisection."""
    near, far = 0.0, 1.0
    for _ in range(12):
        middle = 0.5 * (near + far)
        if meets(q + middle * (free - q)):
            far = middle
        else:
            near = middle
    nearest: Array = q + far * (free - q)
    return nearest


def _climb(robot: Robot, q: Array, free: _Free) -> Array | None:
    here, value = np.clip(q, robot.lower, robot.upper), free.clearance(q)
    for _ in range(_CLIMBS):
        if value >= free.wanted:
            return here if free(here) else None
        gradient = np.zeros(len(here))
        for k in range(len(here)):
            moved = here.copy()
            step = _DIFFERENCE if here[k] + _DIFFERENCE <= robot.upper[k] else -_DIFFERENCE
            moved[k] += step
            gradient[k] = (free.clearance(moved) - value) / step
        square = float(gradient @ gradient)
        if square < 1e-12:
            return None
        move = gradient * (1.5 * (free.wanted - value) / square)
        move *= min(1.0, _LONGEST / max(float(np.abs(move).max()), 1e-12))
        here = np.clip(here + move, robot.lower, robot.upper)
        value = free.clearance(here)
    return here if free(here) else None


def _drawn(robot: Robot, q: Array, free: _Free, rng: np.random.Generator) -> Array | None:
    for radius in _RADII:
        found = _drawn_within(robot, q, radius, free, rng)
        if found is not None:
            return found
    return None


def _drawn_within(
    robot: Robot, q: Array, radius: float, free: _Free, rng: np.random.Generator
) -> Array | None:
    """A free one of `_DRAWS` in the box around q; every other draw is a corner of it, or the middle of a side."""
    draws = rng.uniform(-1, 1, (_DRAWS, len(q)))
    draws[::2] = np.round(1.5 * draws[::2])
    draws = np.clip(q + radius * np.clip(draws, -1, 1), robot.lower, robot.upper)
    for draw in draws[np.argsort(np.abs(draws - q).max(axis=1))]:
        if free(draw):
            return np.array(draw)
    return None
