"""`Simulation`: trajectories executed in MuJoCo by controllers, grasps, guards, and a log of all that happens."""

from __future__ import annotations

from collections.abc import Collection, Iterable, Mapping, Sequence

import numpy as np

from workcell.errors import InputError, UnknownNameError
from workcell.model.scene_parts import SceneRobot
from workcell.motion.path import Trajectory
from workcell.pose import Array, Pose
from workcell.simulate.arm import Arm
from workcell.simulate.checks import check_free_hand, checked_motions, checked_seconds, checked_share
from workcell.simulate.execution import StopReason
from workcell.simulate.grasp import Hand, Weld, finger_speed
from workcell.simulate.live.following import Follower
from workcell.simulate.meeting import Mover, first_meeting
from workcell.simulate.runner import Settings
from workcell.simulate.watch import Held, Hold

__all__ = ["Settings", "Simulation"]

_STILL = 2e-3
"""Speed of a finger (metres a second) below which it rests."""


class Simulation(Follower):
    """The robots of a scene in motion. Methods return whether they succeeded; after a stop they do nothing.

    Every robot of the scene is controlled; one that is not ordered to move holds its place. A method that acts on one
    robot takes its name; None means the one that this simulation was made for.

    Args:
        scene: the scene; its model is copied.
        robot: the robot meant where none is named; None: the only one.
        controller: a name of `CONTROLLERS`.
        imperfections: errors, noise and pushes; None: a perfect cell.
        settings: gains, guards, logging.
        on_chunk: called with the rows of the last `chunk_s` seconds while the simulation runs.

    Attributes:
        arms: the robots in motion, by name.
        model, data: MuJoCo's own, for what no method tells: the copy of the scene's model, and the state now.
        stop: why the run ended early, or None.
        unproved: for every order under which two robots are not proved clear of each other, who meets whom and when.

    Raises:
        UnknownNameError: no such robot, controller, or pushed body; ModelError: motors that are none.
    """

    # ---- what the caller asks -----------------------------------------------------------------------------------

    @property
    def robot(self) -> SceneRobot:
        """The robot that is meant where none is named."""
        return self.arm().robot

    @property
    def q(self) -> Array:
        """(n,) its joints now."""
        return np.array(self.data.qpos[self.robot.qpos_addresses])

    @property
    def q_reference(self) -> Array:
        """(n,) where its joints should be now: plan the next motion from here."""
        return np.array(self.arm().reference)

    def holding(self, robot: str | None = None) -> Held | None:
        """What a robot's hand holds and how, or None."""
        return self._watch.held.get(self.arm(robot).name)

    @property
    def held(self) -> str | None:
        """Name of the object in the hand, or None."""
        held = self.holding()
        return None if held is None else held.thing.name

    @property
    def T_tool_object(self) -> Pose | None:
        """How the held object stood in the tool's frame at the grasp, or None."""
        held = self.holding()
        return None if held is None else held.T_tool_object

    @property
    def supports(self) -> frozenset[int]:
        """Geom ids that the held object stood on when it was grasped and has not left yet."""
        held = self.holding()
        return frozenset() if held is None else held.supports

    def slip(self, robot: str | None = None) -> float:
        """How far the held object has moved in the hand since the grasp, metres; 0 without one."""
        held = self.holding(robot)
        return 0.0 if held is None else self._watch.slip(held)

    def object_pose(self, name: str) -> Pose:
        """World pose of an object now; raises UnknownNameError."""
        body = self.scene.object(name).body_id
        data = self.data
        return Pose(data.xpos[body], data.xquat[body])

    def tool_pose(self, robot: str | None = None) -> Pose:
        """`T_world_tool` of a robot now."""
        return self.arm(robot).tool_pose(self.data)

    def touches(self, name: str) -> frozenset[int]:
        """Ids of the geoms, not of the robots, that touch an object now; raises UnknownNameError."""
        return self._watch.touched_by(self._watch.geoms_of(name))

    def stands_on(self, name: str, body: str) -> bool:
        """Whether an object touches a body, and no robot; raises UnknownNameError."""
        mine = self._watch.geoms_of(name)
        below = self._watch.geoms([self._watch.body(body)])
        robots = self._watch.geoms({b for arm in self.arms.values() for b in arm.robot.body_ids})
        return self._watch.touching(mine, below) and not self._watch.touching(mine, robots)

    def apart(self, name: str, body: str) -> bool:
        """Whether an object has left a body: their bounding boxes, along the world's axes, don't overlap.

        Raises:
            UnknownNameError: no such object or body.
        """
        mine = self._watch.bounds(self.scene.object(name).body_ids)
        other = self._watch.bounds({self._watch.body(body)})
        return bool(np.any(mine[0] > other[1]) or np.any(mine[1] < other[0]))

    # ---- what the caller orders ---------------------------------------------------------------------------------

    def execute(self, motion: Trajectory | Sequence[Trajectory], label: str = "") -> bool:
        """Track a trajectory that begins where the reference stands now, or several at once, one for each robot.

        A single trajectory is for the robot that it names, or for the only one. Robots without a trajectory, and those
        whose trajectory ends before the others', hold their place. Where there are several robots, all of them are
        proved clear of each other first, moving as they are told (`workcell.simulate.meeting`); where that fails the
        log and `unproved` say so, and who meets whom, and the guards watch.

        Raises:
            InputError: no trajectory or two for one robot, a time step that is not the simulation's, another robot's
                joints, another start, a base that stands elsewhere than was planned for, or motions at once of a robot
                and of one that stands on it.
            UnknownNameError: a robot that the scene doesn't have.
        """
        motions = checked_motions(motion, len(self.arms))
        references = self._still()
        for trajectory in motions:
            one = self.arm(trajectory.robot_name if len(self.arms) > 1 else None)
            references[one.name] = one.follow(trajectory, self.timestep, self.data)
        if self.stop is not None:
            return False
        self._check_meeting({name: reference.q for name, reference in references.items()})
        steps = max(len(trajectory) for trajectory in motions)
        if label:
            self.log(f"{label}: {(steps - 1) * self.timestep:.2f} s")
        ordered = {
            self.arm(trajectory.robot_name if len(self.arms) > 1 else None).name for trajectory in motions
        }
        self._anchored = self._bases_at_rest(ordered)
        done = self._run(references, steps)
        self._anchored = {}
        return done

    def _bases_at_rest(self, ordered: Collection[str]) -> dict[str, Array]:
        """Where the bases of robots in motion stand that should stay there, though they could move."""
        carriers = [self.arms[name].robot for name in ordered]
        carried = frozenset[int]().union(*(robot.guest_ids for robot in carriers))
        return {
            name: self.arms[name].base_matrix(self.data)
            for name in ordered
            if self.arms[name].rides and not self.arms[name].robot.own_ids & carried
        }

    def _check_meeting(self, wanted: Mapping[str, Array]) -> None:
        if len(self.arms) < 2:
            return
        movers = {}
        for name, q in wanted.items():
            held = self._watch.held.get(name)
            carried = None if held is None else (held.thing, held.T_tool_object)
            movers[name] = Mover(self.arms[name].robot.standing(self.model, self.data.qpos), q, carried)
        meeting = first_meeting(self.scene, movers, self.qpos, self._watch.expected)
        if meeting is not None:
            self.unproved.append(meeting.sentence(self.timestep))
            self.log(f"{self.unproved[-1]}; no proof covers both of these motions", "WARN")

    def hold(self, seconds: float) -> bool:
        """Stand still; raises InputError for a negative duration."""
        steps = self._steps(checked_seconds(seconds))
        return self.stop is None and self._run(self._still(), steps + 1)

    def move_gripper(self, opening: float, robot: str | None = None) -> bool:
        """Move a gripper's set point to a share of its range: 0 closed, 1 open.

        Raises:
            ModelError: the robot has no gripper; InputError: a share outside [0, 1].
        """
        hand = self.arm(robot).gripper()
        target = hand.closed + checked_share(opening, "opening") * (hand.open - hand.closed)
        return self._move_actuator(hand.actuator, target, self.settings.close_s)

    def actuate(self, actuator: str, share: float, seconds: float = 1.0) -> bool:
        """Move the set point of an actuator of the cell, a chuck or a door, to a share of its range.

        Raises:
            UnknownNameError: no such actuator, or a robot's; InputError: a share outside [0, 1], a negative duration.
        """
        names = self.scene.actuators()
        if actuator not in names:
            raise UnknownNameError("actuator", actuator, names, where=self.scene.path)
        low, high = self.model.actuator_ctrlrange[names[actuator]]
        target = low + checked_share(share, "share") * (high - low)
        return self._move_actuator(names[actuator], target, checked_seconds(seconds))

    def grasp(self, name: str, robot: str | None = None, *, hold: Hold = "weld") -> bool:
        """Close a gripper on an object and hold it; stops the run when the fingers don't both touch it.

        Args:
            name: the object's.
            robot: whose hand.
            hold: `weld`: rigidly, from the moment at which both fingers rest on it; `friction`: by the fingers'
                contact forces alone, so that it may slip, which is watched.

        Raises:
            UnknownNameError, ModelError: no such object, no gripper, no weld for the two, or no such way to hold.
            InputError: the hand holds something.
        """
        arm = self._free_hand(name, robot, hold)
        if self.stop is not None:
            return False
        hand, mine = arm.gripper(), self._watch.geoms_of(name)
        self.log(f"{self._whose(arm)}closing the gripper on the {name}")
        self._watch.expect(self._watch.geoms(hand.bodies), mine)
        if not (self.move_gripper(0.0, robot) and self._wait_for_grip(hand, mine)):
            return False
        self._take(arm, name, hold)
        how = "held by both fingers" if hold == "weld" else "held by the fingers' friction"
        self.log(f"{self._whose(arm)}the {name} is {how}")
        return True

    def attach(self, name: str, robot: str | None = None) -> bool:
        """Hold an object rigidly as it stands now, as a tool changer does: no finger moves.

        Several hands may hold one object: the chain is closed then, and each controller carries its share.

        Raises:
            UnknownNameError, ModelError: no such object, no gripper, or no weld for the two.
            InputError: the hand holds something.
        """
        arm = self._free_hand(name, robot, "weld")
        if self.stop is not None:
            return False
        self._watch.expect(self._watch.geoms(arm.gripper().bodies), self._watch.geoms_of(name))
        self._take(arm, name, "weld")
        self.log(f"{self._whose(arm)}the {name} is attached to the hand")
        return True

    def _free_hand(self, name: str, robot: str | None, hold: str) -> Arm:
        """A robot whose hand is free to hold an object; raises as `grasp`."""
        arm = self.arm(robot)
        arm.gripper()
        Weld.of(self.model, arm.robot, self.scene.object(name))
        if self.stop is None:
            check_free_hand(arm.name, self._watch.held, hold)
        return arm

    def _take(self, arm: Arm, name: str, hold: Hold) -> None:
        thing = self.scene.object(name)
        weld = Weld.of(self.model, arm.robot, thing)
        supports = self._watch.touched_by(self._watch.geoms_of(name))
        T_hand_object = weld.close(self.model, self.data) if hold == "weld" else weld.relative_pose(self.data)
        T_tool_object = arm.tool_pose(self.data).inverse() @ self.object_pose(name)
        self._watch.take(arm.name, Held(thing, weld, T_hand_object, T_tool_object, supports, hold))
        self._share_load(name)

    def _share_load(self, name: str) -> None:
        """Every hand that holds an object carries the same share of it."""
        hands = [(robot, held) for robot, held in self._watch.held.items() if held.thing.name == name]
        for robot, held in hands:
            model = self.arms[robot].controller.arm
            model.carry(held.weld.hand_body, held.thing.body_ids, self.data, 1.0 / len(hands))

    def expect_contact(self, name: str, body: str) -> None:
        """Contact between an object and a body of the scene is intended from now on, e.g. to put it down there.

        Raises:
            UnknownNameError: no such object or body.
        """
        self._watch.expect(self._watch.geoms_of(name), self._watch.geoms([self._watch.body(body)]))

    def release(self, robot: str | None = None, *, opening: float = 1.0) -> bool:
        """Let go of the object and open the gripper by a share of its range; the open hand may still touch it.

        After a stop it does nothing, like every order.

        Raises:
            InputError: the hand holds nothing, or a share outside [0, 1].
        """
        arm, held = self.arm(robot), self.holding(robot)
        checked_share(opening, "opening")
        if self.stop is not None:
            return False
        if held is None:
            raise InputError("the hand holds nothing", where="release")
        held.weld.release(self.data)
        self._watch.let_go(arm.name)
        self.log(f"{self._whose(arm)}released the {held.thing.name}")
        return self._open(arm, held, opening)

    def _open(self, arm: Arm, held: Held, opening: float) -> bool:
        """Open the gripper; the object is carried on until it stands on something, or the fingers have left it."""
        hand, mine = arm.gripper(), self._watch.geoms_of(held.thing.name)
        fingers = self._watch.geoms(frozenset[int]().union(*hand.fingers))
        target = hand.closed + opening * (hand.open - hand.closed)
        carried, still = True, self._still()
        for value in np.linspace(
            self.data.ctrl[hand.actuator], target, self._steps(self.settings.close_s) + 1
        )[1:]:
            stands = bool(self._watch.touched_by(mine)) or not self._watch.touching(fingers, mine)
            if carried and (stands or value == target):
                carried = False
                arm.controller.arm.drop(held.weld.hand_body)
                self._share_load(held.thing.name)
            self.data.ctrl[hand.actuator] = value
            if not self._run(still, 2):
                return False
        return True

    def _wait_for_grip(self, hand: Hand, mine: Iterable[int]) -> bool:
        """Hold until every finger rests on the object."""
        fingers = [self._watch.geoms(finger) for finger in hand.fingers]
        for _ in range(max(round(self.settings.settle_s / 0.02), 1)):
            if not self.hold(0.02):
                return False
            touching = [self._watch.touching(finger, mine) for finger in fingers]
            if all(touching) and finger_speed(self.data, hand) < _STILL:
                return True
        detail = f"{sum(touching)} of {len(fingers)} fingers touch the object"
        self._stop(StopReason.NO_GRASP, detail)
        self.flush()
        return False
