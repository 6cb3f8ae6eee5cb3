"""An `IKProblem` in CIDGIK's terms: structure (remembered), instance, points and rules."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field
from functools import lru_cache
from typing import Any

import numpy as np
from numpy.typing import NDArray

from workcell.geometry.types import Piece
from workcell.identity_cache import ByIdentity
from workcell.ik.cidgik.chordal import ChordalInstance, ChordalKeeper, ChordalStructure
from workcell.ik.cidgik.instance import Instance
from workcell.ik.cidgik.rank import Kept, Relaxed
from workcell.ik.cidgik.skeleton import Skeleton
from workcell.ik.cidgik.structure import Structure
from workcell.ik.cidgik.turning import turning_rows
from workcell.ik.cidgik.workspace.keeper import Keeper
from workcell.ik.cidgik.workspace.rules import Rules
from workcell.ik.cidgik.workspace.solids import Solids
from workcell.ik.problem import IKProblem
from workcell.ik.shared.limits import Interval
from workcell.ik.trees.query import Balls, Goal, Plane
from workcell.model.robot import Robot
from workcell.pose import Array

_obstacles = ByIdentity()


@dataclass(frozen=True, slots=True)
class StructureKey:
    """What a structure depends on; robots and points are compared by their numbers.

    Attributes:
        numbers: of the robot, its tools, points and limits, as bytes.
        kinds: of the goals, by tool; and the dimension.
    """

    numbers: bytes
    kinds: tuple[Any, ...]
    skeleton: Any = field(compare=False)


CHORDAL_FROM = 18
"""Order of Z from which small blocks are faster than one large one."""


@lru_cache(maxsize=64)
def _structure(key: StructureKey) -> Structure:
    return Structure(key.skeleton())


@lru_cache(maxsize=16)
def _chordal(key: StructureKey) -> ChordalStructure:
    return ChordalStructure(key.skeleton())


def structure_key(
    robot: Robot,
    goals: tuple[Goal, ...],
    points: tuple[NDArray[np.int64], Array],
    interval: Interval | None,
    dimension: int = 3,
) -> StructureKey:
    """What names the structure of a robot with these kinds of goals, points and joint intervals.

    Without intervals (None) they change from query to query.
    """
    arrays: list[NDArray[Any]] = [robot.parents, robot.joint_xyz, robot.joint_rotation, robot.axis]
    arrays += [robot.prismatic, *points]
    for goal in goals:
        tool = robot.tool(goal.tool)
        arrays += [np.array([tool.link]), tool.T_link_tool.position, tool.T_link_tool.quat_wxyz, goal.axes]
    if interval is not None:
        arrays += [interval.lower, interval.upper]
    kinds = (dimension, interval is None, *(goal.kind for goal in goals))
    shapes = tuple(a.shape for a in arrays)
    bounds = interval or Interval(robot.lower, robot.upper)

    def skeleton() -> Skeleton:
        return Skeleton(robot, goals, points, bounds.lower, bounds.upper, dimension, generic=interval is None)

    return StructureKey(b"".join(a.tobytes() for a in arrays), (*kinds, shapes), skeleton)


def structure_of(key: StructureKey) -> Structure:
    """The structure in one block, built once.

    Raises:
        InputError: a robot that points and distances can't describe.
    """
    return _structure(key)


def chordal_structure_of(key: StructureKey) -> ChordalStructure | None:
    """The structure in small blocks, built once; None where one block is faster."""
    structure = _structure(key)
    return _chordal(key) if structure.order >= CHORDAL_FROM else None


def _problem_key(problem: IKProblem) -> StructureKey:
    interval = Interval.of(problem)
    points = (np.zeros(0, dtype=np.int64), np.zeros((0, 3)))
    if _collides(problem) and problem.cover is not None:
        points = (problem.cover.link, problem.cover.centre)
    goals = (goal_of(problem),)
    fixed = None if problem.max_step is not None else interval
    return structure_key(problem.robot, goals, points, fixed)


def relaxation_at(problem: IKProblem, tangent: bool = False) -> tuple[Instance, Keeper | None]:
    """The relaxation of a problem in one block, and the workspace over it.

    The workspace holds the cover's spheres against the obstacles: spheres and half-spaces as such, other solids by the
    spheres that cover them; it is None without a cover or obstacles.

    Args:
        problem: whose relaxation.
        tangent: solids by planes that touch them instead.

    Raises:
        InputError: a robot that points and distances can't describe.
    """
    interval = Interval.of(problem)
    goals = (goal_of(problem),)
    instance = Instance(structure_of(_problem_key(problem)), goals, interval.middle, interval.half)
    _bound_turns(problem, [instance])
    rules, cover = _rules(problem, tangent), problem.cover
    if rules is None or cover is None:
        return instance, None
    return instance, Keeper(instance, instance.structure.points, rules, problem.robot.T_world_base)


def fastest_relaxation_at(problem: IKProblem, tangent: bool = False) -> tuple[Skeleton, Relaxed, Kept | None]:
    """The skeleton, and the relaxation and workspace in one block or, for long chains, in many; as `relaxation_at`."""
    chordal = None
    if problem.self_collision is None:
        chordal = chordal_structure_of(_problem_key(problem))
    if chordal is None:
        instance, keeper = relaxation_at(problem, tangent)
        return instance.structure.skeleton, instance, keeper
    interval = Interval.of(problem)
    goals = (goal_of(problem),)
    parts = ChordalInstance(chordal, goals, interval.middle, interval.half)
    _bound_turns(problem, parts.parts)
    rules, cover = _rules(problem, tangent), problem.cover
    if rules is None or cover is None:
        return chordal.skeleton, parts, None
    kept = ChordalKeeper(parts, cover.link, cover.centre, rules, problem.robot.T_world_base)
    return chordal.skeleton, parts, kept


def _bound_turns(problem: IKProblem, instances: Sequence[Instance]) -> None:
    """Rows for `max_link_rotation`, where it is asked for (Eq. 75 of IKSPARK)."""
    if problem.max_link_rotation is None or problem.q_reference is None:
        return
    before = problem.robot.link_transforms(problem.q_reference)[:, :3, :3]
    seen = problem.robot.T_world_base.rotation.T @ before
    for instance in instances:
        instance.stand(turning_rows(instance, seen, problem.max_link_rotation))


def goal_of(problem: IKProblem) -> Goal:
    """What of the target counts."""
    tool, target = problem.robot.default_tool, problem.target
    if problem.goal == "position":
        return Goal.at(tool, target.position)
    if problem.goal == "axis":
        return Goal.pointing(tool, target.position, target.rotation[:, 2])
    return Goal.posed(tool, target)


def _rules(problem: IKProblem, tangent: bool) -> Rules | None:
    cover = problem.cover
    if not _collides(problem) or cover is None:
        return None
    found, margin = sorted_obstacles(problem), problem.tolerances.safety_margin
    pairs = () if problem.self_collision is None else problem.self_collision.tolist()
    start = None
    if problem.max_step is not None and problem.q_reference is not None:
        start = cover.centres_world(problem.robot.link_transforms(problem.q_reference))
    return Rules(
        cover.radius,
        found.balls,
        Balls.none(),
        planes=tuple(Plane(normal, offset + margin) for normal, offset in found.sides),
        apart=tuple((int(i), int(j)) for i, j in pairs),
        solids=found.solids,
        tangent=tangent,
        start=start,
        spare=None if problem.checker is None else cover.overshoot,
        margin=margin,
    )


@dataclass(frozen=True, slots=True)
class SortedObstacles:
    """Obstacles by how CIDGIK keeps out of them.

    Attributes:
        balls: the spheres.
        sides: normal (3,) and offset of each half-space, which is outside where `normal . x >= offset` (Eq. 7).
        solids: all others, or None.
    """

    balls: Balls
    sides: tuple[tuple[Array, float], ...]
    solids: Solids | None


def sorted_obstacles(problem: IKProblem) -> SortedObstacles:
    """The obstacles of a problem, sorted; remembered."""
    obstacles = problem.obstacles
    if not isinstance(obstacles, tuple):
        return _sorted(obstacles)  # a list may change between two calls
    found: SortedObstacles = _obstacles.get((obstacles,), lambda: _sorted(obstacles))
    return found


def _sorted(obstacles: Sequence[Piece]) -> SortedObstacles:
    spheres = [piece for piece in obstacles if piece.kind == "sphere"]
    centres = np.array([piece.pose.position for piece in spheres]).reshape(-1, 3)
    sides = []
    for piece in obstacles:
        if piece.kind == "halfspace":
            normal = piece.pose.rotation[:, 2]
            sides.append((normal, float(normal @ piece.pose.position)))
    solids = tuple(piece for piece in obstacles if piece.kind not in ("sphere", "halfspace"))
    balls = Balls(centres, np.array([piece.size[0] for piece in spheres]))
    return SortedObstacles(balls, tuple(sides), Solids(solids) if solids else None)


def _collides(problem: IKProblem) -> bool:
    if problem.cover is None or not len(problem.cover):
        return False
    pairs = 0 if problem.self_collision is None else len(problem.self_collision)
    return len(problem.obstacles) + pairs > 0
