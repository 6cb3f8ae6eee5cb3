"""Rows of an `Execution` while they are being written, and MuJoCo's warnings while it runs."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass, field

import numpy as np

from workcell.model.judge.nearest import Distance
from workcell.pose import Array
from workcell.simulate.execution import ContactEvent, Event, Execution, Stop
from workcell.simulate.frames import LiveFrame, frames_of


@dataclass(slots=True)
class Worst:
    """The largest errors, torques and internal forces since the last row."""

    error_m: float = 0.0
    error_rad: float = 0.0
    torque: Array | None = None
    internal_force: float = 0.0
    closure: float = 0.0

    def update(self, actual: Array, wanted: Array, torque: Array) -> None:
        """Take one control step into account; `actual` and `wanted` are tool poses (4, 4)."""
        self.error_m = max(self.error_m, float(np.linalg.norm(actual[:3, 3] - wanted[:3, 3])))
        # The Frobenius distance of two rotations is 2 sqrt(2) sin(angle / 2).
        chord = float(np.linalg.norm(actual[:3, :3] - wanted[:3, :3])) / np.sqrt(8.0)
        self.error_rad = max(self.error_rad, 2 * float(np.arcsin(min(chord, 1.0))))
        self.torque = np.abs(torque) if self.torque is None else np.maximum(self.torque, np.abs(torque))

    @staticmethod
    def of_all(parts: Sequence[Worst], dofs: Sequence[int]) -> Worst:
        """The worst of several arms with `dofs` joints each; torques (n,) side by side."""
        torque = [
            np.zeros(n) if part.torque is None else part.torque for part, n in zip(parts, dofs, strict=True)
        ]
        return Worst(
            max(part.error_m for part in parts),
            max(part.error_rad for part in parts),
            np.concatenate(torque),
            max(part.internal_force for part in parts),
        )


@dataclass(slots=True)
class Rows:
    """Lists that `take` turns into an `Execution`, leaving them empty; arms' joints and tools side by side."""

    dof: int
    arms: int
    nq: int
    time: list[float] = field(default_factory=list)
    qpos: list[Array] = field(default_factory=list)
    q: list[Array] = field(default_factory=list)
    q_reference: list[Array] = field(default_factory=list)
    torque: list[Array] = field(default_factory=list)
    tool: list[Array] = field(default_factory=list)
    error: list[tuple[float, float]] = field(default_factory=list)
    distance: list[Distance] = field(default_factory=list)
    internal_force: list[float] = field(default_factory=list)
    closure: list[float] = field(default_factory=list)
    contacts: list[ContactEvent] = field(default_factory=list)
    events: list[Event] = field(default_factory=list)
    frames: list[LiveFrame] = field(default_factory=list)
    saturated: int = 0
    stop: Stop | None = None

    def add(
        self,
        time: float,
        qpos: Array,
        q: Array,
        q_reference: Array,
        tool: Array,
        worst: Worst,
        distance: Distance,
    ) -> None:
        """One row."""
        self.time.append(time)
        self.qpos.append(qpos)
        self.q.append(q)
        self.q_reference.append(np.array(q_reference))
        self.torque.append(np.zeros(self.dof) if worst.torque is None else worst.torque)
        self.tool.append(np.array(tool))
        self.error.append((worst.error_m, worst.error_rad))
        self.distance.append(distance)
        self.internal_force.append(worst.internal_force)

    def take(self) -> Execution:
        """All rows so far; the lists are empty afterwards."""
        taken = Execution(
            time=np.array(self.time),
            qpos=np.array(self.qpos).reshape(-1, self.nq),
            q=np.array(self.q).reshape(-1, self.dof),
            q_reference=np.array(self.q_reference).reshape(-1, self.dof),
            torque=np.array(self.torque).reshape(-1, self.dof),
            tool_position=np.array(self.tool).reshape(len(self.time), 3 * self.arms),
            tracking_error_m=np.array([error[0] for error in self.error]),
            tracking_error_rad=np.array([error[1] for error in self.error]),
            clearance=np.array([d.distance for d in self.distance]),
            clearance_pair=tuple(d.pair for d in self.distance),
            clearance_points=np.array([d.points for d in self.distance]).reshape(-1, 2, 3),
            internal_force=np.array(self.internal_force),
            closure_error=np.array(self.closure),
            contacts=tuple(self.contacts),
            events=tuple(self.events),
            live=frames_of(self.frames),
            saturated_steps=self.saturated,
            stop=self.stop,
        )
        self.__init__(self.dof, self.arms, self.nq)  # type: ignore[misc]
        return taken


@contextmanager
def captured_warnings() -> Iterator[list[str]]:
    """Collect MuJoCo's warnings, which would otherwise go to the console and a log file in the working directory."""
    import mujoco

    messages: list[str] = []
    before = mujoco.get_mju_user_warning()
    mujoco.set_mju_user_warning(messages.append)
    try:
        yield messages
    finally:
        mujoco.set_mju_user_warning(before)
