"""`Follower`: the order to follow goals, with live inverse kinematics asked at every control tick."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass

import numpy as np

from workcell.errors import InputError, UnknownNameError
from workcell.motion.live.goals import LiveGoal
from workcell.motion.live.step import Step
from workcell.motion.live.stream import Stamped
from workcell.pose import Array, Pose
from workcell.simulate.arm import Reference
from workcell.simulate.checks import checked_seconds
from workcell.simulate.driven import ObjectPath
from workcell.simulate.frames import LiveFacts, LiveFrame
from workcell.simulate.live.feed import Feed
from workcell.simulate.live.solver import Goals, GoalSource, LiveSolver
from workcell.simulate.live.telling import Telling
from workcell.simulate.log_rows import captured_warnings
from workcell.simulate.stepping import Stepper

_BRAKING_S = 5.0
"""Seconds that an arm may take to come to rest when the order ends."""


@dataclass(slots=True)
class _Order:
    """What one order needs from tick to tick."""

    live: LiveSolver
    facts: LiveFacts
    steps: int
    feed: Feed
    telling: Telling
    q: Array


class Follower(Stepper):
    """A `Stepper` whose arms can follow goals, among objects that are driven along paths."""

    def drive(self, name: str, path: ObjectPath | None) -> None:
        """Move a free object along a path from now on, whatever it meets; None: leave it to itself again.

        Args:
            name: the object's.
            path: the world pose of its root body, by seconds from now on.

        Raises:
            UnknownNameError: no such object; InputError: a fixed one, one that a hand holds, a path without poses.
        """
        thing = self.scene.object(name)
        if any(held.thing.name == name for held in self._watch.held.values()):
            raise InputError(f"a hand holds the {name}", where="drive", remedy="release it first")
        if path is None:
            self._driven.end(name)
            return
        self._driven.begin(thing, path, self.data)
        self._mujoco.mj_kinematics(self.model, self.data)

    def follow(
        self,
        live: LiveSolver,
        goals: GoalSource,
        seconds: float,
        label: str = "",
        *,
        each: Callable[[], bool] | None = None,
    ) -> bool:
        """Follow goals for some time, then come to rest where the arms are.

        `live` is asked at every tick of its period, is told where what moves is, and begins at rest where the
        references of its arms stand. What it answers is each arm's reference (see `Feed`).
        Every frame is logged with its goals, errors and terms; statuses and guards are told as they change. All
        other guards of the simulation stay in force. Robots that `live` doesn't move hold their place.

        Args:
            live: `LiveIK` of this scene's robots.
            goals: of seconds since the order was given: a goal for the only robot, one for each named, none (the arms
                brake and hold), or what a stream says (`Stamped`).
            seconds: how long.
            label: for the log.
            each: called after every tick; False ends the order.

        Raises:
            InputError: a period that is no whole number of the simulation's steps, a negative duration, other joints.
            UnknownNameError: a robot or a moving thing that the scene doesn't have; a goal for a robot that `live`
                doesn't move.
        """
        ticks = round(checked_seconds(seconds) / live.period)
        order = self._order(live)
        for name in live.moving:
            self._watch_body(name)
        if self.stop is not None:
            return False
        live.reset(order.q)
        if label:
            self.log(f"{label}: {seconds:.2f} s")
        begun, rest = self.time, round(_BRAKING_S / live.period)
        self._rows.frames.append(LiveFrame.at_rest(order.facts, begun, order.q))
        with captured_warnings() as warnings:
            for _ in range(ticks):
                told = goals(self.time - begun)
                if not self._tick(order, told, warnings):
                    return False
                if each is not None and not each():
                    break
            while self._tick(order, None, warnings) and not order.feed.rests and rest > 0:
                rest -= 1
        for name in live.names:
            self.arm(name).reference = order.q[order.facts.joints_of(name)]
        if not order.feed.rests and self.stop is None:
            self.log(f"the arms did not come to rest within {_BRAKING_S:g} s", "WARN")
        return self.stop is None

    def _order(self, live: LiveSolver) -> _Order:
        steps = round(live.period / self.timestep)
        if steps < 1 or abs(steps * self.timestep - live.period) > 1e-9:
            raise InputError(
                f"a period of {live.period:g} s is no whole number of the simulation's steps of {self.timestep:g} s",
                where="live",
                remedy=f"a multiple of {self.timestep:g} s",
            )
        q, robots = np.zeros(len(live.limits.velocity)), [self.arm(name).robot.robot for name in live.names]
        for name in live.names:
            arm, columns = self.arm(name), live.columns(name)
            if columns.stop - columns.start != arm.robot.robot.dof:
                raise InputError(f"it has other joints than {name} has here", where="live")
            q[columns] = arm.reference
        facts = LiveFacts(
            tuple(live.names),
            tuple(robot.dof for robot in robots),
            live.period,
            live.limits,
            tuple(joint for robot in robots for joint in robot.joint_names),
            np.concatenate([robot.lower for robot in robots]),
            np.concatenate([robot.upper for robot in robots]),
        )
        return _Order(live, facts, steps, Feed(q, steps, self.timestep), Telling(self.log, live.period), q)

    def _tick(self, order: _Order, told: Goals | Stamped, warnings: list[str]) -> bool:
        """One tick: place, ask, feed, log; whether nothing stopped the run."""
        live, stamped = order.live, told if isinstance(told, Stamped) else Stamped(told)  # type: ignore[arg-type]
        self._place(live)
        goal = _goals_of(order.facts, stamped.goal)
        step = live.step(stamped.goal, stamp=stamped.stamp)
        order.telling.frame(step, stamped.reason)
        self._look_for_a_jump(order, step)
        order.q = np.array(step.q)
        references = self._references(order)
        end = self.time + live.period
        self._rows.frames.append(LiveFrame.of(order.facts, end, goal, step))
        for k in range(order.steps):
            self._step(references, k, warnings)
            if self.stop is not None:
                return False
        return True

    def _references(self, order: _Order) -> dict[str, Reference]:
        fed, references = order.feed.to(order.q, order.live.qd, order.live.qdd), self._still()
        for name in order.facts.names:
            joints = order.facts.joints_of(name)
            q, qd, qdd = (values[:, joints] for values in fed)
            references[name] = self.arm(name).reference_of(self.data, q, qd, qdd)
        return references

    def _look_for_a_jump(self, order: _Order, step: Step) -> None:
        most = order.facts.limits.velocity * order.facts.period
        over = np.abs(step.q - order.q) - most * (1 + 1e-6) - 1e-9
        worst = int(np.argmax(over))
        if over[worst] > 0:
            joint = order.facts.joints[worst]
            order.telling.jump(joint, float(abs(step.q[worst] - order.q[worst])), float(most[worst]))

    # ---- what moves -------------------------------------------------------------------------------------------------

    def _watch_body(self, name: str) -> int:
        """Id of the body that a moving thing's name means: an object's root, or a body of the cell."""
        return self.scene.objects[name].body_id if name in self.scene.objects else self._watch.body(name)

    def _place(self, live: LiveSolver) -> None:
        """Tell where all is that moves, and how fast."""
        data, model = self.data, self.model
        for name in live.moving:
            body = self._watch_body(name)
            joint, mocap = int(model.body_jntadr[body]), int(model.body_mocapid[body])
            if mocap >= 0:
                live.place(name, Pose(data.mocap_pos[mocap], data.mocap_quat[mocap]))
            elif joint >= 0 and model.jnt_type[joint] == self._mujoco.mjtJoint.mjJNT_FREE:
                at, dof = int(model.jnt_qposadr[joint]), int(model.jnt_dofadr[joint])
                quat = data.qpos[at + 3 : at + 7]
                pose = Pose(data.qpos[at : at + 3], quat / np.linalg.norm(quat))
                turning = pose.rotation @ data.qvel[dof + 3 : dof + 6]
                live.place(name, pose, np.array(data.qvel[dof : dof + 3]), turning)
            else:
                live.place(name, Pose(data.xpos[body], data.xquat[body]))


def _goals_of(facts: LiveFacts, goals: Goals) -> Array:
    """(k, 7) position and quaternion wxyz of each robot's goal; nan where it has none."""
    rows = np.full((len(facts.names), 7), np.nan)
    if goals is None:
        return rows
    if not isinstance(goals, Mapping):
        if len(facts.names) > 1:
            raise InputError(
                "a goal that is for no robot", where="goals", remedy="a mapping of names to goals"
            )
        goals = {facts.names[0]: goals}
    for name, goal in goals.items():
        if name not in facts.names:
            raise UnknownNameError("robot", name, facts.names, where="goals")
        if goal is not None:
            pose = goal.pose if isinstance(goal, LiveGoal) else goal
            rows[facts.names.index(name)] = np.concatenate([pose.position, pose.quat_wxyz])
    return rows
