"""`LiveFrames`: what live inverse kinematics was asked and answered in a simulation, a row a control tick."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, fields
from typing import Any

import numpy as np
from numpy.typing import NDArray

from workcell.motion.live.limits import LiveLimits
from workcell.motion.live.step import Step
from workcell.pose import Array, read_only


@dataclass(frozen=True, slots=True)
class LiveFacts:
    """Who followed goals, and within which limits.

    Attributes:
        names: (k) of the robots, in the order of joints and tools.
        dofs: (k) joints of each.
        period: seconds of a frame.
        limits: of all n joints.
        joints: (n) their names.
        lower, upper: (n,) their ranges.
    """

    names: tuple[str, ...]
    dofs: tuple[int, ...]
    period: float
    limits: LiveLimits
    joints: tuple[str, ...]
    lower: Array
    upper: Array

    def joints_of(self, name: str) -> slice:
        """The columns of a robot's joints."""
        k = self.names.index(name)
        begin = sum(self.dofs[:k])
        return slice(begin, begin + self.dofs[k])


@dataclass(frozen=True, slots=True)
class LiveFrames:
    """Frames of one order, in their order; each stands at its end.

    Attributes:
        facts: who, and within which limits.
        time: (F,) simulated seconds at the end of each frame; the first row is where an order began, at rest.
        q: (F, n) where the joints should be then.
        goal: (F, k, 7) the goals of the frame, position and quaternion wxyz; nan where a tool has none.
        status: F names of `LiveStatus`.
        position_error, rotation_error: (F, k) as in `Step`; nan where a tool has no goal.
        terms: (F, 7) as in `Step`.
        clearance: (F,) as in `Step`; metres.
        conditioning: (F, k) as in `Step`.
        seconds: (F,) of the clock that the frame took.
        braked, timed_out: (F,) as in `Step`.
    """

    facts: LiveFacts
    time: Array
    q: Array
    goal: Array
    status: tuple[str, ...]
    position_error: Array
    rotation_error: Array
    terms: Array
    clearance: Array
    conditioning: Array
    seconds: Array
    braked: NDArray[np.bool_]
    timed_out: NDArray[np.bool_]

    def __post_init__(self) -> None:
        for one in fields(self):
            value = getattr(self, one.name)
            if isinstance(value, np.ndarray):
                object.__setattr__(self, one.name, read_only(value, value.dtype))

    def __len__(self) -> int:
        return len(self.time)

    @property
    def jumps(self) -> int:
        """Frames in which a joint went farther than its velocity limit lets it."""
        farthest = self.facts.limits.velocity * self.facts.period * (1 + 1e-6) + 1e-9
        return int((np.abs(np.diff(self.q, axis=0)) > farthest).any(axis=1).sum())

    def counts(self) -> dict[str, int]:
        """How many frames ended in each status; the row of the beginning is none."""
        names = [name for name in self.status if name]
        return {name: names.count(name) for name in dict.fromkeys(names)}


@dataclass(frozen=True, slots=True)
class LiveFrame:
    """One row of `LiveFrames`: its arrays are copies, which stay as they are when the next step is made."""

    facts: LiveFacts
    time: float
    q: Array
    goal: Array
    status: str
    errors: Array
    terms: Array
    clearance: float
    conditioning: Array
    seconds: float
    braked: bool
    timed_out: bool

    @staticmethod
    def of(facts: LiveFacts, time: float, goal: Array, step: Step) -> LiveFrame:
        """A frame that ends at `time` seconds; goal (k, 7)."""
        errors = np.stack([step.position_error, step.rotation_error]).astype(float)
        errors[:, np.isnan(goal[:, 0])] = np.nan
        return LiveFrame(
            facts,
            time,
            np.array(step.q),
            goal,
            step.status.name,
            errors,
            np.array(step.terms),
            float(step.clearance),
            np.array(step.conditioning),
            float(step.seconds),
            bool(step.braked),
            bool(step.timed_out),
        )

    @staticmethod
    def at_rest(facts: LiveFacts, time: float, q: Array) -> LiveFrame:
        """Where an order begins: joints (n,) that don't move."""
        k = len(facts.names)
        none, nans = np.full((k, 7), np.nan), np.full(k, np.nan)
        return LiveFrame(
            facts,
            time,
            np.array(q),
            none,
            "",
            np.full((2, k), np.nan),
            np.full(7, np.nan),
            np.nan,
            nans,
            np.nan,
            False,
            False,
        )


def frames_of(rows: Sequence[LiveFrame]) -> tuple[LiveFrames, ...]:
    """Consecutive frames gathered, apart where who follows, or within which limits, is another."""
    groups: list[list[LiveFrame]] = []
    for row in rows:
        if groups and groups[-1][-1].facts is row.facts:
            groups[-1].append(row)
        else:
            groups.append([row])
    return tuple(_gathered(group) for group in groups)


def summary_of(parts: Sequence[LiveFrames]) -> dict[str, Any]:
    """What a run says of its frames: how many, jumps, statuses, and how far off its goals the worst tool was."""
    robots = [
        _errors_of(parts, name) for name in dict.fromkeys(n for part in parts for n in part.facts.names)
    ]
    counts: dict[str, int] = {}
    for part in parts:
        for name, count in part.counts().items():
            counts[name] = counts.get(name, 0) + count
    found: dict[str, Any] = {
        "live_frames": max((frames for frames, _ in robots), default=0),
        "live_jumps": sum(part.jumps for part in parts),
        "live_statuses": counts,
    }
    known = [errors for _, errors in robots if len(errors)]
    for column, unit in enumerate(("m", "rad")):
        if known:
            found[f"goal_error_mean_{unit}"] = max(float(errors[:, column].mean()) for errors in known)
            found[f"goal_error_max_{unit}"] = max(float(errors[:, column].max()) for errors in known)
    return found


def _errors_of(parts: Sequence[LiveFrames], name: str) -> tuple[int, Array]:
    """How many frames a robot has, and (E, 2) its tool's errors in those with a goal."""
    mine = [(part, part.facts.names.index(name)) for part in parts if name in part.facts.names]
    errors = np.concatenate(
        [np.stack([part.position_error[:, k], part.rotation_error[:, k]], axis=1) for part, k in mine]
    )
    known: Array = errors[np.isfinite(errors).all(axis=1)]
    return sum(len(part) - 1 for part, _ in mine), known


def joined(parts: Sequence[LiveFrames]) -> tuple[LiveFrames, ...]:
    """Frames of consecutive chunks, those of one order together."""
    found: list[LiveFrames] = []
    for part in parts:
        if found and found[-1].facts is part.facts:
            found[-1] = _together(found[-1], part)
        else:
            found.append(part)
    return tuple(found)


def _gathered(rows: Sequence[LiveFrame]) -> LiveFrames:
    errors = np.array([row.errors for row in rows])
    return LiveFrames(
        facts=rows[0].facts,
        time=np.array([row.time for row in rows]),
        q=np.array([row.q for row in rows]),
        goal=np.array([row.goal for row in rows]),
        status=tuple(row.status for row in rows),
        position_error=errors[:, 0],
        rotation_error=errors[:, 1],
        terms=np.array([row.terms for row in rows]),
        clearance=np.array([row.clearance for row in rows]),
        conditioning=np.array([row.conditioning for row in rows]),
        seconds=np.array([row.seconds for row in rows]),
        braked=np.array([row.braked for row in rows]),
        timed_out=np.array([row.timed_out for row in rows]),
    )


def _together(first: LiveFrames, second: LiveFrames) -> LiveFrames:
    arrays = {
        one.name: np.concatenate([getattr(first, one.name), getattr(second, one.name)])
        for one in fields(LiveFrames)
        if one.name not in ("facts", "status")
    }
    return LiveFrames(facts=first.facts, status=first.status + second.status, **arrays)
