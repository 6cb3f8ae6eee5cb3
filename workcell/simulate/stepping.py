"""`Stepper`: the robots of a scene under control, step by step, with guards and a log; `Simulation`'s base."""

from __future__ import annotations

import copy
from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from workcell.model.loading.actuators import actuator_targets
from workcell.model.scene import Scene
from workcell.model.scene_parts import SceneRobot
from workcell.pose import Array
from workcell.simulate.arm import Arm, Reference
from workcell.simulate.controller import Gains, make_controller
from workcell.simulate.execution import ContactEvent, Event, Execution, Stop, StopReason, join_executions
from workcell.simulate.imperfections import Imperfections
from workcell.simulate.log_rows import Rows, Worst, captured_warnings
from workcell.simulate.pushes import Pushes
from workcell.simulate.shared_load import internal_force
from workcell.simulate.watch import Watch


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


class Stepper:
    """Robots, controllers, guards and log of one simulated scene.

    `Simulation` says what the arguments and parts mean.
    """

    def __init__(
        self,
        scene: Scene,
        robot: str | None = None,
        *,
        controller: str = "computed_torque",
        imperfections: Imperfections | None = None,
        settings: Settings | None = None,
        on_chunk: Callable[[Execution], None] | None = None,
    ) -> None:
        import mujoco

        self._mujoco = mujoco
        self.scene = scene
        self._default = robot if robot is None else scene.robot(robot).name
        self.settings = settings or Settings()
        self.model = copy.copy(scene.model)
        self.model.opt.disableflags |= mujoco.mjtDisableBit.mjDSBL_AUTORESET
        self.data = mujoco.MjData(self.model)
        self.data.qpos[:] = scene.initial_qpos()
        self._pushes = Pushes(self.model, imperfections.pulses if imperfections else ())
        self.arms = {
            name: self._make_arm(one, controller, imperfections) for name, one in scene.robots.items()
        }
        self._watch = Watch(scene, tuple(scene.robots.values()), self.model, self.data)
        self._hold_what_is_placed()
        self._on_chunk = on_chunk
        self._dofs = [arm.robot.robot.dof for arm in self.arms.values()]
        self._anchored: dict[str, Array] = {}
        self._rows = Rows(sum(self._dofs), len(self.arms), self.model.nq)
        self._chunks: list[Execution] = []
        self._seen: set[tuple[str, str]] = set()
        self.stop: Stop | None = None
        self.unproved: list[str] = []
        mujoco.mj_forward(self.model, self.data)
        if self._watch.looks_at_nothing:
            self.log(
                "there is no collision geometry that could meet: no contact and no clearance is looked at",
                "WARN",
            )

    def _hold_what_is_placed(self) -> None:
        """Servos of the cell whose joints begin elsewhere than the model has them hold them there."""
        if not self.scene.placed:
            return
        self._mujoco.mj_forward(self.model, self.data)
        placed = np.isin(self.model.jnt_qposadr, [address for address, _ in self.scene.placed])
        bodies = set(self.model.jnt_bodyid[placed].tolist())
        for actuator in self.scene.actuators().values():
            servo = self.model.actuator_biasprm[actuator, 1] < 0  # it pulls back from its length
            if servo and bodies.intersection(actuator_targets(self.model, actuator)):
                pull = -self.model.actuator_biasprm[actuator, 1] * self.data.actuator_length[actuator]
                held = pull / self.model.actuator_gainprm[actuator, 0]
                low, high = self.model.actuator_ctrlrange[actuator]
                limited = self.model.actuator_ctrllimited[actuator]
                self.data.ctrl[actuator] = np.clip(held, low, high) if limited else held

    def _make_arm(self, robot: SceneRobot, controller: str, imperfections: Imperfections | None) -> Arm:
        driver = make_controller(
            controller, self.model, robot, self.data.qpos, self.settings.gains, imperfections
        )
        arm = Arm(self.scene, robot, self.model, driver)
        if arm.hand is not None:
            self.data.ctrl[arm.hand.actuator] = arm.hand.open
        return arm

    def arm(self, robot: str | None = None) -> Arm:
        """The robot in motion of that name, or the one that is meant where none is named; raises UnknownNameError."""
        return self.arms[self.scene.robot(robot or self._default).name]

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

    # ---- one control step ---------------------------------------------------------------------------------------

    def _still(self) -> dict[str, Reference]:
        return {name: arm.still(self.data) for name, arm in self.arms.items()}

    def _run(self, references: dict[str, Reference], steps: int) -> bool:
        with captured_warnings() as warnings:
            for k in range(1, steps):
                self._step(references, k, warnings)
                if self.stop is not None:
                    return False
        return True

    def _move_actuator(self, actuator: int, target: float, seconds: float) -> bool:
        still = self._still()
        for value in np.linspace(self.data.ctrl[actuator], target, self._steps(seconds) + 1)[1:]:
            self.data.ctrl[actuator] = value
            if self.stop is not None or not self._run(still, 2):
                return False
        return True

    def _steps(self, seconds: float) -> int:
        return max(round(seconds / self.timestep), 1)

    def _step(self, references: dict[str, Reference], k: int, warnings: list[str]) -> None:
        """Control, integrate, measure. Positions that `mj_step` leaves in `data` are those before integration."""
        data = self.data
        qpos, now = np.array(data.qpos), float(data.time)
        self._pushes.apply(data)
        torques = {}
        for name, arm in self.arms.items():
            torques[name], reached = arm.drive(data, qpos, references[name].at(k))
            self._rows.saturated += arm.saturated
            if reached:
                self.log(f"{self._whose(arm)}a joint is at its effort limit", "WARN")
        self._mujoco.mj_step(self.model, data)
        for name, arm in self.arms.items():
            arm.worst.update(arm.tool_matrix(data), arm.wanted_tool(data, references[name], k), torques[name])
        self._measure_strain()
        self._guard(now, warnings)
        step = round(now / self.timestep)
        if self._is_due(step, self.settings.log_s):
            self._log_row(now, qpos)
        if self._is_due(step, self.settings.chunk_s):
            self.flush()

    def _is_due(self, step: int, period: float) -> bool:
        return step % self._steps(period) == 0 or self.stop is not None

    def _measure_strain(self) -> None:
        shared = self._watch.shared()
        if shared:
            force = internal_force(self.data, [held.weld for held in shared])
            worst = next(iter(self.arms.values())).worst
            worst.internal_force = max(worst.internal_force, force)

    def _log_row(self, now: float, qpos: Array) -> None:
        if not np.all(np.isfinite(qpos)):
            return
        for name in self._watch.notice_lift():
            self.log(f"the {name} is clear of what it stood on")
        self._watch.notice_parting()
        for name, slip in self._watch.notice_slip():
            self.log(f"the {name} slips in the hand: {1e3 * slip:.1f} mm", "WARN")
        arms = list(self.arms.values())
        self._rows.add(
            now,
            qpos,
            np.concatenate([qpos[arm.robot.qpos_addresses] for arm in arms]),
            np.concatenate([arm.reference for arm in arms]),
            np.concatenate([arm.tool_matrix(self.data)[:3, 3] for arm in arms]),
            Worst.of_all([arm.worst for arm in arms], self._dofs),
            self._watch.clearance(qpos),
        )
        for arm in arms:
            arm.worst = Worst()

    def _guard(self, now: float, warnings: list[str]) -> None:
        """Stop on instability, on unintended contact, on a lost object, on a tool too far from its reference."""
        data, settings = self.data, self.settings
        if warnings or not np.all(np.isfinite(data.qpos)) or not np.all(np.isfinite(data.qvel)):
            self._stop(
                StopReason.UNSTABLE, " ".join(warnings[:1]) or "positions or velocities are not finite"
            )
            return
        for pair, depth in self._watch.unintended():
            if pair not in self._seen:
                self._seen.add(pair)
                text = f"unintended contact between {pair[0]} and {pair[1]}, {1000 * depth:.2f} mm deep"
                self._rows.contacts.append(ContactEvent(now, pair, depth))
                self.log(text, "ERROR")
                if settings.stop_on_contact:
                    self._stop(StopReason.CONTACT, text)
        for arm in self.arms.values():
            worst = arm.worst
            if worst.error_m > settings.max_error_m or worst.error_rad > settings.max_error_rad:
                text = f"the tool is {1000 * worst.error_m:.2f} mm and {worst.error_rad:.4f} rad off"
                self._stop(StopReason.TRACKING, self._whose(arm) + text)
        for name, base in self._anchored.items():
            moved = float(np.linalg.norm((self.arms[name].base_matrix(data) - base)[:3, 3]))
            if moved > settings.max_error_m:
                text = f"the base of {name} has moved by {1000 * moved:.2f} mm on what carries it"
                self._stop(StopReason.TRACKING, text)
        for held in self._watch.held.values():
            slip = self._watch.slip(held)
            if slip > held.may_slip:
                self._stop(StopReason.LOST_GRASP, f"the {held.thing.name} slipped by {1000 * slip:.2f} mm")

    def _stop(self, reason: StopReason, detail: str) -> None:
        if self.stop is None:
            self.stop = Stop(self.time, reason, detail)
            self._rows.stop = self.stop
            self.log(f"{reason.value}: {detail}. {reason.sentence}", "ERROR")

    def _whose(self, arm: Arm) -> str:
        return f"{arm.name}: " if len(self.arms) > 1 else ""
