"""`Execution`: what the simulation did, as arrays, with every event and unintended contact."""

from __future__ import annotations

import enum
from collections.abc import Sequence
from dataclasses import dataclass, field, fields

import numpy as np

from workcell.pose import Array, read_only
from workcell.simulate.frames import LiveFrames, joined


class StopReason(enum.Enum):
    """Why a simulation was stopped before its end."""

    TRACKING = "TRACKING"
    CONTACT = "CONTACT"
    UNSTABLE = "UNSTABLE"
    NO_GRASP = "NO_GRASP"
    LOST_GRASP = "LOST_GRASP"

    @property
    def sentence(self) -> str:
        """The reason in words, with its remedy."""
        return _SENTENCES[self]


_SENTENCES = {
    StopReason.TRACKING: "What moves left its reference. Move slower, or look for saturated joints in the log.",
    StopReason.CONTACT: "The robot, or what it carries, touched something that it should not. "
    "Plan with more clearance.",
    StopReason.UNSTABLE: "The simulation became unstable. "
    "Check masses and contacts of the model, or use a smaller step.",
    StopReason.NO_GRASP: "The fingers closed without both touching the object. Check the grasp pose.",
    StopReason.LOST_GRASP: "The object slipped out of the hand. Move slower, or grasp nearer its centre of mass.",
}


@dataclass(frozen=True, slots=True)
class Event:
    """One line of the log: simulated seconds, level (INFO, WARN, ERROR) and text."""

    time: float
    level: str
    text: str


@dataclass(frozen=True, slots=True)
class ContactEvent:
    """The first moment of an unintended contact: simulated seconds, the two geoms, depth in metres."""

    time: float
    pair: tuple[str, str]
    depth: float


@dataclass(frozen=True, slots=True)
class Stop:
    """The end of a run by a guard: when, why, and the particulars."""

    time: float
    reason: StopReason
    detail: str


@dataclass(frozen=True, slots=True)
class Execution:
    """Rows logged by a simulation, evenly spaced in time; errors and torques are the largest since the row before.

    Attributes:
        time: (T,) simulated seconds.
        qpos: (T, nq) raw MuJoCo positions of the whole scene.
        q, q_reference: (T, n) the robots' joints, side by side in the scene's order, and where they should have been.
        torque: (T, n) largest |applied torque| since the row before (newton metres or newtons).
        tool_position: (T, 3) of the tool, world, metres; (T, 3 k) for k robots.
        tracking_error_m, tracking_error_rad: (T,) largest distance of a tool from its reference since the row
            before; every control step is looked at.
        clearance: (T,) smallest signed distance of a robot, and of what it carries, to everything it should not touch;
            nan where there is nothing that it could touch.
        clearance_pair: T pairs of geom names that have it.
        clearance_points: (T, 2, 3) the nearest points of that pair, world.
        internal_force: (T,) largest force (newtons) with which hands that share an object worked against each other
            since the row before; 0 while no object is shared.
        closure_error: (T,) largest distance (metres, radians) by which a tie of a mechanism was missed since the row
            before; empty where there is no mechanism.
        contacts: unintended contacts, first moment of each.
        events: the log.
        live: the frames of live inverse kinematics, a part for each order to follow goals.
        saturated_steps: control steps on which a joint reached its effort limit.
        stop: why the run ended early, or None.
    """

    time: Array
    qpos: Array
    q: Array
    q_reference: Array
    torque: Array
    tool_position: Array
    tracking_error_m: Array
    tracking_error_rad: Array
    clearance: Array
    clearance_pair: tuple[tuple[str, str], ...]
    clearance_points: Array
    internal_force: Array
    closure_error: Array = field(default_factory=lambda: np.zeros(0))
    contacts: tuple[ContactEvent, ...] = ()
    events: tuple[Event, ...] = ()
    live: tuple[LiveFrames, ...] = ()
    saturated_steps: int = 0
    stop: Stop | None = None

    def __post_init__(self) -> None:
        for one in fields(self):
            value = getattr(self, one.name)
            if isinstance(value, np.ndarray):
                object.__setattr__(self, one.name, read_only(value))

    def __len__(self) -> int:
        return len(self.time)

    @property
    def looked_at_nothing(self) -> bool:
        """Whether there was nothing that could be touched: then no clearance was measured, and no contact possible."""
        return len(self) > 0 and bool(np.isnan(self.clearance).all())

    @property
    def min_clearance(self) -> float:
        """Smallest clearance of all rows; inf where none was measured."""
        return float(np.fmin.reduce(self.clearance, initial=np.inf))

    @property
    def min_clearance_pair(self) -> tuple[str, str]:
        """The geoms that came closest."""
        if np.isnan(self.clearance).all():
            return "", ""
        return self.clearance_pair[int(np.nanargmin(self.clearance))]

    @property
    def max_tracking_error_m(self) -> float:
        """Largest distance of the tool from its reference, metres; 0 without rows."""
        return float(self.tracking_error_m.max(initial=0.0))

    @property
    def max_tracking_error_rad(self) -> float:
        """Largest rotation of the tool away from its reference, radians; 0 without rows."""
        return float(self.tracking_error_rad.max(initial=0.0))


def join_executions(parts: Sequence[Execution]) -> Execution:
    """One execution out of consecutive chunks of one run."""
    merged = {
        one.name: np.concatenate([getattr(part, one.name) for part in parts])
        for one in fields(Execution)
        if isinstance(getattr(parts[0], one.name), np.ndarray)
    }
    return Execution(
        **merged,
        clearance_pair=tuple(pair for part in parts for pair in part.clearance_pair),
        contacts=tuple(contact for part in parts for contact in part.contacts),
        events=tuple(event for part in parts for event in part.events),
        live=joined([frames for part in parts for frames in part.live]),
        saturated_steps=sum(part.saturated_steps for part in parts),
        stop=next((part.stop for part in reversed(parts) if part.stop is not None), None),
    )
