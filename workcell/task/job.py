"""`Job`: what a task script gets: one run of its task, which is told, planned and timed by a part each."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from contextlib import AbstractContextManager
from typing import Any, NoReturn

from workcell.errors import InputError
from workcell.ik.mechanisms.problem import MechanismProblem
from workcell.ik.mechanisms.result import MechanismResult
from workcell.ik.problem import IKProblem
from workcell.ik.result import IKResult
from workcell.model.scene import Scene
from workcell.model.scene_mechanism import SceneMechanism
from workcell.motion.body import Upright
from workcell.motion.live.stream import GoalStream
from workcell.motion.mechanisms.follow import FrameWaypoint, MechanismSteps
from workcell.motion.mechanisms.path import MechanismMotion, MechanismPath
from workcell.motion.path import Path, Trajectory
from workcell.motion.teams.team import Team
from workcell.motion.tool_paths.follow import FollowLimits
from workcell.motion.tool_paths.poses import PathTolerance
from workcell.pose import Array, Pose
from workcell.record.write.recording import Recording
from workcell.simulate.live.solver import GoalSource, LiveSolver
from workcell.simulate.live.view import HOW, LiveView
from workcell.simulate.mechanisms.simulation import MechanismSimulation
from workcell.simulate.runner import Runner, Settings
from workcell.simulate.simulation import Simulation
from workcell.task.mechanisms import MechanismPlanning
from workcell.task.planning import Planning
from workcell.task.story import Story
from workcell.task.timing import Timing
from workcell.world.planning_world import PlanningWorld


class Job:
    """One run of a task. Its methods are those of its parts, which say in full what each does.

    Attributes:
        story: what the run says, measures and judges.
        planning: verified configurations and proved paths.
        timing: paths as motions.
        mechanisms: configurations, ways and motions of the scene's mechanism.
        controller: name of what drives the motors (`workcell.simulate.controller.CONTROLLERS`).
    """

    __slots__ = ("_stream", "_window", "controller", "mechanisms", "planning", "story", "timing")

    def __init__(
        self,
        scene: Scene,
        planner: str,
        controller: str,
        seed: int,
        recording: Recording,
        tell: Callable[[str], None],
        summary: dict[str, Any],
        began: float,
        stream: GoalStream | None = None,
        window: Callable[[Scene], LiveView] | None = None,
    ) -> None:
        self._stream, self._window = stream, window
        self.story = Story(scene, recording, tell, summary, began)
        self.planning = Planning(self.story, planner, seed)
        self.timing = Timing(self.story, self.planning)
        self.mechanisms = MechanismPlanning(self.story, planner, seed)
        self.controller = controller

    # ---- the run ----------------------------------------------------------------------------------------------------

    @property
    def scene(self) -> Scene:
        """The compiled scene of the task file."""
        return self.story.scene

    @property
    def planner(self) -> str:
        """Name of the solver for configurations and paths."""
        return self.planning.planner

    @property
    def seed(self) -> int:
        """Same seed, same plan."""
        return self.planning.seed

    @property
    def recording(self) -> Recording:
        """The open `.rrd`."""
        return self.story.recording

    @property
    def summary(self) -> dict[str, Any]:
        """What `DIR/<task>.json` will hold."""
        return self.story.summary

    @summary.setter
    def summary(self, summary: dict[str, Any]) -> None:
        """Lets a script write `job.summary |= {...}`."""
        self.story.summary = summary

    @property
    def sim_time(self) -> float:
        """Seconds simulated so far."""
        return self.story.sim_time

    @property
    def trying(self) -> bool:
        """Whether what is planned now is a try (see `can`)."""
        return self.story.trying

    @property
    def stream(self) -> GoalStream:
        """The recorded poses to follow, on a clock that begins at 0; raises InputError where a task has none."""
        if self._stream is None:
            raise InputError(
                "this task names no trace",
                where=self.scene.path,
                remedy='[task] trace = "FILE", or --trace FILE',
            )
        return self._stream

    # ---- what is told, measured and judged --------------------------------------------------------------------------

    def say(self, text: str, level: str = "INFO") -> None:
        """One line of the story, on the terminal and in the recording's log."""
        self.story.say(text, level)

    def phase(self, name: str) -> AbstractContextManager[None]:
        """Time a phase; the summary gets `<name>_s`."""
        return self.story.phase(name)

    def fail(self, status: str, sentence: str) -> NoReturn:
        """End the task as not achieved."""
        self.story.fail(status, sentence)

    def log_world(self, world: PlanningWorld) -> None:
        """Sphere cover and free space into the recording, their numbers into the story."""
        self.story.log_world(world)

    def log_plan(self, path: Path) -> None:
        """A planned way of the tool into the recording."""
        self.story.log_plan(path)

    def simulation(self) -> Simulation:
        """A simulation of the scene that logs into the recording."""
        return Simulation(self.scene, controller=self.controller, on_chunk=self.story.log_chunk)

    def follow_goals(
        self, simulation: Simulation, live: LiveSolver, goals: GoalSource, seconds: float, label: str
    ) -> bool:
        """`Simulation.follow`, in a window with a target to drag where one was asked for (`workcell run --view`)."""
        if self._window is None:
            return simulation.follow(live, goals, seconds, label)
        with self._window(self.scene) as view:
            self.say(f"a window is open: {HOW}")
            return simulation.follow(live, view.goals(goals), seconds, label, each=view.watch(simulation))

    def mechanism_simulation(self, settings: Settings | None = None) -> MechanismSimulation:
        """A simulation of the scene's mechanism that logs into the recording."""
        return MechanismSimulation(self.scene, settings=settings, on_chunk=self.story.log_chunk)

    def tool_trace(self, simulation: Simulation, begin: float, end: float) -> Array:
        """(k, 3) where the tool was, in the world, between two moments of the simulation (seconds)."""
        return self.story.tool_trace(simulation, begin, end)

    def judge(self, simulation: Runner, conditions: Mapping[str, bool]) -> None:
        """What the simulation measured into the summary; the task fails unless every condition holds."""
        self.story.judge(simulation, conditions)

    # ---- what is planned --------------------------------------------------------------------------------------------

    def solve(self, problem: IKProblem, what: str) -> IKResult:
        """A verified configuration."""
        return self.planning.solve(problem, what)

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
        """A continuous joint path along tool poses, by the planner's steps."""
        return self.planning.follow(world, poses, q_start, limits, what, tolerance=tolerance)

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
        """A continuous joint path along tool poses, from the start that leads all the way (or from the given one)."""
        return self.planning.trace(
            world, poses, limits, what, tolerance=tolerance, q_start=q_start, begins=begins
        )

    def move(self, world: PlanningWorld, q_from: Array, q_to: Array, what: str) -> Path:
        """A collision-free joint path between two configurations."""
        return self.planning.move(world, q_from, q_to, what)

    def can(self, plan: Callable[..., object], *arguments: object) -> bool:
        """Whether a part of the plan, such as `move`, can be made: a quick try that does not end the task."""
        return self.planning.can(plan, *arguments)

    def reach(
        self,
        world: PlanningWorld,
        q_start: Array,
        inward: Sequence[Pose],
        limits: FollowLimits,
        what: str,
        *,
        goal: Array | None = None,
        others: Sequence[Sequence[Pose]] = (),
        upright: Upright | None = None,
    ) -> Path:
        """A continuous path from where the robot stands along tool poses, to a goal configuration if one is given."""
        return self.planning.reach(
            world, q_start, inward, limits, what, goal=goal, others=others, upright=upright
        )

    def carry(
        self, team: Team, poses: Sequence[Pose], starts: Mapping[str, Array], limits: FollowLimits, what: str
    ) -> Path:
        """A proved path of all arms that hold an object, along the object's poses."""
        return self.planning.carry(team, poses, starts, limits, what)

    # ---- what a mechanism does --------------------------------------------------------------------------------------

    @property
    def mechanism(self) -> SceneMechanism:
        """The scene's mechanism."""
        return self.mechanisms.moving

    def mechanism_problem(
        self,
        *,
        touching: Sequence[tuple[str, str]] = (),
        safety_margin: float = 0.0,
        overshoot: float | None = 0.02,
        absent: Sequence[str] = (),
    ) -> MechanismProblem:
        """A question about the mechanism without goals yet: nothing touches but the pairs of geoms in `touching`."""
        return self.mechanisms.mechanism_problem(
            touching=touching, safety_margin=safety_margin, overshoot=overshoot, absent=absent
        )

    def pose(self, problem: MechanismProblem, what: str) -> MechanismResult:
        """A verified configuration of the mechanism."""
        return self.mechanisms.pose(problem, what)

    def follow_frames(
        self,
        problem: MechanismProblem,
        waypoints: Sequence[FrameWaypoint],
        q_start: Array,
        steps: MechanismSteps,
        what: str,
    ) -> MechanismPath:
        """A continuous way of the mechanism through what is asked of its frames at the waypoints."""
        return self.mechanisms.follow_frames(problem, waypoints, q_start, steps, what)

    def move_mechanism(
        self, problem: MechanismProblem, q_from: Array, q_to: Array, what: str
    ) -> MechanismPath:
        """A way of the mechanism between two configurations: motors straight, or by one configuration between."""
        return self.mechanisms.move_mechanism(problem, q_from, q_to, what)

    def time_mechanism(
        self,
        problem: MechanismProblem,
        path: MechanismPath,
        what: str,
        *,
        frame_speed: Mapping[str, float] | None = None,
    ) -> MechanismMotion:
        """A timed motion of the mechanism along a way, looked at by the compiled model, within its motors' limits."""
        return self.mechanisms.time_mechanism(problem, path, what, frame_speed=frame_speed)

    # ---- what is timed ----------------------------------------------------------------------------------------------

    def retime(
        self,
        world: PlanningWorld,
        path: Path,
        tool_speed: float,
        what: str,
        *,
        acceleration: float | None = None,
    ) -> Trajectory:
        """A timed motion along a path: its own clearance proved, its torques within the joints' limits."""
        return self.timing.retime(world, path, tool_speed, what, acceleration=acceleration)

    def timed(
        self,
        stretches: Sequence[tuple[PlanningWorld, Path]],
        tool_speed: float,
        what: str,
        *,
        acceleration: float | None = None,
    ) -> list[Trajectory]:
        """The motions along stretches of one way, each as `retime` makes it in its own world; the way is logged."""
        return self.timing.timed(stretches, tool_speed, what, acceleration=acceleration)

    def retime_team(
        self, team: Team, path: Path, tool_speed: float, strain: float, what: str
    ) -> tuple[Trajectory, ...]:
        """One timing for all arms that hold an object."""
        return self.timing.retime_team(team, path, tool_speed, strain, what)

    def transport(
        self,
        scene: Scene,
        stretches: Sequence[tuple[Team, Sequence[Pose], str]],
        limits: FollowLimits,
        tool_speed: float,
        strain: float,
    ) -> tuple[list[tuple[Trajectory, ...]], Scene]:
        """The motions of a team along stretches of its object's path, and the scene that they leave behind."""
        return self.timing.transport(scene, stretches, limits, tool_speed, strain)
