"""`Stepper`: the robots of a scene under control, step by step, with guards and a log; `Simulation`'s base."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

from workcell.model.loading.actuators import actuator_targets
from workcell.model.scene import Scene
from workcell.model.scene_parts import SceneRobot
from workcell.pose import Array
from workcell.simulate.arm import Arm, Reference
from workcell.simulate.controller import make_controller
from workcell.simulate.driven import Driven
from workcell.simulate.execution import Execution, StopReason
from workcell.simulate.imperfections import Imperfections
from workcell.simulate.log_rows import Rows, Worst, captured_warnings
from workcell.simulate.pushes import Pushes
from workcell.simulate.runner import Runner, Settings
from workcell.simulate.shared_load import internal_force
from workcell.simulate.watch import Watch


class Stepper(Runner):
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
        super().__init__(scene, settings, on_chunk)
        self._default = robot if robot is None else scene.robot(robot).name
        self._pushes = Pushes(self.model, imperfections.pulses if imperfections else ())
        self.arms = {
            name: self._make_arm(one, controller, imperfections) for name, one in scene.robots.items()
        }
        self._watch = Watch(scene, tuple(scene.robots.values()), self.model, self.data)
        self._hold_what_is_placed()
        self._dofs = [arm.robot.robot.dof for arm in self.arms.values()]
        self._anchored: dict[str, Array] = {}
        self._driven = Driven(self.timestep)
        self._rows = Rows(sum(self._dofs), len(self.arms), self.model.nq)
        self._mujoco.mj_forward(self.model, self.data)
        if self._watch.looks_at_nothing:
            self._say_unwatched()

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
        self._driven.place(data)
        for name, arm in self.arms.items():
            arm.worst.update(arm.tool_matrix(data), arm.wanted_tool(data, references[name], k), torques[name])
        self._measure_strain()
        self._guard(now, warnings)
        step = round(now / self.timestep)
        if self._is_due(step, self.settings.log_s):
            self._log_row(now, qpos)
        if self._is_due(step, self.settings.chunk_s):
            self.flush()

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
        if self._is_unstable(warnings):
            return
        self._note_contacts(now, self._watch.unintended())
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

    def _whose(self, arm: Arm) -> str:
        return f"{arm.name}: " if len(self.arms) > 1 else ""
