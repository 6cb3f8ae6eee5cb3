"""`Runner`: a copy of a scene's compiled model that is stepped, with a log, and guards that may end the run."""

from __future__ import annotations

import copy
from collections.abc import Callable, Iterable
from dataclasses import dataclass

import numpy as np

from workcell.model.scene import Scene
from workcell.pose import Array
from workcell.simulate.controller import Gains
from workcell.simulate.execution import ContactEvent, Event, Execution, Stop, StopReason, join_executions
from workcell.simulate.log_rows import Rows


@dataclass(frozen=True, slots=True)
class Settings:
    """How a simulation is controlled, watched and logged.

    Attributes:
        gains: of the controller; None: its own.
        log_s: seconds between logged rows.
        chunk_s: seconds between calls of `on_chunk`.
        max_error_m, max_error_rad: tool errors at which the run stops.
        stop_on_contact: whether an unintended contact stops the run (it is logged in any case).
        close_s: seconds over which the gripper's set point moves.
        settle_s: how long the gripper may take, after that, until the fingers rest on the object.
    """

    gains: Gains | None = None
    log_s: float = 0.01
    chunk_s: float = 0.25
    max_error_m: float = 0.01
    max_error_rad: float = 0.1
    stop_on_contact: bool = True
    close_s: float = 0.5
    settle_s: float = 1.5


class Runner:
    """What every simulation has.

    Args:
        scene: the scene; its model is copied.
        settings: None: `Settings()`.
        on_chunk: called with the rows of the last `chunk_s` seconds while the simulation runs.

    Attributes:
        model, data: MuJoCo's own: the copy of the scene's model, and the state now.
        stop: why the run ended early, or None.
        unproved: what moved without a proof that it is clear, in words.
    """

    def __init__(
        self, scene: Scene, settings: Settings | None, on_chunk: Callable[[Execution], None] | None
    ) -> None:
        import mujoco

        self._mujoco = mujoco
        self.scene = scene
        self.settings = settings or Settings()
        self.model = copy.copy(scene.model)
        self.model.opt.disableflags |= mujoco.mjtDisableBit.mjDSBL_AUTORESET
        self.data = mujoco.MjData(self.model)
        self.data.qpos[:] = scene.initial_qpos()
        self._on_chunk = on_chunk
        self._rows = Rows(0, 0, self.model.nq)
        self._chunks: list[Execution] = []
        self._seen: set[tuple[str, str]] = set()
        self.stop: Stop | None = None
        self.unproved: list[str] = []

    @property
    def time(self) -> float:
        """Simulated seconds."""
        return float(self.data.time)

    @property
    def timestep(self) -> float:
        """Seconds of one control step."""
        return float(self.model.opt.timestep)

    @property
    def qpos(self) -> Array:
        """(nq,) raw positions now."""
        return np.array(self.data.qpos)

    def log(self, text: str, level: str = "INFO") -> None:
        """Add a line to the log at this time."""
        self._rows.events.append(Event(self.time, level, text))

    def result(self) -> Execution:
        """All that was logged so far."""
        self.flush()
        return join_executions(self._chunks)

    def flush(self) -> None:
        """Hand the rows since the last chunk to `on_chunk`."""
        chunk = self._rows.take()
        if len(chunk) or chunk.events or chunk.contacts or chunk.stop or not self._chunks:
            self._chunks.append(chunk)
            if self._on_chunk is not None:
                self._on_chunk(chunk)

    def _steps(self, seconds: float) -> int:
        return max(round(seconds / self.timestep), 1)

    def _is_due(self, step: int, period: float) -> bool:
        return step % self._steps(period) == 0 or self.stop is not None

    def _say_unwatched(self) -> None:
        self.log(
            "there is no collision geometry that could meet: no contact and no clearance is looked at", "WARN"
        )

    def _is_unstable(self, warnings: list[str]) -> bool:
        """Whether MuJoCo warned, or the state is no number; the run is stopped then."""
        data = self.data
        if warnings or not np.all(np.isfinite(data.qpos)) or not np.all(np.isfinite(data.qvel)):
            self._stop(
                StopReason.UNSTABLE, " ".join(warnings[:1]) or "positions or velocities are not finite"
            )
            return True
        return False

    def _note_contacts(self, now: float, unintended: Iterable[tuple[tuple[str, str], float]]) -> None:
        """Each unintended contact is told once, and ends the run where the settings say so."""
        for pair, depth in unintended:
            if pair not in self._seen:
                self._seen.add(pair)
                text = f"unintended contact between {pair[0]} and {pair[1]}, {1000 * depth:.2f} mm deep"
                self._rows.contacts.append(ContactEvent(now, pair, depth))
                self.log(text, "ERROR")
                if self.settings.stop_on_contact:
                    self._stop(StopReason.CONTACT, text)

    def _stop(self, reason: StopReason, detail: str) -> None:
        if self.stop is None:
            self.stop = Stop(self.time, reason, detail)
            self._rows.stop = self.stop
            self.log(f"{reason.value}: {detail}. {reason.sentence}", "ERROR")
