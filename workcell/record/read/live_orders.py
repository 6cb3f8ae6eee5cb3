"""Orders to follow goals, as a recording has them: frames of one robot's joints, and their limits.

Nothing that is read is believed: what the file lacks, or says twice, is a fault.
"""

from __future__ import annotations

import json
from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np

from workcell.pose import Array
from workcell.record.read.reader import Entity

SCALARS, TEXT = "Scalars:scalars", "TextDocument:text"
ORDERS = ("velocity", "acceleration", "jerk")
ROUNDING = 1e-6
"""Share of a limit, radians or metres that are rounding."""
_SAME_TIME_S = 1e-6
_UNEVEN = 1e-3
"""Share of a period by which frames may be apart more or less than it."""
_MOST_GAP_S = 0.1
"""Seconds between recorded rows (or three frames) beyond which nobody knows what happened in between."""


@dataclass(frozen=True, slots=True)
class LiveOrder:
    """One order: the first row is where it began, at rest.

    Attributes:
        times: (F,) simulated seconds; q: (F, n) joints; period: seconds of a frame.
        bounds: (3, n) velocity, acceleration and jerk limits; ranges: (2, n) lower and upper ends.
    """

    times: Array
    q: Array
    period: float
    bounds: Array
    ranges: Array

    @property
    def rates(self) -> tuple[Array, ...]:
        """Velocities, accelerations and jerks (F - 1, n)."""
        rates, rows = [], self.q - self.q[:1]
        for _ in ORDERS:
            rows = np.diff(rows, axis=0, prepend=np.zeros_like(rows[:1])) / self.period
            rates.append(rows[1:])
        return tuple(rates)

    def evidence_lacks(self, times: Array) -> bool:
        """Whether rows at `times` leave gaps in which something may have happened during the order."""
        during = times[(times >= self.times[0] - _SAME_TIME_S) & (times <= self.times[-1] + _SAME_TIME_S)]
        edges = np.concatenate([self.times[:1], during, self.times[-1:]])
        return bool(np.diff(edges).max() > max(_MOST_GAP_S, 3.0 * self.period))


def numbers_of(entity: Entity) -> tuple[Array, Array] | None:
    """Times (T,) and rows (T, n) of numbers; None where they are none, or not alike."""
    try:
        times, values = entity.numbers(SCALARS)
        values = values.astype(float)
    except (ValueError, TypeError):
        return None
    return (times, values) if len(times) else None


def document_of(texts: Any) -> dict[str, Any]:
    """The JSON document of a row; empty where it is none."""
    try:
        document = json.loads(texts[0]) if texts else {}
    except (ValueError, TypeError, KeyError, RecursionError):
        return {}
    return document if isinstance(document, dict) else {}


def orders_of(joints: Entity | None, limits: Entity | None) -> tuple[list[LiveOrder], list[str]]:
    """The orders of one robot in their order, and what is wrong with the file where they can't be told."""
    rows = None if joints is None else numbers_of(joints)
    if rows is None:
        return [], ["its frames are missing or can't be read"]
    times, q = rows
    if not (np.isfinite(q).all() and np.isfinite(times).all()):
        return [], ["frames that are no numbers"]
    told = limits.over_time(TEXT) if limits is not None else (np.zeros(0), [])
    if not len(told[0]):
        return [], ["the file does not say within what limits it was to move"]
    # an order begins where the one before it ended, or later: the last row of that time is its first
    begins = [int(np.searchsorted(times, t + _SAME_TIME_S, side="right")) - 1 for t in told[0]]
    if begins[0] != 0:
        return [], ["frames before it was said within what limits it was to move"]
    orders, faults = [], []
    for k, (begin, text) in enumerate(zip(begins, told[1], strict=True)):
        mine = slice(begin, begins[k + 1] if k + 1 < len(begins) else len(times))
        found = _order(times[mine], q[mine], told[0][k], document_of(text))
        if isinstance(found, str):
            faults.append(found)
        else:
            orders.append(found)
    return orders, faults


def _order(times: Array, q: Array, begin: float, document: Mapping[str, Any]) -> LiveOrder | str:
    """One order, or what is wrong with it."""
    if not len(times) or abs(times[0] - begin) > _SAME_TIME_S:
        return "limits without frames"
    try:
        period = float(document["period"])
        bounds = np.array([_row(document[name]) for name in ORDERS])
        ranges = np.array([_row(document["lower"], -np.inf), _row(document["upper"])])
    except (KeyError, TypeError, ValueError, OverflowError):
        return "its limits can't be read"
    n = q.shape[1]
    sound = 0 < period < np.inf and bounds.shape == (3, n) and bool(np.all(bounds > 0))
    if not sound or not np.isfinite(bounds[0]).all():
        return "its limits make no sense"
    if ranges.shape != (2, n) or not np.all(ranges[0] <= ranges[1]):
        return "its joints' ranges make no sense"
    uneven = np.flatnonzero(np.abs(np.diff(times) - period) > _UNEVEN * period)
    if len(uneven):
        return f"frames are missing, or there twice, at {times[uneven[0]]:.3f} s"
    return LiveOrder(times, q, period, bounds, ranges)


def _row(values: Any, endless: float = np.inf) -> list[float]:
    """Numbers of a document; null is without an end."""
    return [endless if value is None else float(value) for value in values]
