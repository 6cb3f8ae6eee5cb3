"""CIDGIK asked directly: trees, several goals, positions, directions, planar arms, every rule of a workspace.

    arm = load_robot("ur10")
    goal = Goal.pointing("tool", [0.6, 0.2, 0.5], [0.0, 0.0, -1.0])
    answer = solve_query(Query(arm, (goal,), Workspace(Points.joints(arm), Balls(centres, radii))))

`workcell.ik.solve` asks it about an `IKProblem`; `examples/ask_cidgik.py` asks it so.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np

from workcell import clock
from workcell.errors import InputError
from workcell.ik.cidgik.chordal import ChordalInstance, ChordalKeeper
from workcell.ik.cidgik.finish import QueryFinisher
from workcell.ik.cidgik.instance import Instance
from workcell.ik.cidgik.model import chordal_structure_of, structure_key, structure_of
from workcell.ik.cidgik.proof import Proof, malformed, margin
from workcell.ik.cidgik.rank import Kept, Relaxed
from workcell.ik.cidgik.search import PROGRAMS_A_SECOND, Search
from workcell.ik.cidgik.skeleton import Skeleton
from workcell.ik.cidgik.workspace.keeper import Keeper, plane_in_base
from workcell.ik.cidgik.workspace.rules import Rules
from workcell.ik.problem import Budget
from workcell.ik.result import Status
from workcell.ik.shared.limits import Interval
from workcell.ik.trees.judge import Verdict, judge_query
from workcell.ik.trees.query import Plane, Query
from workcell.pose import Array, read_only

_NEAR = 1e-9


@dataclass(frozen=True, slots=True)
class Answer:
    """The answer to a `Query`.

    Attributes:
        status: SOLVED with a configuration that `judge_query` accepts; UNREACHABLE or BLOCKED with a proof that
            `check_query` accepts; else NOT_FOUND.
        q: (n,) or None.
        verdict: what the judge found at `q`, or None.
        proof: multipliers that show the relaxation empty, or None.
        stats: numbers about the work done, `cpu_s` among them.
        rejected: why near misses failed, in words.
    """

    status: Status
    q: Array | None
    verdict: Verdict | None
    proof: Proof | None
    stats: Mapping[str, float]
    rejected: tuple[str, ...]

    def __post_init__(self) -> None:
        if self.q is not None:
            object.__setattr__(self, "q", read_only(self.q))


def solve_query(query: Query, budget: Budget | None = None, seed: int = 0, *, local: bool = False) -> Answer:
    """Look for a configuration that reaches all goals in the workspace, or for a proof that there is none.

    Raises:
        InputError: a robot that points and distances can't describe (prismatic joints, parallel axes in three
            dimensions, two joints about one axis), or a workspace that a point fixed by the base or a goal breaks.
    """
    budget = budget or Budget()
    started = clock.cpu_seconds()
    whole, keeper = _relaxed(query)
    _refuse_fixed(query, keeper)
    skeleton, instance, kept = _fastest(query, whole, keeper)
    try:
        finisher = _Prover(query)
        deadline = started + budget.cpu_s
        rng = np.random.default_rng(seed)
        search = Search(
            skeleton,
            instance,
            kept,
            finisher,
            lambda: _relaxed(query),
            deadline,
            budget.work(PROGRAMS_A_SECOND),
            rng,
            local=local,
        )
        if whole.contradiction:
            search.note("a point that can't move is not in the plane that it must be in")
            q = None
        else:
            q = search.run()
        return _answer(query, q, finisher.proof, search, clock.cpu_seconds() - started)
    finally:
        instance.release()


def _answer(query: Query, q: Array | None, proof: Proof | None, search: Search, spent: float) -> Answer:
    stats = search.stats | {"cpu_s": spent}
    verdict = None if q is None else judge_query(query, q)
    if verdict is not None and verdict.accepted:
        return Answer(Status.SOLVED, q, verdict, None, stats, tuple(search.rejected))
    if proof is not None:
        status = Status.BLOCKED if len(proof.keys) else Status.UNREACHABLE
        return Answer(status, None, None, proof, stats, tuple(search.rejected))
    return Answer(Status.NOT_FOUND, None, None, None, stats, tuple(search.rejected))


def check_query(query: Query, proof: Proof) -> str | None:
    """Why multipliers don't prove that a query has no solution within its tolerances, or None when they do."""
    instance, keeper = _relaxed(query)
    refusal = malformed(instance, keeper, proof)
    if refusal is not None:
        return refusal
    found = margin(instance, keeper, proof, query.position_tolerance, query.rotation_tolerance, 0.0)
    return None if found > 0 else f"its multipliers do not prove the claim: margin {found:.3g}"


class _Prover(QueryFinisher):
    """A query's finisher that also keeps the proof that was found."""

    def __init__(self, query: Query) -> None:
        super().__init__(query)
        self.proof: Proof | None = None

    def prove(self, proof: Proof) -> bool:
        """Keep the proof if it holds."""
        if check_query(self.query, proof) is not None:
            return False
        self.proof = proof
        return True


def _relaxed(query: Query) -> tuple[Instance, Keeper]:
    """The relaxation and the workspace over it."""
    robot, space = query.robot, query.workspace
    interval = Interval(robot.lower, robot.upper)
    points = (space.points.link, space.points.local)
    structure = structure_of(structure_key(robot, query.goals, points, interval, query.dimension))
    vectors = structure.points
    planes = tuple(
        (vectors.one(i), *plane_in_base(plane, robot.T_world_base, structure.skeleton.plane))
        for plane in space.planes
        if plane.equal
        for i in _listed(plane, len(space.points))
    )
    instance = Instance(structure, query.goals, interval.middle, interval.half, planes)
    return instance, Keeper(instance, vectors, _rules(query), robot.T_world_base)


def _fastest(query: Query, whole: Instance, keeper: Keeper) -> tuple[Skeleton, Relaxed, Kept | None]:
    """Small blocks for long chains, unless a rule ties points of different blocks together or a plane holds points."""
    robot, space = query.robot, query.workspace
    skeleton = whole.structure.skeleton
    interval = Interval(robot.lower, robot.upper)
    points = (space.points.link, space.points.local)
    chordal = None
    if not space.apart and not whole.added:
        chordal = chordal_structure_of(structure_key(robot, query.goals, points, interval, query.dimension))
    if chordal is None:
        return skeleton, whole, keeper if len(space.points) else None
    parts = ChordalInstance(chordal, query.goals, whole.middle, whole.half)
    kept = ChordalKeeper(parts, space.points.link, space.points.local, _rules(query), robot.T_world_base)
    return skeleton, parts, kept


def _rules(query: Query) -> Rules:
    space = query.workspace
    return Rules(space.points.radius, space.obstacles, space.inside, space.planes, space.apart)


def _listed(plane: Plane, count: int) -> range | tuple[int, ...]:
    return range(count) if plane.points is None else plane.points


def _refuse_fixed(query: Query, keeper: Keeper) -> None:
    """Raise InputError where points that the base or a goal fixes are inside an obstacle, or two points coincide."""
    fault = keeper.fixed_inside()
    if fault is not None:
        point, ball, depth = fault
        link = query.robot.link_names[int(query.workspace.points.link[point])]
        raise InputError(
            f"the obstacle contains an anchor: point {point} on {link}, which the base or a goal fixes, is "
            f"{1e3 * depth:.1f} mm inside",
            where=f"sphere {ball}",
            remedy="move the obstacle, the base or the goal",
        )
    if query.dimension == 2:
        _refuse_off_plane(query)
    for i, j in query.workspace.apart:
        if np.abs(keeper.points[i] - keeper.points[j]).max() < _NEAR:
            raise InputError(
                f"points {i} and {j} coincide, whatever the configuration: they can't be kept apart",
                where="apart",
                remedy="name two different points",
            )


def _refuse_off_plane(query: Query) -> None:
    """Raise InputError for goals that a planar arm's tool is never level with."""
    robot = query.robot
    normal = robot.T_world_base.rotation @ robot.joint_rotation[0] @ robot.axis[0]
    for goal in query.goals:
        height = float(normal @ (goal.position - robot.fk(np.zeros(robot.dof), goal.tool).position))
        if abs(height) > query.position_tolerance:
            raise InputError(
                f"the goal lies {1e3 * abs(height):.3g} mm off the plane that {goal.tool!r} moves in",
                where=f"{robot.name}, goals",
                remedy="a goal in the plane of the arm",
            )
