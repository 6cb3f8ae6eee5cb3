"""Goals of a mechanism's frames followed waypoint by waypoint, each a question bound to the one before it.

After section VIII of IKSPARK, for mechanisms: each joint within `max_step` of the previous configuration, each link's
world rotation within `max_link_rotation` (Eq. 75). A waypoint that can't be reached in one such step is approached by
halves, where its goals and those before it are of one kind.
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field, replace

import numpy as np

from workcell.errors import InputError
from workcell.ik.mechanisms.goals import FrameGoal, InRegion
from workcell.ik.mechanisms.problem import MechanismProblem
from workcell.ik.mechanisms.result import MechanismResult
from workcell.ik.result import Status
from workcell.model.mechanism.mechanism import Mechanism
from workcell.model.mechanism.placing import place
from workcell.motion.mechanisms.path import MechanismPath
from workcell.pose import Array, axis_angle_to_matrix, rotation_vector

MechanismSolver = Callable[[MechanismProblem], MechanismResult]
"""Answers one question about a mechanism."""


@dataclass(frozen=True, slots=True)
class MechanismSteps:
    """What a way must keep from each configuration to the next.

    Attributes:
        max_step: largest change of each number of the tangent, radians or metres.
        max_link_rotation: bound on the change of each link's world rotation (Frobenius, Eq. 75); None: none.
        max_halvings: how often the distance between two waypoints may be halved.
    """

    max_step: float | Array = 0.4
    max_link_rotation: float | None = 0.28
    max_halvings: int = 5

    def __post_init__(self) -> None:
        if not np.all(np.asarray(self.max_step) > 0) or not (self.max_link_rotation or 1.0) > 0:
            raise InputError("bounds on steps must be positive", where="steps")


@dataclass(frozen=True, slots=True)
class FrameWaypoint:
    """What is asked at one waypoint."""

    goals: tuple[FrameGoal, ...] = ()
    regions: tuple[InRegion, ...] = ()

    def halfway(self, other: FrameWaypoint) -> FrameWaypoint | None:
        """What is asked half-way to another; None: the two ask different things of different frames."""
        goals = [_goal_between(a, b) for a, b in zip(self.goals, other.goals, strict=False)]
        regions = [_region_between(a, b) for a, b in zip(self.regions, other.regions, strict=False)]
        alike = len(self.goals) == len(other.goals) and len(self.regions) == len(other.regions)
        if not alike or None in goals or None in regions:
            return None
        return FrameWaypoint(
            tuple(goal for goal in goals if goal is not None),
            tuple(region for region in regions if region is not None),
        )


@dataclass(frozen=True, slots=True)
class MechanismFollowed:
    """What became of a way.

    Attributes:
        path: the way, or as far as it got; None: not even its first waypoint was reached.
        failure: why it ended early, in words; empty: it did not.
        status: SOLVED, or that of the last answer.
        solved: how many questions were answered.
        by: how many of the path's configurations are whose, by the solver's name.
    """

    path: MechanismPath | None
    failure: str
    status: Status
    solved: int
    by: Mapping[str, int] = field(default_factory=dict)

    @property
    def followed(self) -> bool:
        """Whether the whole way was followed."""
        return not self.failure and self.path is not None

    @property
    def words(self) -> str:
        """Who answered, and how many."""
        return ", ".join(f"{count} by {solver}" for solver, count in self.by.items())


def follow_mechanism(
    template: MechanismProblem,
    waypoints: Sequence[FrameWaypoint],
    q_start: Array,
    solver: MechanismSolver,
    *,
    steps: MechanismSteps | None = None,
) -> MechanismFollowed:
    """A way of a mechanism through waypoints, from a configuration (size,) in which it stands.

    Args:
        template: mechanism, obstacles, cover, constraints and tolerances; goals, regions, and the reference with its
            bounds are replaced.
        waypoints: what is asked, one after the other; where the way begins is not among them.
        q_start: (size,).
        solver: answers one question; its answers are judged.
        steps: bounds from each configuration to the next.

    Raises:
        InputError: no waypoint, or a start that is no configuration.
    """
    if not waypoints:
        raise InputError("a way takes at least one waypoint", where="waypoints")
    begin = template.mechanism.configuration(q_start, where="q_start")
    return _Follower(template, solver, steps or MechanismSteps(), begin).run(waypoints)


class _Follower:
    def __init__(
        self, template: MechanismProblem, solver: MechanismSolver, steps: MechanismSteps, begin: Array
    ) -> None:
        self._template, self._solver, self._steps = template, solver, steps
        self._way, self._by = [begin], Counter[str]()
        self._solved, self._last = 0, Status.SOLVED
        self._why = ""

    def run(self, waypoints: Sequence[FrameWaypoint]) -> MechanismFollowed:
        before = _standing(self._template.mechanism, self._way[0], waypoints[0])
        for k, waypoint in enumerate(waypoints):
            if not self._reach(before, waypoint, 0):
                return self._ended(f"waypoint {k + 1} of {len(waypoints)}: {self._why}")
            before = waypoint
        return self._ended("")

    def _ended(self, failure: str) -> MechanismFollowed:
        path = None
        if len(self._way) > 1:
            path = MechanismPath(self._template.mechanism, np.array(self._way))
        return MechanismFollowed(path, failure, self._last, self._solved, dict(self._by))

    def _reach(self, before: FrameWaypoint | None, waypoint: FrameWaypoint, depth: int) -> bool:
        """One step to a waypoint; where that fails, first half of it, then the rest."""
        result = self._ask(waypoint)
        if result.solved and result.q is not None:
            self._way.append(np.array(result.q))
            self._by[result.solver] += 1
            return True
        halfway = None if before is None else before.halfway(waypoint)
        if halfway is None or depth >= self._steps.max_halvings:
            return False
        return self._reach(before, halfway, depth + 1) and self._reach(halfway, waypoint, depth + 1)

    def _ask(self, waypoint: FrameWaypoint) -> MechanismResult:
        steps = self._steps
        problem = replace(
            self._template,
            goals=waypoint.goals,
            regions=waypoint.regions,
            q_reference=self._way[-1],
            max_step=steps.max_step,
            max_link_rotation=steps.max_link_rotation,
        )
        result = self._solver(problem)
        self._solved += 1
        self._last = result.status
        if not result.solved:
            because = f" ({'; '.join(result.rejected[:2])})" if result.rejected else ""
            self._why = f"{result.status.sentence}{because}"
        return result


def _standing(mechanism: Mechanism, q: Array, waypoint: FrameWaypoint) -> FrameWaypoint | None:
    """Where the frames of a waypoint's goals are at a configuration; None where it asks for regions as well."""
    if waypoint.regions:
        return None
    placed, goals = place(mechanism, q), []
    for goal in waypoint.goals:
        frame = mechanism.frame(goal.frame)
        R = placed.R[frame.link] @ frame.T_link_frame.rotation
        position = placed.point(frame.link, frame.T_link_frame.position)
        goals.append(
            replace(
                goal,
                position=None if goal.position is None else position,
                rotation=None if goal.rotation is None else R,
                direction=None if goal.axis is None else R @ goal.axis,
            )
        )
    return FrameWaypoint(tuple(goals))


def _goal_between(a: FrameGoal, b: FrameGoal) -> FrameGoal | None:
    """Half-way: the position on the straight line, rotation and direction on the shortest arc."""
    same = a.frame == b.frame and np.array_equal(
        [x is None for x in (a.position, a.rotation, a.axis)],
        [x is None for x in (b.position, b.rotation, b.axis)],
    )
    if not same:
        return None
    if a.axis is not None and b.axis is not None and not np.allclose(a.axis, b.axis):
        return None
    position = None if a.position is None or b.position is None else 0.5 * (a.position + b.position)
    rotation = None
    if a.rotation is not None and b.rotation is not None:
        rotation = a.rotation @ _half(rotation_vector(a.rotation.T @ b.rotation))
    direction = None
    if a.direction is not None and b.direction is not None:
        middle = a.direction + b.direction
        if not np.linalg.norm(middle) > 1e-6:
            return None
        direction = middle / np.linalg.norm(middle)
    return FrameGoal(a.frame, position, rotation, a.axis, direction, max(a.within, b.within))


def _half(vector: Array) -> Array:
    """The rotation by half of a rotation vector."""
    angle = float(np.linalg.norm(vector))
    if angle < 1e-12:
        return np.eye(3)
    turned: Array = axis_angle_to_matrix(vector / angle, 0.5 * angle)
    return turned


def _region_between(a: InRegion, b: InRegion) -> InRegion | None:
    """Half-way between two regions with the same normals, such as a face and the same lifted."""
    same = a.frame == b.frame and a.A.shape == b.A.shape and np.array_equal(a.equal, b.equal)
    if not same or not np.allclose(a.A, b.A) or not np.allclose(a.point, b.point):
        return None
    return InRegion(a.frame, a.A, 0.5 * (a.b + b.b), a.point, a.equal, a.name)
