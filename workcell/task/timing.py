"""The motions of a task: paths timed within torques, proved clear as timed; without one the task ends with why."""

from __future__ import annotations

import functools
from collections.abc import Sequence
from dataclasses import dataclass

from workcell.model.scene import Scene
from workcell.motion.path import Path, Trajectory, stationary
from workcell.motion.proofs.on_model import trajectory_clearance
from workcell.motion.teams.team import Team, prove_team_motion
from workcell.motion.teams.torques import TeamDynamics
from workcell.motion.timing.retime import retime
from workcell.motion.timing.torque_limits import Dynamics, TooWeakError
from workcell.motion.timing.torques import ChainDynamics, TorqueUse
from workcell.motion.tool_paths.follow import FollowLimits
from workcell.pose import Pose
from workcell.task.planning import Planning
from workcell.task.story import Story
from workcell.world.planning_world import PlanningWorld

TRACKING_ROOM = 0.001
"""Metres that a timed motion keeps clear: the tracking error that the simulation may have."""


@dataclass(frozen=True, slots=True)
class Timing:
    """A run of a task as far as paths become motions.

    Attributes:
        story: where it is told how long a motion takes, and the task ends when there is none.
        planning: what plans the paths of a team, a stretch at a time.
    """

    story: Story
    planning: Planning

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
        dynamics = ChainDynamics(self.story.scene, world.robot.name, world.attached)
        trajectory = self._fastest(path, tool_speed, dynamics, acceleration)
        proof = trajectory_clearance(
            world.robot.robot, trajectory, world.clearance, world.cover, floor=TRACKING_ROOM
        )
        if not proof.proved:
            self.story.fail("COLLISION", f"{what}: the timed motion is not clear: {proof.reason}")
        use = self._check_torques(dynamics, trajectory, world.attached, what)
        proved = self.story.if_looked_at(world, f"proved {1e3 * TRACKING_ROOM:.0f} mm clear or more")
        self.story.say(
            f"{what}: {trajectory.duration:.2f} s, {proved}, "
            f"at most {use.share.max():.0%} of {use.joint}'s effort limit"
        )
        return trajectory

    def _fastest(
        self, path: Path, tool_speed: float, dynamics: Dynamics, acceleration: float | None = None
    ) -> Trajectory:
        """The fastest motion in the simulation's time steps.

        Without regard to torques where they don't even hold the arm.
        """
        step = float(self.story.scene.model.opt.timestep)
        limited = functools.partial(retime, path, acceleration=acceleration, tool_speed=tool_speed, dt=step)
        try:
            return limited(dynamics=dynamics)
        except TooWeakError:
            # the torques are looked at afterwards, where the load that is too heavy gets its name
            return limited()

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
            self.story.log_plan(path)
        return [
            self.retime(world, path, tool_speed, what, acceleration=acceleration) for world, path in stretches
        ]

    def retime_team(
        self, team: Team, path: Path, tool_speed: float, strain: float, what: str
    ) -> tuple[Trajectory, ...]:
        """One timing for all arms: proved clear of all and of each other, within torques, the chain hardly strained."""
        dynamics = TeamDynamics.of(team)
        trajectory = self._fastest(path, tool_speed, dynamics)
        proof = prove_team_motion(team, trajectory, floor=TRACKING_ROOM)
        if not proof.proved:
            self.story.fail("COLLISION", f"{what}: the timed motion is not clear: {proof.reason}")
        stretch = float(team.stretch(trajectory.q).max())
        if stretch > strain:
            self.story.fail(
                "STRAIN",
                f"{what}: the hands would be {1e3 * stretch:.2f} mm apart from where they hold the {team.thing}. "
                "Plan with a finer spacing.",
            )
        parts = team.split(trajectory)
        for part in parts:
            held = team.worlds[part.robot_name].attached
            self._check_torques(dynamics.chains[part.robot_name], part, held, what)
        self.story.say(
            f"{what}: {trajectory.duration:.2f} s for {len(parts)} arms together, "
            f"proved {1e3 * TRACKING_ROOM:.0f} mm clear or more, "
            f"the closed chain strained by at most {1e3 * stretch:.3f} mm"
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
        """The motions of a team along stretches of its object's path, and the scene that they leave behind.

        A stretch is a team, the object's poses and what is said of it. Each begins where the one before ends,
        the first where the arms stand in `scene`: `carry`, then `retime_team`.
        """
        motions = []
        for team, poses, what in stretches:
            starts = {name: scene.robot(name).start for name in team.grasps}
            path = self.planning.carry(team, poses, starts, limits, what)
            motions.append(self.retime_team(team, path, tool_speed, strain, what))
            scene = scene.moved({team.thing: poses[-1]})
            for name, q in team.at(path.end).items():
                scene = scene.with_start(name, q)
        return motions, scene

    def _check_torques(
        self, dynamics: ChainDynamics, motion: Trajectory, held: tuple[str, Pose] | None, what: str
    ) -> TorqueUse:
        """The motion's torques; where they exceed a limit the task ends, and a load too heavy to hold is named."""
        use = dynamics.use(motion)
        if not use.kept:
            self.story.fail("TORQUE", f"{what}: {self._torque_words(dynamics, use, motion, held)}")
        return use

    def _torque_words(
        self, dynamics: ChainDynamics, use: TorqueUse, motion: Trajectory, held: tuple[str, Pose] | None
    ) -> str:
        """Which joint lacks how much, and whether it would help to move slower."""
        sentence = f"joint {use.joint} would need {float(use.share.max()):.0%} of its effort limit"
        if held is not None:
            rest = dynamics.use(stationary(motion.robot_name, motion.q[use.worst], 0.02))
            mass = sum(self.story.scene.model.body_mass[b] for b in self.story.scene.object(held[0]).body_ids)
            if not rest.kept:
                return f"{sentence}: {held[0]}, {mass:.1f} kg, is too heavy to be held there even at rest."
            sentence += f" with {held[0]}, {mass:.1f} kg, in the hand"
        return f"{sentence}. Move slower."
