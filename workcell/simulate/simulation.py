"""`Simulation`: trajectories executed in MuJoCo by computed torque, grasps, guards, and a log of all that happens."""

from __future__ import annotations

import copy
from collections.abc import Callable, Iterable
from dataclasses import dataclass, field

import numpy as np

from workcell.errors import InputError, ModelError
from workcell.model.scene import Scene
from workcell.motion.path import Trajectory, stationary
from workcell.pose import Array, Pose
from workcell.simulate.controller import ComputedTorque, Gains, discrete_reference
from workcell.simulate.execution import ContactEvent, Event, Execution, Stop, StopReason, join_executions
from workcell.simulate.grasp import Hand, Weld, finger_speed
from workcell.simulate.rows import Rows, Worst, captured_warnings
from workcell.simulate.watch import Held, Watch

_START_TOLERANCE = 1e-3
_SLIPPED = 2e-3
_STILL = 2e-3


@dataclass(frozen=True, slots=True)
class Settings:
    """How a simulation is controlled, watched and logged.

    Attributes:
        gains: of the computed torque.
        log_s: seconds between logged rows.
        chunk_s: seconds between calls of `on_chunk`.
        max_error_m, max_error_rad: tool errors at which the run stops.
        stop_on_contact: whether an unintended contact stops the run (it is logged in any case).
        close_s: seconds over which the gripper's set point moves.
        settle_s: how long the gripper may take, after that, until the fingers rest on the object.
    """

    gains: Gains = field(default_factory=Gains)
    log_s: float = 0.01
    chunk_s: float = 0.5
    max_error_m: float = 0.01
    max_error_rad: float = 0.1
    stop_on_contact: bool = True
    close_s: float = 0.5
    settle_s: float = 1.5


class Simulation:
    """One robot of a scene in motion. Methods return whether they succeeded; after a stop they do nothing.

    Args:
        scene: the scene; its model is copied.
        robot: the robot's name; None: the only one.
        settings: control, guards, logging.
        on_chunk: called with the rows of the last `chunk_s` seconds while the simulation runs.

    Attributes:
        time: simulated seconds.
        stop: why the run ended early, or None.
    """

    def __init__(
        self,
        scene: Scene,
        robot: str | None = None,
        *,
        settings: Settings | None = None,
        on_chunk: Callable[[Execution], None] | None = None,
    ) -> None:
        import mujoco

        self._mujoco = mujoco
        self.scene, self.robot = scene, scene.robot(robot)
        self.settings = settings or Settings()
        self._model = copy.copy(scene.model)
        self._model.opt.disableflags |= mujoco.mjtDisableBit.mjDSBL_AUTORESET
        self._data = mujoco.MjData(self._model)
        self._data.qpos[:] = scene.initial_qpos()
        self._controller = ComputedTorque(self._model, self.robot, self.settings.gains)
        self._watch = Watch(scene, self.robot, self._model, self._data)
        self._hand = Hand.of(self._model, self.robot)
        if self._hand is not None:
            self._data.ctrl[self._hand.actuator] = self._hand.open
        self._site = self._tool_site()
        self._reference = np.array(self.robot.start)
        self._on_chunk = on_chunk
        self._rows = Rows(self.robot.robot.dof, self._model.nq)
        self._chunks: list[Execution] = []
        self._worst = Worst()
        self._seen: set[tuple[str, str]] = set()
        self._was_saturated = False
        self.stop: Stop | None = None
        mujoco.mj_forward(self._model, self._data)

    def _tool_site(self) -> int:
        name = self.robot.prefix + self.robot.robot.tool().name
        site = self._mujoco.mj_name2id(self._model, self._mujoco.mjtObj.mjOBJ_SITE, name)
        if site < 0:
            raise ModelError(f"the model has no site {name!r}", where=self.scene.path)
        return int(site)

    # ---- what the caller asks -----------------------------------------------------------------------------------

    @property
    def time(self) -> float:
        """Simulated seconds."""
        return float(self._data.time)

    @property
    def timestep(self) -> float:
        """Seconds of one control step."""
        return float(self._model.opt.timestep)

    @property
    def qpos(self) -> Array:
        """(nq,) raw positions now."""
        return np.array(self._data.qpos)

    @property
    def q(self) -> Array:
        """(n,) the robot's joints now."""
        return np.array(self._data.qpos[self.robot.qpos_addresses])

    @property
    def q_reference(self) -> Array:
        """(n,) where the robot's joints should be now: plan the next motion from here."""
        return np.array(self._reference)

    @property
    def held(self) -> str | None:
        """Name of the object in the hand, or None."""
        return None if self._watch.held is None else self._watch.held.thing.name

    @property
    def T_tool_object(self) -> Pose | None:
        """How the held object stands in the tool's frame, or None."""
        return None if self._watch.held is None else self._watch.held.T_tool_object

    @property
    def supports(self) -> frozenset[int]:
        """Geom ids that the held object stood on when it was grasped and has not left yet."""
        return frozenset() if self._watch.held is None else self._watch.held.supports

    def object_pose(self, name: str) -> Pose:
        """World pose of an object now; raises UnknownNameError."""
        body = self.scene.object(name).body_id
        data = self._data
        return Pose(data.xpos[body], data.xquat[body])

    def touches(self, name: str) -> frozenset[int]:
        """Ids of the geoms, not of the robot, that touch an object now; raises UnknownNameError."""
        return self._watch.touched_by(self._watch.geoms_of(name))

    def apart(self, name: str, body: str) -> bool:
        """Whether an object has left a body: their bounding boxes, along the world's axes, don't overlap.

        Raises:
            UnknownNameError: no such object or body.
        """
        mine = self._watch.bounds(self.scene.object(name).body_ids)
        other = self._watch.bounds({self._watch.body(body)})
        return bool(np.any(mine[0] > other[1]) or np.any(mine[1] < other[0]))

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

    # ---- what the caller orders ---------------------------------------------------------------------------------

    def execute(self, trajectory: Trajectory, label: str = "") -> bool:
        """Track a trajectory that begins where the reference stands now.

        Raises:
            InputError: its time step is not the simulation's, it is another robot's, or begins elsewhere.
        """
        if abs(trajectory.dt - self.timestep) > 1e-9:
            raise InputError(
                f"the trajectory's step is {trajectory.dt:.6g} s, the simulation's {self.timestep:.6g} s",
                where="trajectory",
                remedy=f"retime with dt={self.timestep:.6g}",
            )
        if trajectory.q.shape[1] != self.robot.robot.dof:
            raise InputError(f"the trajectory moves {trajectory.q.shape[1]} joints", where="trajectory")
        gap = float(np.abs(trajectory.q[0] - self._reference).max())
        if gap > _START_TOLERANCE:
            raise InputError(f"the trajectory begins {gap:.3g} rad away from the robot", where="trajectory")
        if self.stop is not None:
            return False
        if label:
            self.log(f"{label}: {trajectory.duration:.2f} s")
        tools = self.robot.robot.fk_transform(trajectory.q)
        q, qd, qdd = discrete_reference(trajectory)
        with captured_warnings() as warnings:
            for k in range(1, len(trajectory)):
                self._step(q[k], qd[k], qdd[k], tools[k], warnings)
                if self.stop is not None:
                    return False
        return True

    def hold(self, seconds: float) -> bool:
        """Stand still."""
        return self.execute(stationary(self.robot.name, self._reference, seconds, self.timestep))

    def move_gripper(self, opening: float) -> bool:
        """Move the gripper's set point to a share of its range: 0 closed, 1 open.

        Raises:
            ModelError: the robot has no gripper.
        """
        hand = self._gripper()
        target = hand.closed + opening * (hand.open - hand.closed)
        begin = float(self._data.ctrl[hand.actuator])
        steps = max(round(self.settings.close_s / self.timestep), 1)
        for k in range(1, steps + 1):
            self._data.ctrl[hand.actuator] = begin + (target - begin) * k / steps
            if not self.hold(self.timestep):
                return False
        return True

    def grasp(self, name: str) -> bool:
        """Close the gripper on an object and hold it; stops the run when the fingers don't both touch it.

        Raises:
            UnknownNameError, ModelError: no such object, no gripper, or no weld for the two.
        """
        thing, hand = self.scene.object(name), self._gripper()
        weld = Weld.of(self._model, self.robot, thing)
        if self.stop is not None:
            return False
        self.log(f"closing the gripper on the {name}")
        mine = self._watch.geoms_of(name)
        self._watch.expect(self._watch.geoms(hand.bodies), mine)
        if not (self.move_gripper(0.0) and self._wait_for_grip(hand, mine)):
            return False
        supports = self._watch.touched_by(mine)
        T_hand_object = weld.close(self._model, self._data)
        self._controller.carry(weld.hand_body, thing.body_ids, self._data)
        T_tool_object = self._tool_pose().inverse() @ self.object_pose(name)
        self._watch.take(Held(thing, weld, T_hand_object, T_tool_object, supports))
        self.log(f"the {name} is held by both fingers")
        return True

    def expect_contact(self, name: str, body: str) -> None:
        """Contact between an object and a body of the scene is intended from now on, e.g. to put it down there.

        Raises:
            UnknownNameError: no such object or body.
        """
        self._watch.expect(self._watch.geoms_of(name), self._watch.geoms([self._watch.body(body)]))

    def release(self) -> bool:
        """Let go of the object and open the gripper; the open hand may still touch it.

        Raises:
            InputError: the hand holds nothing.
        """
        held = self._watch.held
        if held is None:
            raise InputError("the hand holds nothing", where="release")
        held.weld.release(self._data)
        self._controller.drop(held.weld.hand_body)
        self._watch.let_go()
        self.log(f"released the {held.thing.name}")
        return self.move_gripper(1.0)

    # ---- one control step ---------------------------------------------------------------------------------------

    def _step(self, q: Array, qd: Array, qdd: Array, tool: Array, warnings: list[str]) -> None:
        """Control, integrate, measure. Positions that `mj_step` leaves in `data` are those before integration."""
        data, robot = self._data, self.robot
        qpos, now = np.array(data.qpos), float(data.time)
        torque, saturated = self._controller.torque(qpos, data.qvel, q, qd, qdd)
        data.ctrl[robot.actuator_ids] = torque / self._controller.gear
        self._mujoco.mj_step(self._model, data)
        self._reference = q
        self._worst.update(self._tool_matrix(), tool, torque)
        self._note_saturation(saturated)
        self._guard(now, warnings)
        every = max(round(self.settings.log_s / self.timestep), 1)
        step = round(now / self.timestep)
        if step % every == 0 or self.stop is not None:
            self._log_row(now, qpos, q)
        if step % max(round(self.settings.chunk_s / self.timestep), 1) == 0 or self.stop is not None:
            self.flush()

    def _log_row(self, now: float, qpos: Array, q_reference: Array) -> None:
        robot = self.robot
        if not np.all(np.isfinite(qpos)):
            return
        if self._watch.notice_lift():
            self.log(f"the {self.held} is clear of what it stood on")
        distance = self._watch.clearance(qpos)
        tool = self._data.site_xpos[self._site]
        self._rows.add(now, qpos, qpos[robot.qpos_addresses], q_reference, tool, self._worst, distance)
        self._worst = Worst()

    def _note_saturation(self, saturated: bool) -> None:
        self._rows.saturated += saturated
        if saturated and not self._was_saturated:
            self.log("a joint is at its effort limit", "WARN")
        self._was_saturated = saturated

    def _guard(self, now: float, warnings: list[str]) -> None:
        """Stop on instability, on unintended contact, on a lost object, on a tool too far from its reference."""
        data, settings = self._data, self.settings
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
        if self._worst.error_m > settings.max_error_m or self._worst.error_rad > settings.max_error_rad:
            text = f"the tool is {1000 * self._worst.error_m:.2f} mm and {self._worst.error_rad:.4f} rad off"
            self._stop(StopReason.TRACKING, text)
        slip = self._watch.slip()
        if slip > _SLIPPED:
            self._stop(StopReason.LOST_GRASP, f"the {self.held} slipped by {1000 * slip:.2f} mm")

    def _stop(self, reason: StopReason, detail: str) -> None:
        if self.stop is None:
            self.stop = Stop(self.time, reason, detail)
            self._rows.stop = self.stop
            self.log(f"{reason.value}: {detail}. {reason.sentence}", "ERROR")

    # ---- grasping -----------------------------------------------------------------------------------------------

    def _gripper(self) -> Hand:
        if self._hand is None:
            raise ModelError(f"{self.robot.name} has no gripper", where=self.scene.path)
        return self._hand

    def _wait_for_grip(self, hand: Hand, mine: Iterable[int]) -> bool:
        """Hold until every finger rests on the object."""
        fingers = [self._watch.geoms(finger) for finger in hand.fingers]
        for _ in range(max(round(self.settings.settle_s / 0.02), 1)):
            if not self.hold(0.02):
                return False
            touching = [self._watch.touching(finger, mine) for finger in fingers]
            if all(touching) and finger_speed(self._data, hand) < _STILL:
                return True
        detail = f"{sum(touching)} of {len(fingers)} fingers touch the object"
        self._stop(StopReason.NO_GRASP, detail)
        self.flush()
        return False

    def _tool_matrix(self) -> Array:
        T = np.eye(4)
        T[:3, :3] = self._data.site_xmat[self._site].reshape(3, 3)
        T[:3, 3] = self._data.site_xpos[self._site]
        return T

    def _tool_pose(self) -> Pose:
        return Pose.from_matrix(self._tool_matrix())
