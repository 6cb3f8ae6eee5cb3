"""`LiveIK`: one step for every control tick, towards goals that come while the arm moves."""

from __future__ import annotations

import functools
import importlib
import time
from collections.abc import Sequence
from typing import Any, Literal

import numpy as np
from numpy.typing import ArrayLike, NDArray

from workcell.errors import InputError, UnknownNameError
from workcell.geometry.packing import pack_shapes
from workcell.motion.live.limits import LiveLimits
from workcell.motion.live.movers import MovingObstacles
from workcell.motion.live.never import never_touch
from workcell.motion.live.objective import Objective
from workcell.motion.live.optimisers import OPTIMISERS, Gradient, Minimiser
from workcell.motion.live.packing import make_desk, make_motion, pack_limbs
from workcell.motion.live.reading import NO_GOAL, GoalClock, GoalReader, Goals
from workcell.motion.live.report import Reporter
from workcell.motion.live.step import Step
from workcell.motion.live.surroundings import Arms, Index, Obstacles
from workcell.motion.live.truth import Truth
from workcell.motion.live.weights import LOSSES, WEIGHTS_A, Weights
from workcell.pose import Array, Pose, read_only
from workcell.world.planning_world import PlanningWorld

Mask = NDArray[np.bool_]
Solver = Literal["compiled", "slsqp", "mma", "ccsaq", "cobyla", "bobyqa"]

_SAMPLES = 4000
"""Random configurations that tell what conditioning is rare for an arm."""
_ROUNDS = 4
"""Rounds of the weighted sum in a frame."""
_NEAR = 0.02
"""Metres below which links that are often so near are asked whether they can touch at all."""
_ASKED = 0.01
"""Metres below which links that are often so near are told apart by the model, not by spheres."""
_FEW = 200
"""Random configurations that tell which links are always near a base."""
_SHY = 2e-3
"""Metres of clearance to itself at which the collision term of an arm is a quarter, where it is often farther apart."""
_ROW_ROOM = 3e-3
"""Metres that programs keep beyond the margin: what linear rows overlook is less, near by."""


@functools.cache
def _kernels() -> tuple[Any, Any, Any, Any]:
    """Compiled kernels, imported on first use: numba takes half a second."""
    names = ("relax", "guard", "commit", "frame")
    relax, guard, commit, frame = (
        importlib.import_module(f"workcell.motion.live.kernels.{name}") for name in names
    )
    return relax, guard, commit, frame


class LiveIK:
    """Inverse kinematics in the loop for one or several robots of a scene.

    Every call of `step` is one control tick. It answers with a state within all limits from which the arms can come to
    rest clear of all that stands and of themselves, whatever the goal is; to what moves they give way. Nothing is
    trained: what a frame needs is packed once.

    Args:
        worlds: what the robots' planners see (`PlanningWorld.of`, `.holding`), one a robot, of one scene.
        period: seconds of a control tick.
        weights: of the weighted sum, changeable with every step.
        loss: a name of `LOSSES`.
        solver: of the weighted sum: ours, or one of NLopt's (the paper's, for comparison; the extra `live`). The guard
            is the same.
        gradient: that NLopt's solvers take, where they take one.
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

    least_conditioning: Array
    _frame: Any
    _desk: Any
    _wish: Any

    def __init__(
        self,
        worlds: PlanningWorld | Sequence[PlanningWorld],
        *,
        period: float = 0.02,
        weights: Weights = WEIGHTS_A,
        loss: str = "groove",
        solver: Solver = "compiled",
        gradient: Gradient = "analytic",
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
        for what, name, known in (
            ("loss", loss, LOSSES), ("solver", solver, ("compiled", *OPTIMISERS)),
            ("gradient", gradient, ("analytic", "differences")),
        ):  # fmt: skip
            if name not in known:
                raise UnknownNameError(what, name, known, where=what)
        for name, value, valid in (
            ("period", period, 1e-5 <= period <= 1.0),
            ("margin", margin, 0.0 <= margin < np.inf),
            ("deadline_s", deadline_s, deadline_s is None or deadline_s > 0.0),
            ("stale_s", stale_s, stale_s > 0.0),
            ("singular_share", singular_share, 0.0 <= singular_share < 1.0),
        ):
            if not valid:
                raise InputError(f"{name} is {value}", where=name, remedy="see LiveIK")
        self.period, self.margin, self.moving, self._deadline = period, margin, tuple(moving), deadline_s
        self.limits = limits or _own_limits(self.robot)
        if len(self.limits.velocity) != self.robot.dof:
            raise InputError(
                f"limits of {len(self.limits.velocity)} joints for {self.robot.dof}", where="limits"
            )
        start = self._start() if q_start is None else self.robot.configuration(q_start, where="q_start")
        self.robot.check_limits(start, where="q_start")
        self._clock = GoalClock(period, stale_s)
        obstacles, pairs = Obstacles.of(self._arms, moving), self._arms.pairs(start, margin)
        ignored = obstacles.ignored(self._arms)
        self._pack(obstacles, pairs, ignored, set(), start)
        gaps = self._sample(singular_share)
        # links that are always near would hold the arm where spheres are all that is known of them
        always = {(int(a), int(b)) for a, b in np.argwhere(gaps < _NEAR) if a < b}
        near_bases = self._near_bases(obstacles)
        always |= {(0, int(link)) for link in self._arms.cover.link[near_bases.any(axis=1)]}
        never = never_touch(self._arms, always)
        asked = {(a, b) for a, b in always if a and gaps[a, b] < _ASKED} | never
        links = np.sort(self._arms.cover.link[pairs], axis=1)
        kept = np.array([(int(a), int(b)) not in asked for a, b in links], dtype=bool)
        self._pack(obstacles, pairs[kept], ignored | near_bases, never, start)
        gaps = self._sample(singular_share)
        self._limbs.shy[:] = np.clip(0.1 * gaps, 1e-4, _SHY)
        self.least_conditioning = read_only(self.least_conditioning)
        self._weigh(weights)
        self._wish.weights[7] = float(loss == "quadratic")
        if solver != "compiled":
            self._minimise = Minimiser(solver, self.robot.dof, gradient=gradient)
            self._objective = Objective(self._frame, self._desk.box)
        self._solver = solver
        self.reset(start)
        # what is not compiled yet is compiled here, and not in a frame
        self._relax(np.inf)
        self._guard()
        self.reset(start)

    def _start(self) -> Array:
        return np.concatenate([world.robot.start for world in self._arms.worlds])

    def _pack(
        self, obstacles: Obstacles, pairs: Index, ignored: Mask, never: set[tuple[int, int]], start: Array
    ) -> None:
        _, _, commit, frame = _kernels()
        self._limbs, row_of = pack_limbs(self.robot, self._arms.tools, self._arms.cover, pairs, self.limits)
        self._movers = MovingObstacles(self._arms.worlds[0].scene, obstacles)
        shapes = pack_shapes(obstacles.standing)
        tools = len(self._arms.tools)
        skipped = np.zeros((len(self._arms.cover), len(obstacles.standing)), dtype=np.bool_)
        keep, self.least_conditioning = np.array([self.margin, _ROW_ROOM]), np.zeros(tools)
        around = frame.Surroundings(shapes, self._movers.packed, skipped, keep, self.least_conditioning)
        self._wish, mine = (_no_wish(frame.Wish, tools, self.robot.dof) for _ in range(2))
        mine = mine._replace(goals=self._wish.goals, weights=self._wish.weights)
        self._desk = make_desk(self._limbs, len(obstacles.standing))
        self._motion = make_motion(self._limbs)
        self._past = (self._wish.past, mine.past)
        self._frame = frame.make_frame(self._limbs, around, self._wish, mine, self._desk, self._motion)
        gaps = np.zeros(skipped.shape)
        commit.gaps_at(self._frame, start, gaps)
        # what the spheres overlap as the robot begins, or have within the margin, is the cover's overshoot, or in
        # contact: the model itself tells
        order = np.array(shapes.order)
        skipped[:] = gaps <= self.margin
        skipped[row_of] |= ignored[:, order]
        self._row_of, self._order = row_of, order
        covered = np.ones((len(row_of), len(obstacles.standing)), dtype=np.bool_)
        covered[:, order] = ~skipped[row_of]
        self._truth = Truth(self._arms, obstacles, pairs, covered, never)
        self._report = Reporter(self._arms, obstacles, shapes.order, row_of)
        self._goals = GoalReader(self.names, self._frame, self._wish.goals, commit.set_goal)

    def _sample(self, share: float) -> Array:
        """How near links usually are; conditioning below which few configurations are counts as singular."""
        ratios = np.empty((_SAMPLES, len(self.names)))
        gaps = np.empty((_SAMPLES, *self._limbs.shy.shape))
        draws = self.robot.random_configuration(np.random.default_rng(0), _SAMPLES)
        _kernels()[2].sample(self._frame, draws, ratios, gaps)
        if share > 0:
            self.least_conditioning[:] = np.quantile(ratios, share, axis=0)
        usual: Array = np.median(gaps, axis=0)
        return usual

    def _near_bases(self, obstacles: Obstacles) -> Mask:
        """(s, k) spheres of links that are always near a base, and that base's pieces."""
        cover, based = self._arms.cover, np.flatnonzero(np.array(obstacles.bases, dtype=np.int64) >= 0)
        near = np.zeros((len(cover), len(obstacles.standing)), dtype=np.bool_)
        gaps, found = np.empty(near.shape), np.empty((_FEW, self.robot.joint_count + 1, len(based)))
        packed, links = np.argsort(self._order), np.unique(cover.link)
        for row, q in zip(
            found, self.robot.random_configuration(np.random.default_rng(1), _FEW), strict=True
        ):
            _kernels()[2].gaps_at(self._frame, q, gaps)
            here = gaps[self._row_of][:, packed[based]]
            for link in links:
                row[link] = here[cover.link == link].min(axis=0, initial=np.inf)
        for link in links:
            usual = np.median(found[:, link], axis=0)
            near[np.ix_(cover.link == link, based)] = usual < _ASKED
        return near

    def _weigh(self, weights: Weights) -> None:
        self._weights = weights
        self._wish.weights[:7] = weights.array

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
        self.robot.check_limits(here)
        here = np.clip(here, self.robot.lower, self.robot.upper)
        commit = _kernels()[2].commit
        motion = self._motion
        motion.now[:] = 0.0
        motion.now[0] = here
        motion.next[:], motion.stop[:] = motion.now, motion.now
        motion.wanted[0], motion.wanted[1] = here, 0.0
        self._desk.held[0] = 0
        motion.used[0], motion.limited[:], motion.report[:] = 0, 0, 0.0
        for past in self._past:
            past[:] = here
        self._goals.forget()
        self._clock.reset()
        commit(self._frame, False)

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
        if weights is not None and weights is not self._weights:
            self._weigh(weights)
        reason = self._goals.read(goals)
        if stamp is not None or self._clock.heard:
            reason = reason or self._clock.read(stamp)
        commit = _kernels()[2]
        motion, timed_out = self._motion, False
        self._movers.catch_up()
        if reason:
            if reason is not NO_GOAL:
                self._goals.forget()
            motion.wanted[:] = np.nan
        else:
            timed_out = self._relax(began)
        refused = self._guard()
        commit.commit(self._frame, refused != "")
        self._movers.advance(self.period)
        return self._report.step(motion, reason, refused, timed_out, time.perf_counter() - began)

    def _guard(self) -> str:
        """The step that is carried out; by whose distances it is refused, empty: by none."""
        _kernels()[1].guard(self._frame, self.period)
        return self._truth.refuses(self._frame, self._limbs, self._motion, self.period)

    def _relax(self, began: float) -> bool:
        """The relaxed solution moves on, no farther from the arm than it takes to stop; whether time ran out."""
        relax, frame, period = _kernels()[0].relax, self._frame, self.period
        if self._solver != "compiled":
            relax(frame, period, 0, True)
            self._motion.wanted[0] = self._minimise(self._objective, self._motion.wanted[0])
            relax(frame, period, 0, False)
            return False
        if self._deadline is None:
            relax(frame, period, _ROUNDS, True)
            return False
        for done in range(_ROUNDS):
            if done > 0 and time.perf_counter() - began > self._deadline:
                return True
            if relax(frame, period, 1, done == 0) == 0.0:
                break
        return False


def _no_wish(kind: Any, tools: int, dof: int) -> Any:
    return kind(np.zeros((tools, 26)), np.zeros(8), np.zeros((3, dof)), np.zeros((tools, 3)))


def _own_limits(robot: Any) -> LiveLimits:
    """The robot's own; what is not known is chosen: velocities of 2, and accelerations of ten times the velocity."""
    velocity = np.where(np.isfinite(robot.velocity), robot.velocity, 2.0)
    acceleration = np.where(np.isfinite(robot.acceleration), robot.acceleration, 10.0 * velocity)
    return LiveLimits.of(velocity, acceleration)
