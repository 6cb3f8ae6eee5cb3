"""The parts of a plan in which a mechanism moves: verified configurations, ways of its frames, motions."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np

from workcell.errors import InputError, ModelError
from workcell.ik.mechanisms.judge import judge_mechanism
from workcell.ik.mechanisms.problem import MechanismProblem, MechanismTolerances
from workcell.ik.mechanisms.result import MechanismResult
from workcell.model.mechanism.placing import place
from workcell.model.scene_mechanism import SceneMechanism
from workcell.motion.mechanisms.detour import way_between
from workcell.motion.mechanisms.follow import (
    FrameWaypoint,
    MechanismSolver,
    MechanismSteps,
    follow_mechanism,
)
from workcell.motion.mechanisms.forces import MotorForces
from workcell.motion.mechanisms.looking import look_along
from workcell.motion.mechanisms.path import MechanismMotion, MechanismPath
from workcell.motion.mechanisms.planners import mechanism_solver
from workcell.motion.mechanisms.timing import MotionLimits, time_mechanism
from workcell.pose import Array
from workcell.task.story import Story
from workcell.world.mechanism_world import MechanismWorld

LOOK_EVERY = 0.02
"""Radians or metres of a motor after which a timed motion is looked at again."""
_FORCE_SAMPLES = 200
"""Moments of a motion at which the forces of its motors are computed."""


@dataclass(frozen=True, slots=True)
class MechanismPlanning:
    """A run of a task as far as a mechanism's ways are planned.

    Attributes:
        story: where it is told what was planned, and where the questions are recorded.
        planner: name of the solver for configurations and ways.
        seed: same seed, same plan.
    """

    story: Story
    planner: str
    seed: int

    @property
    def moving(self) -> SceneMechanism:
        """The scene's mechanism; raises ModelError where there is none."""
        if self.story.scene.mechanism is None:
            raise ModelError(
                "there is no mechanism here",
                where=self.story.scene.path,
                remedy="[mechanism] in the task file",
            )
        return self.story.scene.mechanism

    @property
    def solver(self) -> MechanismSolver:
        """What answers; raises InputError for a planner that knows no mechanisms."""
        return mechanism_solver(self.planner, seed=self.seed)

    def mechanism_problem(
        self,
        *,
        touching: Sequence[tuple[str, str]] = (),
        safety_margin: float = 0.0,
        overshoot: float | None = 0.02,
        absent: Sequence[str] = (),
    ) -> MechanismProblem:
        """A question about the mechanism without goals yet, in its scene.

        Nothing touches but the pairs of geoms in `touching`. `overshoot` (metres) is how far the spheres that solvers
        see may be larger than what they stand for; None: they see none, and the judge alone says what touches. `absent`
        names floating bodies that don't count, such as what is carried.
        """
        mechanism = self.moving.without(absent) if absent else self.moving.mechanism
        if overshoot is None:
            tolerances = MechanismTolerances(safety_margin=safety_margin)
            return MechanismProblem(mechanism, touching=tuple(touching), tolerances=tolerances)
        world = MechanismWorld.of(mechanism, touching=touching, overshoot=overshoot, seed=self.seed)
        self.story.recording.log_mechanism_cover(world.cover)
        return world.problem(margin=safety_margin)

    def pose(self, problem: MechanismProblem, what: str) -> MechanismResult:
        """A verified configuration; without one the task ends with why."""
        with self.story.asking(what):
            result = self.solver(problem)
        if not result.solved or result.measured is None:
            because = f" ({'; '.join(result.rejected[:2])})" if result.rejected else ""
            self.story.fail(result.status.value, f"{what}: {result.status.sentence}{because}")
        seen = result.measured
        near = seen.clearance
        clear = (
            f", {1e3 * near.distance:.1f} mm clear ({near.pair[0]} to {near.pair[1]})" if near.pair[0] else ""
        )
        self.story.say(f"{what}: verified, by {result.solver}, ties within {seen.closure_error:.1e}{clear}")
        return result

    def follow_frames(
        self,
        problem: MechanismProblem,
        waypoints: Sequence[FrameWaypoint],
        q_start: Array,
        steps: MechanismSteps,
        what: str,
    ) -> MechanismPath:
        """A way through what is asked at the waypoints; without one the task ends with where and why."""
        with self.story.asking(what):
            result = follow_mechanism(problem, waypoints, q_start, self.solver, steps=steps)
        if result.path is None or not result.followed:
            self.story.fail(result.status.value, f"{what}: {result.failure}")
        path = result.path
        bound = "" if steps.max_link_rotation is None else f" of {steps.max_link_rotation:.2f}"
        self.story.say(
            f"{what}: {len(path)} waypoints, {result.words}, largest step of a motor {path.largest_step:.3f}, "
            f"largest link rotation {path.largest_link_rotation:.2f}{bound}"
        )
        self._log_way(path)
        return path

    def move_mechanism(
        self, problem: MechanismProblem, q_from: Array, q_to: Array, what: str
    ) -> MechanismPath:
        """A way on which motors go straight, or by one configuration between; without one the task ends with why.

        It is looked at by the compiled model wherever a number has changed by twice `LOOK_EVERY`; see `way_between`.
        """
        asked = _without_goals(problem)
        straight = MechanismPath(self.moving.mechanism, np.array([q_from, q_to]))
        path, wrong = way_between(straight, lambda q: judge_mechanism(asked, q), 2.0 * LOOK_EVERY, self.seed)
        if path is None:
            self.story.fail("NOT_FOUND", f"{what}: no way was found; on the straight one {wrong}")
        how = "straight" if len(path) == 2 else "by one configuration between"
        self.story.say(f"{what}: {how}")
        self._log_way(path)
        return path

    def _log_way(self, path: MechanismPath) -> None:
        placed = [place(path.mechanism, q) for q in path.configurations]
        for name in self.moving.frames:
            frame = path.mechanism.frame(name)
            points = np.array([one.point(frame.link, frame.T_link_frame.position) for one in placed])
            self.story.log_frame_way(name, points)

    def time_mechanism(
        self,
        problem: MechanismProblem,
        path: MechanismPath,
        what: str,
        *,
        frame_speed: Mapping[str, float] | None = None,
    ) -> MechanismMotion:
        """A timed motion along a way, within the limits of its motors; without one the task ends with why.

        It is looked at by the compiled model wherever a motor has moved by `LOOK_EVERY`: ties, limits, and contacts but
        for those that `problem` allows. That is no proof of what lies between.
        """
        moving, motors = self.moving, MotorForces(path.mechanism)
        limits = MotionLimits(moving.velocity, moving.acceleration, frame_speed or {})
        step = float(self.story.scene.model.opt.timestep)

        def share(motion: MechanismMotion) -> float:
            return float(motors.share(_forces(motors, motion)).max(initial=0.0))

        try:
            motion = time_mechanism(path, limits, step, share=share)
        except InputError as error:
            self.story.fail("TIMING", f"{what}: {error.message}")
        asked = _without_goals(problem)
        looked = look_along(motion, lambda q: judge_mechanism(asked, q), LOOK_EVERY)
        if looked.reason:
            self.story.fail("COLLISION", f"{what}: the timed motion is none that may be: {looked.reason}")
        shares = motors.share(_forces(motors, motion)).max(axis=0, initial=0.0)
        busiest = int(np.argmax(shares))
        self.story.say(
            f"{what}: {motion.duration:.2f} s, {looked.words}; at most {shares[busiest]:.0%} of the force "
            f"of {motors.names()[busiest]}"
        )
        return motion


def _without_goals(problem: MechanismProblem) -> MechanismProblem:
    """What must hold on the way: ties, limits, clearance, the user's constraints."""
    return replace(problem, goals=(), regions=(), q_reference=None, max_step=None, max_link_rotation=None)


def _forces(motors: MotorForces, motion: MechanismMotion) -> Array:
    """(k, actuators) forces at some moments of a motion."""
    compiled = motion.mechanism.compiled
    assert compiled is not None
    velocity, acceleration = motion.rates()
    rows = []
    for k in np.unique(np.linspace(0, len(motion) - 1, _FORCE_SAMPLES).astype(int)).tolist():
        qvel = np.zeros(compiled.model.nv)
        qvel[motors.dofs] = velocity[k]
        rows.append(motors.at(compiled.qpos(motion.q[k]), qvel, acceleration[k], {}).forces)
    return np.array(rows)
