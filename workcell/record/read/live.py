"""What tools that followed goals live did, counted from the file: jumps, limits, clearance, errors, statuses."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import asdict, dataclass, field
from itertools import pairwise
from typing import Any

import numpy as np

from workcell.pose import Array
from workcell.record.read.live_orders import (
    ORDERS,
    ROUNDING,
    TEXT,
    LiveOrder,
    document_of,
    numbers_of,
    orders_of,
)
from workcell.record.read.metrics import Series
from workcell.record.read.paths import names_of
from workcell.record.read.reader import Contents, Entity
from workcell.record.write.live_log import ERROR, LIVE, TURNED
from workcell.record.write.scene_log import JOINT_POSITIONS

_TRACKED = 2e-3
"""Radians or metres that a simulated joint may be off its reference."""
_JOINTS, _LIMITS, _STATUS = "joints", "limits", "status"


@dataclass(frozen=True, slots=True)
class LiveRobot:
    """One robot's frames, counted.

    Attributes:
        robot: its name.
        frames: how many there are.
        jumps: frames between which a joint went farther than its velocity limit lets it; of recorded poses, where
            those are more.
        beyond: frames in which a joint was beyond its velocity, acceleration or jerk limit, or its range: by name.
        largest: share of each limit that was reached at most, by name.
        astray: recorded poses that are none to which the frames lead.
        position_mean, position_max: metres by which the tool was off its goal, in frames with one; nan without.
        rotation_mean, rotation_max: radians.
        statuses: frames by status, the most frequent first.
        faults: what the file lacks to count it.
    """

    robot: str
    frames: int
    jumps: int
    beyond: Mapping[str, int]
    largest: Mapping[str, float]
    astray: int
    position_mean: float
    position_max: float
    rotation_mean: float
    rotation_max: float
    statuses: Mapping[str, int] = field(default_factory=dict)
    faults: tuple[str, ...] = ()

    @property
    def clean(self) -> bool:
        """Whether nothing jumped, no limit was exceeded, and all could be counted."""
        return not (self.jumps or self.astray or any(self.beyond.values()) or self.faults)

    @property
    def words(self) -> str:
        """In a sentence."""
        beyond = ", ".join(f"{count} beyond {name}" for name, count in self.beyond.items())
        errors = (
            f"{1e3 * self.position_mean:.2f} mm and {1e3 * self.rotation_mean:.2f} mrad off on average, "
            f"{1e3 * self.position_max:.1f} mm and {1e3 * self.rotation_max:.1f} mrad at most"
            if np.isfinite(self.position_mean)
            else "without a goal"
        )
        astray = [f"{self.astray} recorded poses are not where the frames lead"] if self.astray else []
        statuses = ", ".join(f"{name} {count}" for name, count in self.statuses.items())
        said = f"{self.robot}: {self.frames} frames ({statuses}), {self.jumps} jumps, {beyond}; {errors}"
        return "; ".join([said, *astray, *self.faults])


@dataclass(frozen=True, slots=True)
class LiveReview:
    """What followed goals in a recording.

    Attributes:
        robots: each of them.
        in_contact: recorded rows whose clearance is not zero or more.
        faults: what the file lacks to judge the run.
    """

    robots: tuple[LiveRobot, ...]
    in_contact: int = 0
    faults: tuple[str, ...] = ()

    @property
    def frames(self) -> int:
        """Of the robot that has most."""
        return max((robot.frames for robot in self.robots), default=0)

    @property
    def clean(self) -> bool:
        """Whether no jump, no limit and no clearance was violated."""
        return not (self.in_contact or self.faults) and all(robot.clean for robot in self.robots)

    @property
    def words(self) -> str:
        """What the check says."""
        told = [*(robot.words for robot in self.robots), f"{self.in_contact} rows in contact", *self.faults]
        return "; ".join(told)

    def to_json(self) -> dict[str, Any]:
        """Plain values; nan is none."""
        robots = [
            {key: None if value != value else value for key, value in asdict(robot).items()}
            for robot in self.robots
        ]
        return {
            "robots": robots,
            "in_contact": self.in_contact,
            "faults": list(self.faults),
        }


def live_review(
    contents: Contents, series: Mapping[str, Series], manifest: Mapping[str, Any], unmeasured: bool
) -> LiveReview | None:
    """Counts what the frames in a recording show; None where no tool followed goals.

    Args:
        contents: the recording.
        series: its metrics.
        manifest: what it says of its robots.
        unmeasured: whether nothing could meet, so that no clearance was measured.
    """
    below = {path: names_of(path) for path in contents.below(LIVE)}
    if not below:
        return None
    told, names = manifest.get("robots"), _names_of_statuses(contents)
    robots, orders = [], []
    for name in sorted({path[1] for path in below.values() if len(path) == 3}):
        parts = {path[2]: contents.entities[p] for p, path in below.items() if path[1:2] == [name]}
        mine, faults = orders_of(parts.get(_JOINTS), parts.get(_LIMITS))
        about = told.get(name) if isinstance(told, Mapping) else None
        statuses = _statuses(parts.get(_STATUS), names)
        known = about if isinstance(about, Mapping) else {}
        robots.append(_counted(name, mine, statuses, faults, series, known))
        orders += mine
    faults = [] if robots else ["there are no frames"]
    clearance = series.get("clearance")
    touching = 0 if clearance is None else int((~(clearance.values >= 0.0)).any(axis=1).sum())
    rows = np.zeros(0) if clearance is None else clearance.times
    if not unmeasured and any(order.evidence_lacks(rows) for order in orders):
        faults.append("the clearance is not told all the time")
    return LiveReview(tuple(robots), touching, tuple(faults))


def _names_of_statuses(contents: Contents) -> list[str]:
    """What the numbers of statuses mean."""
    about = contents.entities.get(f"{LIVE}/about")
    told = document_of(about.static.get(TEXT) if about is not None else None).get("statuses")
    return [str(name) for name in told] if isinstance(told, list) else []


def _statuses(entity: Entity | None, names: Sequence[str]) -> dict[str, int]:
    """Frames by status; numbers that stand for none are left out."""
    rows = None if entity is None else numbers_of(entity)
    if rows is None or rows[1].shape[1] != 1:
        return {}
    numbers = rows[1][:, 0]
    counts = {name: int((numbers == k).sum()) for k, name in enumerate(names)}
    return dict(sorted(((n, c) for n, c in counts.items() if c), key=lambda item: -item[1]))


def _counted(
    name: str,
    orders: Sequence[LiveOrder],
    statuses: dict[str, int],
    faults: list[str],
    series: Mapping[str, Series],
    about: Mapping[str, Any],
) -> LiveRobot:
    beyond, largest = dict.fromkeys((*ORDERS, "range"), 0), dict.fromkeys(ORDERS, 0.0)
    frames = 0
    for order in orders:
        frames += len(order.q) - 1
        for kind, rate, most in zip(ORDERS, order.rates, order.bounds, strict=True):
            shares = np.abs(rate) / most
            beyond[kind] += int((~(shares <= 1 + ROUNDING)).any(axis=1).sum())
            largest[kind] = max(largest[kind], float(shares.max(initial=0.0)))
        inside = (order.q >= order.ranges[0] - ROUNDING) & (order.q <= order.ranges[1] + ROUNDING)
        beyond["range"] += int((~inside).any(axis=1).sum())
    if any(not _same_ranges(order, about) for order in orders):
        faults.append("its joints' ranges are not those of the robot")
    jumps, astray = beyond["velocity"] + _apart(orders), 0
    executed = series.get(f"{JOINT_POSITIONS}/{name}")
    if executed is None or any(executed.values.shape[1] != order.q.shape[1] for order in orders):
        faults.append("what it did is not recorded")
    elif orders:
        jumps = max(jumps, _executed_jumps(executed, orders, about))
        astray = sum(_astray(executed, order) for order in orders)
        if any(order.evidence_lacks(executed.times) for order in orders):
            faults.append("what it did is not told all the time")
    off, turned = (series.get(f"{kind}/{name}") for kind in (ERROR, TURNED))
    if any(one is None or one.values.shape != (frames, 1) for one in (off, turned)):
        faults.append("errors are not told in every frame")
    if sum(statuses.values()) != frames:
        faults.append("there is not one status for each frame")
    errors = *_mean_and_most(off), *_mean_and_most(turned)
    told = tuple(dict.fromkeys(faults))
    return LiveRobot(name, frames, jumps, beyond, largest, astray, *errors, statuses, told)


def _apart(orders: Sequence[LiveOrder]) -> int:
    """Orders that begin at once where another ended, at another place."""
    return sum(
        bool(np.abs(b.q[0] - a.q[-1]).max() > ROUNDING)
        for a, b in pairwise(orders)
        if b.times[0] - a.times[-1] <= 0.5 * a.period
    )


def _executed_jumps(executed: Series, orders: Sequence[LiveOrder], about: Mapping[str, Any]) -> int:
    """Recorded poses that a joint can't have come to from the one before.

    Looked at is what lies between the beginning of the first order and the end of the last. Between orders a robot may
    move as fast as its own limits let it.
    """
    first, last = executed.times[:-1], executed.times[1:]
    fastest = np.max([order.bounds[0] for order in orders], axis=0)
    own = _numbers(about.get("velocity"), np.inf)
    if own is not None and own.shape == fastest.shape:
        fastest = np.maximum(fastest, own)
    velocity = np.tile(fastest, (len(first), 1))
    for order in orders:
        velocity[(first >= order.times[0] - 1e-6) & (last <= order.times[-1] + 1e-6)] = order.bounds[0]
    looked_at = (first >= orders[0].times[0] - 1e-6) & (last <= orders[-1].times[-1] + 1e-6)
    gone = np.abs(np.diff(executed.values, axis=0))
    possible = gone <= velocity * (last - first)[:, None] * 1.01 + _TRACKED
    return int(np.sum((~possible).any(axis=1) & looked_at))


def _astray(executed: Series, order: LiveOrder) -> int:
    """Recorded poses that are not between the frames around them, but for what a joint's acceleration makes of it."""
    during = (executed.times >= order.times[0] - 1e-6) & (executed.times <= order.times[-1] + 1e-6)
    ahead = np.searchsorted(order.times, executed.times[during] - 1e-6)
    near = np.stack([order.q[np.clip(ahead - back, 0, len(order.q) - 1)] for back in range(2)])
    bent = np.minimum(order.bounds[1] * order.period**2 / 8, order.bounds[0] * order.period / 2) + _TRACKED
    low, high = near.min(axis=0) - bent, near.max(axis=0) + bent
    values = executed.values[during]
    return int((~((values >= low) & (values <= high))).any(axis=1).sum())


def _same_ranges(order: LiveOrder, about: Mapping[str, Any]) -> bool:
    """Whether an order's ranges are those that the file says the robot has, where it says so."""
    if "lower" not in about and "upper" not in about:
        return True
    own = [_numbers(about.get("lower"), -np.inf), _numbers(about.get("upper"), np.inf)]
    if own[0] is None or own[1] is None or own[0].shape != own[1].shape:
        return False
    same: bool = np.array_equal(np.array(own), order.ranges)
    return same


def _numbers(values: Any, endless: float) -> Array | None:
    """A list of numbers, of which null has no end; None where it is none."""
    try:
        return np.array([endless if value is None else float(value) for value in values])
    except (TypeError, ValueError, OverflowError):
        return None


def _mean_and_most(series: Series | None) -> tuple[float, float]:
    values = np.zeros(0) if series is None else series.values[:, 0]
    known = values[np.isfinite(values)]
    return (float(known.mean()), float(known.max())) if len(known) else (np.nan, np.nan)
