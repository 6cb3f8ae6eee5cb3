"""`LiveIK`: one step for every control tick, towards goals that come while the arm moves."""

from __future__ import annotations

import functools
import importlib
import time
from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from workcell.errors import InputError, UnknownNameError
from workcell.geometry.packing import pack_shapes
from workcell.motion.live.goals import LiveGoal
from workcell.motion.live.limits import LiveLimits
from workcell.motion.live.movers import MovingObstacles
from workcell.motion.live.packing import make_desk, make_motion, pack_limbs
from workcell.motion.live.report import Reporter
from workcell.motion.live.step import Step
from workcell.motion.live.surroundings import Arms, Obstacles
from workcell.motion.live.truth import Truth
from workcell.motion.live.weights import LOSSES, WEIGHTS_A, Weights
from workcell.pose import Array, Pose, read_only
from workcell.world.planning_world import PlanningWorld

Goals = Pose | LiveGoal | None | Mapping[str, Pose | LiveGoal | None]

_SAMPLES = 4000
"""Random configurations that tell what conditioning is rare for an arm."""
_ROUNDS = 4
"""Rounds of the weighted sum in a frame."""
_ROW_ROOM = 1e-3
"""Metres that programs keep beyond the margin: what linear rows overlook is less, near by."""


@functools.cache
def _kernels() -> tuple[Any, Any, Any]:
    """Compiled kernels, imported on first use: numba takes half a second."""
    names = ("relax", "guard", "frame")
    relax, guard, frame = (importlib.import_module(f"workcell.motion.live.kernels.{name}") for name in names)
    return relax, guard, frame


class LiveIK:
    """Inverse kinematics in the loop for one or several robots of a scene.

    Every call of `step` is one control tick. It answers with a state within all limits from which the arms can come to
    rest clear of everything, whatever the goal is. Nothing is trained: what a frame needs is packed once.

    Args:
        worlds: what the robots' planners see (`PlanningWorld.of`, `.holding`), one a robot, of one scene.
        period: seconds of a control tick.
        weights: of the weighted sum, changeable with every step.
        loss: a name of `LOSSES`.
        limits: of the joints; None: the robots' own velocity and acceleration, which is reached within a tenth of a
            second. Accelerations that are not known are ten times the velocity.
        moving: objects or bodies of the scene that move by themselves; tell where they are by `place`.
        margin: metres that the guard's spheres keep from everything.
        q_start: (n,) where the arms are; None: where the scene has them.
        deadline_s: seconds after which a frame looks for nothing better; None: work alone ends it, so that the same
            input gives the same steps.
        stale_s: seconds of the goal's own clock (`stamp`) without news after which a goal no longer counts.
        singular_share: share of an arm's random configurations that count as singular.

    Attributes:
        robot: the robots as one tree, or the only one itself.
        names: the robots' names; limits, period, margin, moving: as given.
        least_conditioning: (k,) below which a tool counts as singular.

    Raises:
        InputError: what makes no sense, by name; UnknownNameError: a mover that is not there.
    """

    def __init__(
        self,
        worlds: PlanningWorld | Sequence[PlanningWorld],
        *,
        period: float = 0.02,
        weights: Weights = WEIGHTS_A,
        loss: str = "groove",
        limits: LiveLimits | None = None,
        moving: Sequence[str] = (),
        margin: float = 0.0,
        q_start: ArrayLike | None = None,
        deadline_s: float | None = None,
        stale_s: float = 0.5,
        singular_share: float = 0.025,
    ) -> None:
        self._arms = Arms.of([worlds] if isinstance(worlds, PlanningWorld) else list(worlds))
        self.robot, self.names = self._arms.robot, self._arms.names
        if loss not in LOSSES:
            raise UnknownNameError("loss", loss, LOSSES)
        for name, value, valid in (
            ("period", period, 1e-5 <= period <= 1.0),
            ("margin", margin, 0.0 <= margin < np.inf),
            ("deadline_s", deadline_s, deadline_s is None or deadline_s > 0.0),
            ("stale_s", stale_s, stale_s > 0.0),
            ("singular_share", singular_share, 0.0 <= singular_share < 1.0),
        ):
            if not valid:
                raise InputError(f"{name} is {value}", where=name, remedy="see LiveIK")
        self.period, self.margin, self._deadline, self._stale = period, margin, deadline_s, stale_s
        self._weights, self._loss, self.moving = weights, loss, tuple(moving)
        self.limits = limits or _own_limits(self.robot)
        if len(self.limits.velocity) != self.robot.dof:
            raise InputError(
                f"limits of {len(self.limits.velocity)} joints for {self.robot.dof}", where="limits"
            )
        start = self._start() if q_start is None else self.robot.configuration(q_start, where="q_start")
        self._pack(Obstacles.of(self._arms, moving), start, singular_share)
        self.reset(start)

    def _start(self) -> Array:
        return np.concatenate([world.robot.start for world in self._arms.worlds])

    def _pack(self, obstacles: Obstacles, start: Array, singular_share: float) -> None:
        relax, _, frame = _kernels()
        pairs = self._arms.pairs(start)
        self._limbs, row_of = pack_limbs(self.robot, self._arms.tools, self._arms.cover, pairs, self.limits)
        self._movers = MovingObstacles(self._arms.worlds[0].scene, obstacles)
        shapes = pack_shapes(obstacles.standing)
        tools, n = len(self._arms.tools), self.robot.dof
        skipped = np.zeros((len(self._arms.cover), len(obstacles.standing)), dtype=np.bool_)
        self._around = relax.Surroundings(
            shapes, self._movers.packed, skipped, np.array([self.margin, _ROW_ROOM]), np.zeros(tools)
        )
        self._desk, self._motion = make_desk(self._limbs), make_motion(self._limbs)
        gaps = np.zeros(skipped.shape)
        frame.gaps_at(self._limbs, self._around, self._desk, start, gaps)
        # what the spheres overlap as the robot begins is the cover's overshoot, or in contact: the model itself tells
        skipped[:] = gaps <= 0.0
        order = np.array(shapes.order)
        covered = np.ones((len(row_of), len(obstacles.standing)), dtype=np.bool_)
        covered[:, order] = ~skipped[row_of]
        self._truth = Truth(self._arms, obstacles, pairs, covered)
        self._wish, self._mine = (
            relax.Wish(np.zeros((tools, 26)), np.zeros(8), np.zeros((3, n)), np.zeros((tools, 3)))
            for _ in range(2)
        )
        self._mine = self._mine._replace(goals=self._wish.goals, weights=self._wish.weights)
        sampled = np.empty((_SAMPLES, tools))
        draws = self.robot.random_configuration(np.random.default_rng(0), _SAMPLES)
        frame.ratios(self._limbs, self._around, self._desk, draws, sampled)
        self.least_conditioning = read_only(np.quantile(sampled, singular_share, axis=0))
        self._around.least[:] = self.least_conditioning if singular_share > 0 else 0.0
        self._window = (
            np.array([v * v / (2 * a) + v * a / (2 * j) for v, a, j in self._limbs.rates.T])
            + self.limits.velocity * self.period
        )
        self._velocity_step = np.minimum(self.limits.velocity, 1e9) * self.period
        self._low, self._high = np.zeros(n), np.zeros(n)
        self._report = Reporter(self._arms, self._limbs, obstacles, shapes.order, row_of)

    # ---- the state -------------------------------------------------------------------------------------------

    @property
    def q(self) -> Array:
        """(n,) where the joints are said to be now."""
        return np.array(self._motion.now[0])

    @property
    def qd(self) -> Array:
        """(n,) their velocities."""
        return np.array(self._motion.now[1])

    @property
    def qdd(self) -> Array:
        """(n,) their accelerations."""
        return np.array(self._motion.now[2])

    def columns(self, robot: str) -> slice:
        """Where a robot's joints stand in `q`; raises UnknownNameError."""
        if robot not in self.names:
            raise UnknownNameError("robot", robot, self.names)
        return self._arms.slices[self.names.index(robot)]

    def reset(self, q: ArrayLike) -> None:
        """The arms stand at q (n,), at rest; goals are forgotten.

        Raises:
            InputError: joint values of the wrong shape, not finite, or outside of the limits.
        """
        here = self.robot.configuration(q, where="q")
        if not np.all((here >= self.robot.lower) & (here <= self.robot.upper)):
            self.robot.check_limits(here)
            here = np.clip(here, self.robot.lower, self.robot.upper)
        _, _, frame = _kernels()
        self._motion.now[:] = 0.0
        self._motion.now[0] = here
        self._motion.next[:] = self._motion.now
        self._motion.wanted[0], self._motion.wanted[1] = here, 0.0
        for wish in (self._wish, self._mine):
            wish.past[:] = here
        self._wish.goals[:, 25] = 0.0
        frame.commit(self._limbs, self._around, self._wish, self._mine, self._desk, self._motion)
        self._stamp: float | None = None
        self._unheard = 0.0
        self._truth.start(here)

    def place(
        self,
        name: str,
        pose: Pose,
        velocity: ArrayLike | None = None,
        angular_velocity: ArrayLike | None = None,
    ) -> None:
        """Where a moving obstacle is now, and how it moves.

        Args:
            name: one of `moving`.
            pose: `T_world_body` of its root body.
            velocity, angular_velocity: (3,) in the world; None: from where it was a tick ago, at rest at first.

        Raises:
            UnknownNameError: nothing of that name moves; InputError: velocities that are not three finite numbers.
        """
        self._movers.place(name, pose, velocity, angular_velocity, self.period)

    # ---- the step --------------------------------------------------------------------------------------------

    def step(self, goals: Goals, *, weights: Weights | None = None, stamp: float | None = None) -> Step:
        """One control tick.

        Args:
            goals: of the only robot, or of robots by name; None, or a robot that is left out: no goal.
            weights: from now on.
            stamp: seconds of the goal's own clock. One that does not advance for `stale_s` of ticks, runs backwards or
                is no number makes the goal count as none, and the arm brakes.

        Raises:
            InputError: goals that are none; UnknownNameError: a robot that is not there. The state stays as it was.
        """
        began = time.perf_counter()
        if weights is not None:
            self._weights = weights
        reason = self._read_goals(goals) or self._read_stamp(stamp)
        if reason:
            self._wish.goals[:, 25] = 0.0
        relax, guard, frame = _kernels()
        self._wish.weights[:7], self._wish.weights[7] = self._weights.array, float(self._loss == "quadratic")
        timed_out = False
        motion, wish = self._motion, self._wish
        if np.any(wish.goals[:, 25]):
            timed_out = self._relax(relax, began)
        else:
            motion.wanted[:] = np.nan
        guard.guard(self._limbs, self._around, wish, self._desk, motion, self.period)
        refused = self._truth.refuses(motion, self._limbs, self.period)
        if refused:
            motion.next[:] = motion.stop
        frame.commit(self._limbs, self._around, wish, self._mine, self._desk, motion)
        self._movers.advance(self.period)
        return self._report.step(
            motion,
            self._desk,
            self.limits,
            self.least_conditioning,
            reason,
            refused,
            timed_out,
            time.perf_counter() - began,
        )

    def _relax(self, relax: Any, began: float) -> bool:
        """The relaxed solution moves on, no farther from the arm than it takes to stop; whether time ran out."""
        past, now, motion = self._wish.past[0], self._motion.now[0], self._motion
        np.maximum(past - self._velocity_step, now - self._window, out=self._low)
        np.minimum(past + self._velocity_step, now + self._window, out=self._high)
        np.clip(self._low, self._limbs.bounds[0], self._limbs.bounds[1], out=self._low)
        np.clip(self._high, self._low, self._limbs.bounds[1], out=self._high)
        wanted, timed_out = motion.wanted[0], False
        wanted[:] = past
        chunk = _ROUNDS if self._deadline is None else 1
        for _ in range(0, _ROUNDS, chunk):
            if self._deadline is not None and time.perf_counter() - began > self._deadline:
                timed_out = True
                break
            left = relax.relax(
                self._limbs,
                self._around,
                self._wish,
                self._desk,
                self._low,
                self._high,
                wanted,
                self.period,
                chunk,
            )
            if left == 0.0:
                break
        np.subtract(wanted, past, out=motion.wanted[1])
        motion.wanted[1] /= self.period
        return timed_out

    def _read_goals(self, goals: Goals) -> str:
        """Write the goals down for the kernels; why there is none, or an empty text."""
        if goals is None:
            return "no goal was given"
        if isinstance(goals, (Pose, LiveGoal)):
            if len(self.names) > 1:
                raise InputError(
                    "one goal for several robots", where="goals", remedy="a goal by robot's name"
                )
            named: Mapping[str, Pose | LiveGoal | None] = {self.names[0]: goals}
        elif isinstance(goals, Mapping):
            named = goals
        else:
            raise InputError(f"{type(goals).__name__} is no goal", where="goals", remedy="a Pose or LiveGoal")
        for name, goal in named.items():
            if name not in self.names:
                raise UnknownNameError("robot", name, self.names, where="goals")
            if goal is not None and not isinstance(goal, (Pose, LiveGoal)):
                raise InputError(
                    f"{type(goal).__name__} is no goal", where=f"goals[{name!r}]", remedy="a Pose or LiveGoal"
                )
        rows, any_goal = self._wish.goals, False
        for t, name in enumerate(self.names):
            goal = named.get(name)
            rows[t, 25] = 0.0
            if goal is None:
                continue
            pose = goal if isinstance(goal, Pose) else goal.pose
            rows[t, :9] = pose.rotation.ravel()
            rows[t, 9:12] = pose.position
            rows[t, 12] = 1.0
            rows[t, 13:25] = 0.0
            if isinstance(goal, LiveGoal):
                rows[t, 12] = goal.weight
                rows[t, 13:16], rows[t, 19:22] = goal.position_band.T
                rows[t, 16:19], rows[t, 22:25] = goal.rotation_band.T
            rows[t, 25] = float(rows[t, 12] > 0.0)
            any_goal = any_goal or rows[t, 12] > 0.0
        return "" if any_goal else "no goal was given"

    def _read_stamp(self, stamp: float | None) -> str:
        """Follow the goal's own clock; why the goal doesn't count, or an empty text."""
        if stamp is None:
            self._stamp, self._unheard = None, 0.0
            return ""
        if not np.isfinite(stamp):
            self._unheard += self.period
            return f"the goal's clock says {stamp}"
        if self._stamp is None or stamp > self._stamp:
            self._stamp, self._unheard = float(stamp), 0.0
            return ""
        self._unheard += self.period
        if stamp < self._stamp:
            return f"the goal's clock runs backwards, from {self._stamp:.6g} to {stamp:.6g} s"
        return f"no new goal for {self._unheard:.3g} s" if self._unheard > self._stale else ""


def _own_limits(robot: Any) -> LiveLimits:
    """The robot's own; what is not known is chosen: velocities of 2, and accelerations of ten times the velocity."""
    velocity = np.where(np.isfinite(robot.velocity), robot.velocity, 2.0)
    acceleration = np.where(np.isfinite(robot.acceleration), robot.acceleration, 10.0 * velocity)
    return LiveLimits.of(velocity, acceleration)
