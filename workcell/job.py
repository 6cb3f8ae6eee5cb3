"""`Job`: one run of a task: its scene, its seed, its recording, its summary file, and the story it tells while it runs."""

from __future__ import annotations

import functools
import time
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import dataclass, field, replace
from typing import Any, NoReturn

import numpy as np

from workcell.ahead import compiling_seconds
from workcell.ik.problem import IKProblem
from workcell.ik.result import IKResult
from workcell.ik.solve import solve
from workcell.ik.why_not import explain
from workcell.model.scene import Scene
from workcell.motion.body import Upright
from workcell.motion.dynamics import ChainDynamics, TooWeakError, TorqueUse
from workcell.motion.follow import FollowLimits, follow, local_solver, step_solver
from workcell.motion.path import Path, Trajectory, stationary
from workcell.motion.plan import PlanSettings
from workcell.motion.proof import trajectory_clearance
from workcell.motion.reach import reach
from workcell.motion.retime import retime
from workcell.motion.route import route
from workcell.motion.team import Team, carry, prove_team_motion
from workcell.motion.team_dynamics import TeamDynamics
from workcell.motion.toolpath import PathTolerance
from workcell.motion.world import PlanningWorld
from workcell.motion.worldplan import plan_in_world
from workcell.pose import Array, Pose
from workcell.record.asking import asks
from workcell.record.recording import Recording
from workcell.record.summary import write_json_atomic
from workcell.script import TaskFailedError
from workcell.simulate.execution import Execution
from workcell.simulate.simulation import Simulation

TRACKING_ROOM = 0.001
"""Metres that a timed motion keeps clear: the tracking error that the simulation may have."""
MOVING = PlanSettings(clearance=0.002, iterations=6000)
"""How joint motions between two configurations are planned."""
LOOKING = replace(MOVING, iterations=1000, attempts=1)
"""How hard it is tried to get to a configuration that is one of several."""


@dataclass(slots=True)
class Job:
    """What a task script gets.

    Attributes:
        scene: the compiled scene of the task file.
        planner: name of the solver for configurations and paths.
        controller: name of what drives the motors (`workcell.simulate.controller.CONTROLLERS`).
        seed: same seed, same plan.
        recording: the open `.rrd`.
        tell: where lines of the story go.
        summary: what `DIR/<task>.json` will hold.
        began: `time.perf_counter()` when the run began.
        sim_time: seconds simulated so far, the time of the events that are logged.
        ways: tool positions (k, 3) of the plans logged so far, by the robot's name.
        trying: whether what is planned now is a try (see `can`).
    """

    scene: Scene
    planner: str
    controller: str
    seed: int
    recording: Recording
    tell: Callable[[str], None]
    summary: dict[str, Any]
    began: float
    sim_time: float = 0.0
    ways: dict[str, list[Array]] = field(default_factory=dict)
    trying: bool = False

    def say(self, text: str, level: str = "INFO") -> None:
        """One line of the story, on the terminal and in the recording's log."""
        if self.trying:
            return
        self.recording.event(self.sim_time, text, level)
        self.tell(f"[{time.perf_counter() - self.began:6.2f} s] {text}")

    @contextmanager
    def phase(self, name: str) -> Iterator[None]:
        """Time a phase; the summary gets `<name>_s`, summed over phases of one name, without what compiling kernels took."""
        start = time.perf_counter() - compiling_seconds()
        try:
            yield
        finally:
            key = f"{name}_s"
            self.summary[key] = self.summary.get(key, 0.0) + time.perf_counter() - compiling_seconds() - start

    def fail(self, status: str, sentence: str) -> NoReturn:
        """End the task as not achieved."""
        raise TaskFailedError(status, sentence)

    @asks
    def solve(self, problem: IKProblem, what: str) -> IKResult:
        """A verified configuration; without one the task ends with a proof and what is in the way, where there is a proof."""
        result = solve(problem, solver=self.planner, seed=self.seed)
        if not result.solved:
            self._refuse(problem, result, what)
        first, second = result.clearance.pair
        self.say(f"{what}: verified, {1e3 * result.clearance.distance:.0f} mm clear ({first} to {second})")
        return result

    def _refuse(self, problem: IKProblem, result: IKResult, what: str) -> NoReturn:
        """End the task. What the planner did not find, the portfolio decides; a proof is kept, explained and drawn."""
        decided = result if result.status.is_impossible else solve(problem, seed=self.seed)
        if decided.certificate is None or not decided.status.is_proof:
            because = f" ({'; '.join(result.rejected[:2])})" if result.rejected else ""
            hint = f" {decided.solver} finds one: try --planner auto." if decided.solved else ""
            self.fail(result.status.value, f"{what}: {result.status.sentence}{because}{hint}")
        self.say(f"{what}: proved impossible: {decided.certificate.statement}")
        why = explain(problem, decided, seed=self.seed)
        self.summary |= {"why": why.to_json(), "proof": decided.certificate.statement}
        folder = self.recording.path.parent
        write_json_atomic(folder / f"{self.scene.name}.certificate.json", decided.certificate.to_json())
        if problem.cover is not None:
            nearest = None if why.closest is None else why.closest.q
            self.recording.log_blame(why.pieces, problem.robot, problem.cover, nearest)
        self.fail(decided.status.value, f"{what}: {decided.status.sentence} In short: {why.sentence}.")

    @asks
    def follow(
        self,
        world: PlanningWorld,
        poses: Sequence[Pose],
        q_start: Array,
        limits: FollowLimits,
        what: str,
        *,
        tolerance: PathTolerance | None = None,
    ) -> Path:
        """A continuous joint path along tool poses, by fast local steps; without one the task ends with the reason and place."""
        problem, rescue = world.problem(poses[0]), step_solver(self.planner, seed=self.seed)
        solver = local_solver(problem, tolerance=tolerance, limits=limits, rescue=rescue, seed=self.seed)
        result = follow(problem, poses, q_start, tolerance=tolerance, limits=limits, solver=solver)
        if result.path is None or not result.followed:
            where = "" if result.failure is None else f" {result.failure.words}"
            self.fail(result.status.value, f"{what}{where}. {result.status.sentence}")
        self._tell_path(result.path, limits, what)
        return result.path

    @asks
    def trace(
        self,
        world: PlanningWorld,
        poses: Sequence[Pose],
        limits: FollowLimits,
        what: str,
        *,
        tolerance: PathTolerance | None = None,
        q_start: Array | None = None,
        begins: Callable[[Array], object] | None = None,
    ) -> Path:
        """A continuous joint path along tool poses, from the start that leads all the way (or from the given one).

        Of the starts (n,) one is taken for which `begins`, a part of the plan, can be made; None: to which the robot can
        `move` from where it stands.
        """
        begins = begins or functools.partial(self._begin, world)
        result = route(
            world.problem(poses[0]),
            poses,
            q_start,
            q_near=world.robot.start,
            begins=functools.partial(self.can, begins) if q_start is None else None,
            tolerance=tolerance,
            limits=limits,
            solver=self.planner,
            seed=self.seed,
        )
        for line in result.tried:
            self.say(f"{what}: {line}")
        if result.path is None or result.metrics is None or not result.followed:
            where = "" if result.failure is None else f" {result.failure.words}"
            self.fail(result.status.value, f"{what}{where}. {result.status.sentence}")
        metrics = result.metrics
        self.say(
            f"{what}: {metrics.waypoints} waypoints, largest step {metrics.largest_step:.3f} rad, half-way at most "
            f"{1e3 * metrics.deviation_m:.2f} mm off, manipulability {1e3 * metrics.manipulability:.2f}e-3 or more, "
            f"{metrics.limit_distance:.2f} rad or more from limits, proved {1e3 * metrics.clearance_between:.0f} mm clear"
        )
        return result.path

    @asks
    def move(self, world: PlanningWorld, q_from: Array, q_to: Array, what: str) -> Path:
        """A collision-free joint path between two configurations; without one the task ends with the reason."""
        settings = LOOKING if self.trying else MOVING
        found = plan_in_world(world, q_from, q_to, settings=settings, seed=self.seed)
        if found.path is None:
            self.fail(found.status.value, f"{what}: {found.detail}. {found.status.sentence}")
        self.say(f"{what}: {len(found.path)} waypoints, proved clear")
        return found.path

    def _begin(self, world: PlanningWorld, q: Array) -> Path:
        return self.move(world, world.robot.start, q, "way to the start")

    def can(self, plan: Callable[..., object], *arguments: object) -> bool:
        """Whether a part of the plan, such as `move`, can be made: a quick try that is not told and does not end the task."""
        self.trying = True
        try:
            plan(*arguments)
        except TaskFailedError:
            return False
        finally:
            self.trying = False
        return True

    @asks
    def reach(
        self,
        world: PlanningWorld,
        q_start: Array,
        inward: Sequence[Pose],
        limits: FollowLimits,
        what: str,
        *,
        others: Sequence[Sequence[Pose]] = (),
        upright: Upright | None = None,
    ) -> Path:
        """A continuous path from where the robot stands along tool poses; without one the task ends with the reason.

        `others` would do as well as `inward`: the first that can be followed without a detour is taken. `upright` keeps an
        axis of the tool within a cone all along: for what must not tilt, or would slip if it did.
        """
        ways = [inward, *others]
        result = reach(
            world, q_start, ways, limits=limits, upright=upright, solver=self.planner, seed=self.seed
        )
        if result.path is None:
            status = "NOT_FOUND" if result.ik is None or result.ik.solved else result.ik.status.value
            self.fail(status, f"{what}: {'; '.join(result.failures)}")
        self._tell_path(result.path, limits, f"{what} ({result.how})")
        return result.path

    def _tell_path(self, path: Path, limits: FollowLimits, what: str) -> None:
        self.say(
            f"{what}: {len(path)} waypoints, largest step {path.largest_step:.3f} rad, "
            f"proved at least {1e3 * limits.clearance:.0f} mm clear all along"
        )

    def retime(
        self,
        world: PlanningWorld,
        path: Path,
        tool_speed: float,
        what: str,
        *,
        acceleration: float | None = None,
    ) -> Trajectory:
        """A timed motion along a path: its own clearance proved, its torques within the joints' limits.

        `acceleration` (radians a second squared, of each joint) replaces the robot's own limits, for what may spill.
        """
        dynamics = ChainDynamics(self.scene, world.robot.name, world.attached)
        try:
            trajectory = retime(path, acceleration=acceleration, tool_speed=tool_speed, dynamics=dynamics)
        except TooWeakError:
            # the torques are looked at below, where the load that is too heavy gets its name
            trajectory = retime(path, acceleration=acceleration, tool_speed=tool_speed)
        proof = trajectory_clearance(
            world.robot.robot, trajectory, world.clearance, world.cover, floor=TRACKING_ROOM
        )
        if not proof.proved:
            self.fail("COLLISION", f"{what}: the timed motion is not clear: {proof.reason}")
        use = self._check_torques(dynamics, trajectory, world.attached, what)
        self.say(
            f"{what}: {trajectory.duration:.2f} s, proved {1e3 * TRACKING_ROOM:.0f} mm clear or more, at most {use.share.max():.0%} of {use.joint}'s effort limit"
        )
        return trajectory

    def timed(
        self,
        stretches: Sequence[tuple[PlanningWorld, Path]],
        tool_speed: float,
        what: str,
        *,
        acceleration: float | None = None,
    ) -> list[Trajectory]:
        """The motions along stretches of one way, each as `retime` makes it in its own world; the way is logged."""
        for _, path in stretches:
            self.log_plan(path)
        return [
            self.retime(world, path, tool_speed, what, acceleration=acceleration) for world, path in stretches
        ]

    @asks
    def carry(
        self, team: Team, poses: Sequence[Pose], starts: Mapping[str, Array], limits: FollowLimits, what: str
    ) -> Path:
        """A proved path of all arms that hold an object, along the object's poses; without one the task ends with why."""
        result = carry(team, poses, starts, limits=limits, solver=self.planner, seed=self.seed)
        if result.path is None or result.proof is None:
            status = "COLLISION" if result.proof is not None else "NOT_FOUND"
            self.fail(status, f"{what}: {result.failure}")
        self.say(
            f"{what}: {len(result.path)} waypoints of {len(team.grasps)} arms, largest step "
            f"{result.path.largest_step:.3f} rad, proved at least {1e3 * result.proof.margin:.0f} mm clear all along"
        )
        for name in team.grasps:
            self._log_way(name, team.tools(name, result.path.configurations))
        return result.path

    def retime_team(
        self, team: Team, path: Path, tool_speed: float, strain: float, what: str
    ) -> tuple[Trajectory, ...]:
        """One timing for all arms: proved clear of everything and of each other, within torques, the chain hardly strained."""
        dynamics = TeamDynamics.of(team)
        try:
            trajectory = retime(path, tool_speed=tool_speed, dynamics=dynamics)
        except TooWeakError:
            # as for one arm: the load that is too heavy gets its name below
            trajectory = retime(path, tool_speed=tool_speed)
        proof = prove_team_motion(team, trajectory, floor=TRACKING_ROOM)
        if not proof.proved:
            self.fail("COLLISION", f"{what}: the timed motion is not clear: {proof.reason}")
        stretch = float(team.stretch(trajectory.q).max())
        if stretch > strain:
            self.fail(
                "STRAIN",
                f"{what}: the hands would be {1e3 * stretch:.2f} mm apart from where they hold the {team.thing}. "
                "Plan with a finer spacing.",
            )
        parts = team.split(trajectory)
        for part in parts:
            held = (team.thing, team.grasps[part.robot_name].inverse())
            self._check_torques(dynamics.chains[part.robot_name], part, held, what)
        self.say(
            f"{what}: {trajectory.duration:.2f} s for {len(parts)} arms together, proved {1e3 * TRACKING_ROOM:.0f} mm clear or "
            f"more, the closed chain strained by at most {1e3 * stretch:.3f} mm"
        )
        return parts

    def transport(
        self,
        scene: Scene,
        stretches: Sequence[tuple[Team, Sequence[Pose], str]],
        limits: FollowLimits,
        tool_speed: float,
        strain: float,
    ) -> tuple[list[tuple[Trajectory, ...]], Scene]:
        """The motions of a team along stretches of its object's path (team, poses, what), and the scene that they leave behind.

        Each begins where the one before ends, the first where the arms stand in `scene`: `carry`, then `retime_team`.
        """
        motions = []
        for team, poses, what in stretches:
            starts = {name: scene.robot(name).start for name in team.grasps}
            path = self.carry(team, poses, starts, limits, what)
            motions.append(self.retime_team(team, path, tool_speed, strain, what))
            scene = scene.moved({team.thing: poses[-1]})
            for name, q in team.at(path.end).items():
                scene = scene.with_start(name, q)
        return motions, scene

    def _check_torques(
        self, dynamics: ChainDynamics, motion: Trajectory, held: tuple[str, Pose] | None, what: str
    ) -> TorqueUse:
        """The motion's torques; where they exceed a limit the task ends, and a load that can't even be held is named."""
        use = dynamics.use(motion)
        if not use.kept:
            self.fail("TORQUE", f"{what}: {self._torque_words(dynamics, use, motion, held)}")
        return use

    def _torque_words(
        self, dynamics: ChainDynamics, use: TorqueUse, motion: Trajectory, held: tuple[str, Pose] | None
    ) -> str:
        """Which joint lacks how much, and whether it would help to move slower."""
        sentence = f"joint {use.joint} would need {float(use.share.max()):.0%} of its effort limit"
        if held is not None:
            rest = dynamics.use(stationary(motion.robot_name, motion.q[use.worst], 0.02))
            mass = sum(self.scene.model.body_mass[b] for b in self.scene.object(held[0]).body_ids)
            if not rest.kept:
                return f"{sentence}: {held[0]}, {mass:.1f} kg, is too heavy to be held there even at rest."
            sentence += f" with {held[0]}, {mass:.1f} kg, in the hand"
        return f"{sentence}. Move slower."

    def log_world(self, world: PlanningWorld) -> None:
        """Sphere cover and free space into the recording, their numbers into the story."""
        self.recording.log_cover(world.robot, world.cover, self.scene.initial_qpos())
        self.recording.log_free_space(world.free_space)
        self.say(
            f"{self.scene.name}: {len(world.obstacles)} obstacle pieces, {len(world.cover)} robot spheres, "
            f"{len(world.free_space)} free-space cuboids"
        )

    def log_plan(self, path: Path) -> None:
        """A planned way of the tool into the recording, after those that were planned for this robot before."""
        self._log_way(path.robot.name, path.robot.fk_transform(path.configurations))

    def _log_way(self, robot: str, tools: Array) -> None:
        """Tool poses (k, 4, 4) behind those that were logged for this robot before."""
        self.ways.setdefault(robot, []).append(tools[:, :3, 3])
        self.recording.log_plan(robot, np.concatenate(self.ways[robot]))

    def simulation(self) -> Simulation:
        """A simulation of the scene that logs into the recording."""
        return Simulation(self.scene, controller=self.controller, on_chunk=self._log_chunk)

    def tool_trace(self, simulation: Simulation, begin: float, end: float) -> Array:
        """(k, 3) where the tool was, in the world, between two moments of the simulation (seconds)."""
        rows = simulation.result()
        points: Array = rows.tool_position[(rows.time >= begin) & (rows.time <= end)]
        return points

    def _log_chunk(self, chunk: Execution) -> None:
        self.recording.log_execution(chunk)
        if len(chunk):
            self.sim_time = float(chunk.time[-1])
        for event in chunk.events:
            self.tell(f"[{time.perf_counter() - self.began:6.2f} s] at {event.time:5.2f} s: {event.text}")

    def judge(self, simulation: Simulation, conditions: Mapping[str, bool]) -> None:
        """Write what the simulation measured into the summary; the task fails unless every condition holds.

        Beside the given conditions: the run was not stopped, nothing touched that should not, clearance stayed at
        or above zero.
        """
        execution = simulation.result()
        pair = execution.min_clearance_pair
        self.summary.update(
            simulated_s=simulation.time,
            min_clearance_m=execution.min_clearance,
            min_clearance_pair=list(pair),
            max_tracking_error_m=float(execution.tracking_error_m.max(initial=0.0)),
            unintended_contacts=len(execution.contacts),
        )
        if execution.stop is not None:
            self.fail(
                execution.stop.reason.value, f"{execution.stop.reason.sentence} {execution.stop.detail}"
            )
        checks = {
            "no unintended contact": not execution.contacts,
            "clearance never below zero": execution.min_clearance >= 0.0,
            **conditions,
        }
        self.summary["conditions"] = checks
        missed = [name for name, holds in checks.items() if not holds]
        if missed:
            self.fail("FAILED", f"The job was executed, but: not {'; not '.join(missed)}.")
