"""`MechanismSimulation`: a mechanism's motions executed in MuJoCo, its ties, frames and contacts watched."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Mapping

import numpy as np

from workcell.errors import InputError, ModelError, UnknownNameError
from workcell.model.mechanism.placing import difference
from workcell.model.scene import Scene
from workcell.model.scene_mechanism import SceneMechanism
from workcell.motion.mechanisms.path import MechanismMotion
from workcell.pose import Array, Pose
from workcell.simulate.checks import checked_seconds
from workcell.simulate.execution import Execution, StopReason
from workcell.simulate.log_rows import Rows, Worst, captured_warnings
from workcell.simulate.mechanisms.drives import Drives, Wanted
from workcell.simulate.mechanisms.frames import WatchedFrames
from workcell.simulate.mechanisms.surroundings import Names, Surroundings
from workcell.simulate.runner import Runner, Settings

_START_TOLERANCE = 1e-3
"""Radians or metres that the reference may be away from where a motion begins."""


class MechanismSimulation(Runner):
    """The mechanism of a scene in motion. Methods return whether they succeeded; after a stop they do nothing.

    What is logged is what a robot's simulation logs, with the frames that the task names for tools and the joints that
    motors move for the robot's; and by how much ties are missed.

    Args:
        scene: the scene, whose task file has a `[mechanism]`; its model is copied.
        settings: gains, guards, logging.
        on_chunk: called with the rows of the last `chunk_s` seconds while the simulation runs.

    Attributes:
        moving: the mechanism.

    Raises:
        ModelError: there is no mechanism, nothing drives it, or an actuator can't be told what to do.
    """

    def __init__(
        self,
        scene: Scene,
        *,
        settings: Settings | None = None,
        on_chunk: Callable[[Execution], None] | None = None,
    ) -> None:
        if scene.mechanism is None:
            raise ModelError(
                "there is no mechanism here", where=scene.path, remedy="[mechanism] in the task file"
            )
        super().__init__(scene, settings, on_chunk)
        self.moving: SceneMechanism = scene.mechanism
        self._drives = Drives(self.moving, self.model, self.settings.gains)
        self._around = Surroundings(self.moving, self.model, self.data)
        self._frames = WatchedFrames(self.moving)
        self._reference = np.array(self.moving.start)
        self._rows = Rows(len(self.moving.motors), len(self.moving.frames), self.model.nq)
        self._worst = Worst()
        self._saturated = False
        self._pressing: dict[str, Array] = {}
        rates = [self.moving.mechanism.rate_slices[k].start for k in self.moving.motors]
        self._motor_dofs = self._drives.dofs[rates]
        self._mujoco.mj_forward(self.model, self.data)
        if self._around.looks_at_nothing:
            self._say_unwatched()

    # ---- what the caller asks -----------------------------------------------------------------------------------

    @property
    def q(self) -> Array:
        """(size,) the mechanism's configuration now."""
        return self.moving.compiled.configuration(self.data.qpos)

    @property
    def q_reference(self) -> Array:
        """(size,) where it should be now: plan the next motion from here."""
        return np.array(self._reference)

    def frame_pose(self, name: str) -> Pose:
        """World pose of one of its frames now; raises UnknownNameError."""
        return self._frames.pose(self.data, name)

    def body_pose(self, name: str) -> Pose:
        """World pose of any body now, such as an object's or a thing of the cell; raises UnknownNameError."""
        bodies = [self.model.body(body).name for body in range(self.model.nbody)]
        if name not in bodies:
            raise UnknownNameError("body", name, bodies, where=self.scene.path)
        body = bodies.index(name)
        return Pose(self.data.xpos[body], self.data.xquat[body])

    def touched(self) -> dict[Names, float]:
        """What the mechanism touches now: names of its geom and of the other, and the normal force (newtons)."""
        return self._around.touched()

    # ---- what the caller orders ---------------------------------------------------------------------------------

    def expect(self, pairs: Iterable[Names]) -> None:
        """These pairs of geoms (names) may touch from now on; raises UnknownNameError."""
        self._around.expect(pairs)

    def execute(self, motion: MechanismMotion, label: str = "") -> bool:
        """Track a motion that begins where the reference stands now.

        Raises:
            InputError: a time step that is not the simulation's, another mechanism's motion, or another start.
        """
        if abs(motion.dt - self.timestep) > 1e-9:
            raise InputError(
                f"the motion's step is {motion.dt:.6g} s, the simulation's {self.timestep:.6g} s",
                where="motion",
            )
        if motion.q.shape[1] != len(self._reference):
            raise InputError(f"the motion is one of {motion.mechanism.name}", where="motion")
        if self.stop is not None:
            return False
        gap = float(np.abs(difference(self.moving.mechanism, self._reference, motion.q[0])).max())
        if gap > _START_TOLERANCE:
            raise InputError(
                f"the motion begins {gap:.3g} rad (m) away from where the mechanism should be", where="motion"
            )
        if label:
            self.log(f"{label}: {motion.duration:.2f} s")
        velocity, acceleration = motion.rates()
        if not self._run(map(Wanted, motion.q[:-1], velocity, acceleration)):
            return False
        self._reference = np.array(motion.q[-1])
        return True

    def hold(self, seconds: float) -> bool:
        """Stand still; raises InputError for a negative duration."""
        return self._run(self._still() for _ in range(self._steps(checked_seconds(seconds))))

    def press(self, forces: Mapping[str, Array], seconds: float) -> bool:
        """Press with frames on what they touch: forces (3,) in the world, newtons, grown from what they are now.

        They stay until `press` changes them, and turn with their frames.

        Raises:
            UnknownNameError: no such frame; InputError: a negative duration.
        """
        steps, before = self._steps(checked_seconds(seconds)), dict(self._pressing)
        own = {
            frame: self.frame_pose(frame).rotation.T @ np.asarray(force, dtype=float)
            for frame, force in forces.items()
        }
        for k in range(1, steps + 1):
            for frame, force in own.items():
                begin = before.get(frame, np.zeros(3))
                self._pressing[frame] = begin + k / steps * (force - begin)
            if not self._run([self._still()]):
                return False
        return True

    # ---- one control step ---------------------------------------------------------------------------------------

    def _still(self) -> Wanted:
        rest = np.zeros(self.moving.mechanism.dof)
        return Wanted(self._reference, rest, rest)

    def _run(self, wanted: Iterable[Wanted]) -> bool:
        with captured_warnings() as warnings:
            for one in wanted:
                if self.stop is not None:
                    return False
                self._step(one, warnings)
        return self.stop is None

    def _step(self, wanted: Wanted, warnings: list[str]) -> None:
        """Control, integrate, measure. Positions that `mj_step` leaves in `data` are those before integration."""
        data = self.data
        qpos, now = np.array(data.qpos), float(data.time)
        actuators, control, saturated = self._drives.command(data, wanted, self._forces_now())
        data.ctrl[actuators] = control
        self._rows.saturated += saturated
        if saturated and not self._saturated:
            self.log("a motor is at its limit", "WARN")
        self._saturated = saturated
        self._mujoco.mj_step(self.model, data)
        self._reference = np.array(wanted.q)
        self._measure()
        self._guard(now, warnings)
        step = round(now / self.timestep)
        if self._is_due(step, self.settings.log_s):
            self._log_row(now, qpos)
        if self._is_due(step, self.settings.chunk_s):
            self.flush()

    def _forces_now(self) -> dict[int, tuple[Array, Array]]:
        """By body: where a frame presses, and with what."""
        found = {}
        for name, force in self._pressing.items():
            body, _ = self._frames.on_body(name)
            pose = self.frame_pose(name)
            found[body] = (pose.position, pose.rotation @ force)
        return found

    def _measure(self) -> None:
        data, worst = self.data, self._worst
        self._frames.compare(data, self._drives.reference, worst)
        torque = np.abs(data.qfrc_actuator[self._motor_dofs])
        worst.torque = torque if worst.torque is None else np.maximum(worst.torque, torque)
        worst.closure = max(worst.closure, self._missed())

    def _missed(self) -> float:
        """The largest distance by which a tie was missed before the step, as MuJoCo has it."""
        data = self.data
        rows = data.efc_type[: data.nefc] == int(self._mujoco.mjtConstraint.mjCNSTR_EQUALITY)
        squares = data.efc_pos[: data.nefc][rows] ** 2
        if not len(squares):
            return 0.0
        return float(np.sqrt(np.bincount(data.efc_id[: data.nefc][rows], weights=squares).max()))

    def _log_row(self, now: float, qpos: Array) -> None:
        if not np.all(np.isfinite(qpos)):
            return
        self._rows.add(
            now,
            qpos,
            qpos[self.moving.motor_addresses],
            self.moving.motor_values(self._reference),
            self._frames.positions(self.data).ravel(),
            self._worst,
            self._around.clearance(qpos),
        )
        self._rows.closure.append(self._worst.closure)
        self._worst = Worst()

    def _guard(self, now: float, warnings: list[str]) -> None:
        """Stop on instability, on unintended contact, on a frame too far from its reference."""
        if self._is_unstable(warnings):
            return
        self._note_contacts(now, self._around.unintended())
        worst, settings = self._worst, self.settings
        if worst.error_m > settings.max_error_m or worst.error_rad > settings.max_error_rad:
            text = f"{self._frames.words} {1000 * worst.error_m:.2f} mm and {worst.error_rad:.4f} rad off"
            self._stop(StopReason.TRACKING, text)
