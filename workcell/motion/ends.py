"""Starts and goals of a motion: whether they may be one, and the nearest configuration that may where they may not."""

from __future__ import annotations

from collections.abc import Callable

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
        free = nearest_free(robot, values, lambda q: clearance(q).distance, wanted=max(wanted, 1e-3))
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
    robot: Robot, q: Array, clearance: Callable[[Array], float], *, wanted: float = 1e-3, seed: int = 0
) -> Array | None:
    """A configuration near q (n,) with a clearance of `wanted` metres; None where none was found.

    Climbs the gradient of the clearance, else draws at random from growing boxes; what it finds is then moved back
    towards q as far as the clearance lasts. It is near, not proved nearest.
    """
    free = _climb(robot, q, clearance, wanted)
    if free is None:
        free = _drawn(robot, q, clearance, wanted, np.random.default_rng(seed))
    if free is None:
        return None
    near, far = 0.0, 1.0
    for _ in range(12):
        middle = 0.5 * (near + far)
        if clearance(q + middle * (free - q)) >= wanted:
            far = middle
        else:
            near = middle
    nearest: Array = q + far * (free - q)
    return nearest


def _climb(robot: Robot, q: Array, clearance: Callable[[Array], float], wanted: float) -> Array | None:
    here, value = np.clip(q, robot.lower, robot.upper), clearance(q)
    for _ in range(_CLIMBS):
        if value >= wanted:
            return here
        gradient = np.zeros(len(here))
        for k in range(len(here)):
            moved = here.copy()
            step = _DIFFERENCE if here[k] + _DIFFERENCE <= robot.upper[k] else -_DIFFERENCE
            moved[k] += step
            gradient[k] = (clearance(moved) - value) / step
        square = float(gradient @ gradient)
        if square < 1e-12:
            return None
        move = gradient * (1.5 * (wanted - value) / square)
        move *= min(1.0, _LONGEST / max(float(np.abs(move).max()), 1e-12))
        here = np.clip(here + move, robot.lower, robot.upper)
        value = clearance(here)
    return here if value >= wanted else None


def _drawn(
    robot: Robot, q: Array, clearance: Callable[[Array], float], wanted: float, rng: np.random.Generator
) -> Array | None:
    for radius in _RADII:
        draws = np.clip(q + rng.uniform(-radius, radius, (_DRAWS, len(q))), robot.lower, robot.upper)
        for draw in draws[np.argsort(np.abs(draws - q).max(axis=1))]:
            if clearance(draw) >= wanted:
                return np.array(draw)
    return None
