"""Whole turns of joints: the nearest that the limits allow, and the others in order."""

from __future__ import annotations

import itertools
from typing import NamedTuple

import numpy as np
from numpy.typing import ArrayLike, NDArray

from workcell.pose import Array

_TURN = 2 * np.pi
_ROUNDING = 1e-12
"""Radians."""


class Room(NamedTuple):
    """Limits (n,) of variables, which of them are where they were after a whole turn, and the limits' slack."""

    lower: Array
    upper: Array
    repeats: NDArray[np.bool_]
    slack: float

    def holds(self, q: Array) -> NDArray[np.bool_]:
        """(..., n) whether values are within the limits, with slack."""
        inside: NDArray[np.bool_] = (q >= self.lower - self.slack) & (q <= self.upper + self.slack)
        return inside

    def allowed(self, q: Array) -> tuple[Array, Array]:
        """The least and the largest number of whole turns (..., n) by which angles stay in their limits.

        An angle that is inside with slack may stay; a turn has to end inside but for rounding.
        """
        least = np.ceil((self.lower - _ROUNDING - q) / _TURN)
        most = np.floor((self.upper + _ROUNDING - q) / _TURN)
        stays = self.holds(q)
        return np.where(stays, np.minimum(least, 0.0), least), np.where(stays, np.maximum(most, 0.0), most)


def nearest_turn(room: Room, q: ArrayLike, centre: Array) -> Array:
    """Angles (..., n) by whole turns into their limits, and as near as that leaves them to a centre."""
    q = np.array(q, dtype=float)
    if np.abs(q - centre).max(initial=0.0) < np.pi and room.holds(q).all():
        return q
    wanted = np.round((centre - q) / _TURN)
    least, most = room.allowed(q)
    within = np.clip(q + _TURN * np.clip(wanted, least, most), room.lower, room.upper)
    turned = np.where(least <= most, within, q + _TURN * wanted)
    return np.where(room.repeats & (np.abs(turned - q) > 1.0), turned, q)


def has_turns(room: Room, q: Array) -> NDArray[np.bool_]:
    """(...) whether configurations (..., n) stay within the limits after a whole turn of some joint."""
    least, largest = room.allowed(q)
    able: NDArray[np.bool_] = np.any((largest > least) & room.repeats, axis=-1)
    return able


def all_turns(room: Room, q: ArrayLike, reference: Array, most: int) -> Array:
    """Up to `most` configurations (k, n) that differ from q (n,) by whole turns, the nearest to a reference first."""
    first = nearest_turn(room, q, reference)
    if not has_turns(room, first):
        return first[None]
    least, largest = room.allowed(first)
    ranges = [
        range(int(low), int(high) + 1) if repeats and low <= 0 <= high else range(1)
        for repeats, low, high in zip(room.repeats, least, largest, strict=True)
    ]
    # of very many the nearest of each joint are enough
    near = [sorted(numbers, key=abs)[: 3 if len(ranges) > 6 else 5] for numbers in ranges]
    whole = _TURN * np.array(list(itertools.product(*near)), dtype=float)
    rows = np.where(whole == 0.0, first, np.clip(first + whole, room.lower, room.upper))
    away = np.linalg.norm(rows - reference, axis=1)
    return rows[np.argsort(away, kind="stable")[:most]]
