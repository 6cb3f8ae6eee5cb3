"""A mechanism as proofs speak of it (docs/proofs.md, 12.2), made from the problem alone."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from workcell.ik.mechanisms.problem import MechanismProblem
from workcell.model.mechanism.mechanism import WORLD, Joint, JointKind
from workcell.model.mechanism.placing import place
from workcell.model.robot import LIMIT_SLACK
from workcell.pose import Array, axis_angle_to_matrix

MOST_JOINTS = 64
MOST_CLOSURES = 64
MOST_GOALS = 32
MOST_ROWS = 256
"""Joints, ties, goals, and rows of regions for which roundings are accounted for."""
LONGEST = 50.0
"""Metres of everything together for which they are."""
WIDEST_ANGLE = 100.0
"""Radians from zero that the middle of a hinge's limits may be."""
MISSED = 2.0
"""A tie kept within c in every component, or in length, is missed by less than 2 c metres (sqrt 3 c at most)."""
TWISTED = 5.0
"""A weld kept within c, as an angle or by each component of its quaternion, is missed by less than 5 c (Frobenius)."""
FARTHEST_TURN = math.sqrt(8.0) * (1.0 + 1e-15)
"""Frobenius norm by which no two rotations differ more; those an angle apart by this times the sine of half of it."""
SHARP = 1e-9
"""By how much the goals' rotations and directions may be none, in any entry of `R R^T - I` or in length."""
BLURRED = 1e-8
"""Frobenius norm by which they are then farther from a rotation or a unit vector, at most."""
_LONGER = 1.0 + 1e-12


@dataclass(frozen=True, slots=True)
class Steps:
    """Where the reference has what a ball or a free joint moves, and how far that may be from there.

    Attributes:
        rest: (n, 3, 3) the child's rotation in the parent's at the reference.
        half: (n,) radians that it may be turned from there, at most pi.
        origin, room: (n, 3) the child's origin there, and how far each coordinate may be from it; of free joints.
    """

    rest: Array
    half: Array
    origin: Array
    room: Array


def steps_of(problem: MechanismProblem) -> Steps | None:
    """The largest step as bounds on balls and floating bodies; None without one."""
    if problem.max_step is None or problem.q_reference is None:
        return None
    mechanism, most = problem.mechanism, np.asarray(problem.max_step) + LIMIT_SLACK
    placed, n = place(mechanism, problem.q_reference), len(mechanism.joints)
    parent = np.array([joint.parent for joint in mechanism.joints])
    half, room = np.full(n, np.pi), np.full((n, 3), np.inf)
    for k, joint in enumerate(mechanism.joints):
        step = most[mechanism.rate_slices[k]]
        if joint.kind in ("ball", "free"):
            # each component of the rotation vector is bounded
            half[k] = min(float(np.linalg.norm(step[-3:])), np.pi)
        if joint.kind == "free":
            room[k] = step[:3]
    return Steps(np.swapaxes(placed.R[parent], 1, 2) @ placed.R[1:], half, placed.p[1:], room)


@dataclass(frozen=True, slots=True)
class Graph:
    """Joint k moves link k + 1. Links that slide on each other share a node, that of the first of them.

    Attributes:
        kinds: of the joints. parent: (n,) the links that carry them.
        xyz, axis, along: (n, 3) offsets, axes in the links they move, the same in the links before.
        turn: (n, 3, 3) the joints' rotations.
        middle, half: (n,) of the intervals of hinges and balls; half with the slack, at most pi.
        rest: (n, 3, 3) what the child's rotation is in the parent's with the joint in the middle.
        across, turned: (n, 3) e_k in the link that hinge k moves, and J u_k in the link before.
        ends: (n, 2) of the slides, with the slack; infinite where nothing bounds them.
        steps: what the largest step says of balls and floating bodies; None without one.
        node: (links,) each link's node. inner: (links, 3, 3) X with `R_link = R_node X`.
        reach: (links,) how far from the world's origin a link's origin can be; infinite where nothing bounds it.
        length: metres that everything has together.
    """

    kinds: tuple[JointKind, ...]
    parent: NDArray[np.int64]
    xyz: Array
    axis: Array
    along: Array
    turn: Array
    middle: Array
    half: Array
    rest: Array
    across: Array
    turned: Array
    ends: Array
    steps: Steps | None
    node: NDArray[np.int64]
    inner: Array
    reach: Array
    length: float

    @staticmethod
    def of(problem: MechanismProblem, covered: Array, *, near: float | None = None) -> Graph:
        """The graph of a problem's mechanism.

        Args:
            problem: the question.
            covered: (4,) tolerances: position, rotation, ties, regions.
            near: metres from their goals that frames' origins are, which bounds how far links can be; None: the
                covered tolerance.
        """
        joints = problem.mechanism.joints
        turn = np.stack([joint.T_parent_joint.rotation for joint in joints])
        xyz = np.stack([joint.T_parent_joint.position for joint in joints])
        parent = np.array([joint.parent for joint in joints])
        axis = np.stack([_unit(joint) for joint in joints])
        ends = _intervals(problem)
        middle, half = _angles(joints, ends)
        helper = np.eye(3)[np.argmin(np.abs([joint.axis for joint in joints]), axis=1)]
        across = np.cross(helper, axis)
        across /= np.linalg.norm(across, axis=1)[:, None]
        moved = np.cos(middle)[:, None] * across + np.sin(middle)[:, None] * np.cross(axis, across)
        node, inner = _nodes(joints, turn)
        slides = np.array([joint.kind == "slide" for joint in joints])
        span = np.where(slides, np.max(np.abs(ends), axis=1), 0.0)
        reach = _reach(problem, np.linalg.norm(xyz, axis=1) + span, covered, near)
        ends = _within_reach(ends, slides, reach[parent] + reach[1:] + np.linalg.norm(xyz, axis=1))
        return Graph(
            tuple(joint.kind for joint in joints),
            parent,
            xyz,
            axis,
            (turn @ axis[:, :, None])[..., 0],
            turn,
            middle,
            half,
            turn @ axis_angle_to_matrix(axis, middle),
            across,
            (turn @ moved[:, :, None])[..., 0],
            ends,
            steps_of(problem),
            node,
            inner,
            reach,
            _length(problem, xyz, ends[slides], reach, covered),
        )

    @property
    def joints(self) -> int:
        """n."""
        return len(self.kinds)

    def has(self, kind: JointKind) -> NDArray[np.bool_]:
        """(n,) which joints are of a kind."""
        return np.array([each == kind for each in self.kinds])


def _unit(joint: Joint) -> Array:
    """The axis of a hinge or a slide; any other joint has none, and z stands for it."""
    length = float(np.linalg.norm(joint.axis))
    unit: Array = joint.axis / length if joint.kind in ("hinge", "slide") else np.array([0.0, 0.0, 1.0])
    return unit


def _intervals(problem: MechanismProblem) -> Array:
    """(n, 2) values of hinges and slides, angles of balls: limits, cut with the largest step; with the slack."""
    mechanism, ends = problem.mechanism, np.empty((len(problem.mechanism.joints), 2))
    for k, joint in enumerate(mechanism.joints):
        lower, upper = joint.lower, joint.upper
        if joint.kind in ("hinge", "slide") and problem.max_step is not None:
            assert problem.q_reference is not None
            value = float(problem.q_reference[mechanism.value_slices[k].start])
            step = float(np.asarray(problem.max_step)[mechanism.rate_slices[k].start])
            lower, upper = max(lower, value - step), min(upper, value + step)
        ends[k] = lower - LIMIT_SLACK, upper + LIMIT_SLACK
    return ends


def _angles(joints: tuple[Joint, ...], ends: Array) -> tuple[Array, Array]:
    """Middles and half widths (n,) of hinges; for balls 0 and the largest angle; at most pi."""
    middle, half = np.zeros(len(joints)), np.full(len(joints), np.pi)
    for k, joint in enumerate(joints):
        if joint.kind == "ball":
            half[k] = min(float(ends[k, 1]), np.pi)
        elif joint.kind == "hinge" and bool(np.all(np.isfinite(ends[k]))):
            lower, upper = map(float, ends[k])
            if (width := 0.5 * (upper - lower)) < np.pi:
                middle[k], half[k] = 0.5 * (lower + upper), width
    return middle, half


def _nodes(joints: tuple[Joint, ...], turn: Array) -> tuple[NDArray[np.int64], Array]:
    links = len(joints) + 1
    node, inner = np.arange(links), np.tile(np.eye(3), (links, 1, 1))
    for k, joint in enumerate(joints):
        if joint.kind == "slide":
            node[k + 1] = node[joint.parent]
            inner[k + 1] = inner[joint.parent] @ turn[k]
    return node, inner


def _reach(problem: MechanismProblem, steps: Array, covered: Array, near: float | None) -> Array:
    """The shortest way from the world to every link, over joints, ties and goals.

    Two points that a joint or a tie keeps together are no farther from the world's origin than the ways to them say,
    so each way bounds the origin of the link at its end.
    """
    mechanism = problem.mechanism
    ways = [
        (joint.parent, k + 1, float(steps[k]))
        for k, joint in enumerate(mechanism.joints)
        if joint.kind != "free"
    ]
    for closure in mechanism.closures:
        spans = [float(np.linalg.norm(frame.position)) for frame in closure.frames]
        ways.append((*closure.links, math.fsum(spans) + MISSED * float(covered[2])))
    for goal in problem.goals:
        if goal.position is not None:
            frame = mechanism.frame(goal.frame)
            span = float(np.linalg.norm(goal.position) + np.linalg.norm(frame.T_link_frame.position))
            ways.append((WORLD, frame.link, span + (float(covered[0]) if near is None else near)))
    if (bounds := steps_of(problem)) is not None:
        # a floating body is no farther than from where it is at the reference, by the largest step
        ways += [
            (WORLD, k + 1, float(np.linalg.norm(bounds.origin[k]) + np.linalg.norm(bounds.room[k])))
            for k, joint in enumerate(mechanism.joints)
            if joint.kind == "free"
        ]
    found = np.full(mechanism.link_count, np.inf)
    found[WORLD] = 0.0
    for _ in range(mechanism.link_count):
        for a, b, span in ways:
            found[b] = min(found[b], found[a] + span)
            found[a] = min(found[a], found[b] + span)
    bounded: Array = found * _LONGER
    return bounded


def _within_reach(ends: Array, slides: NDArray[np.bool_], farthest: Array) -> Array:
    """Ends of slides that have none, by how far apart the two links' origins can be."""
    cut = np.array(ends)
    for k in np.flatnonzero(slides):
        if not np.isfinite(cut[k, 0]):
            cut[k, 0] = -farthest[k]
        if not np.isfinite(cut[k, 1]):
            cut[k, 1] = farthest[k]
    return cut


def _length(problem: MechanismProblem, xyz: Array, ends: Array, reach: Array, covered: Array) -> float:
    """All lengths that multipliers are multiplied by, each once; what is not bounded has no multiplier."""
    mechanism = problem.mechanism
    lengths = [*np.linalg.norm(xyz, axis=1), *np.max(np.abs(ends), axis=1), *covered]
    lengths += [reach[k + 1] for k, joint in enumerate(mechanism.joints) if joint.kind == "free"]
    for closure in mechanism.closures:
        lengths += [np.linalg.norm(frame.position) for frame in closure.frames]
    for frame in [goal.frame for goal in problem.goals] + [region.frame for region in problem.regions]:
        lengths.append(np.linalg.norm(mechanism.frame(frame).T_link_frame.position))
    lengths += [np.linalg.norm(goal.position) for goal in problem.goals if goal.position is not None]
    lengths += [np.linalg.norm(region.point) for region in problem.regions]
    lengths += [np.max(np.abs(region.b)) for region in problem.regions]
    return math.fsum(float(length) for length in lengths if np.isfinite(length))


def unsuited(problem: MechanismProblem, covered: Array, *, near: float | None = None) -> str | None:
    """Why the checker's rounding isn't accounted for, or None."""
    refusal = _too_many(problem) or _not_units(problem)
    if refusal is not None:
        return refusal
    graph = Graph.of(problem, covered, near=near)
    if not bool(np.all(np.abs(graph.middle) <= WIDEST_ANGLE)):
        return f"limits of a joint are more than {WIDEST_ANGLE:g} rad from zero"
    if not graph.length <= LONGEST:
        return (
            f"everything is {graph.length:.3g} m together; the checker's rounding is proved up to {LONGEST:g}"
        )
    return None


def _too_many(problem: MechanismProblem) -> str | None:
    for count, most, what in (
        (len(problem.mechanism.joints), MOST_JOINTS, "joints"),
        (len(problem.mechanism.closures), MOST_CLOSURES, "ties"),
        (len(problem.goals), MOST_GOALS, "goals"),
        (sum(len(region.b) for region in problem.regions), MOST_ROWS, "rows of regions"),
    ):
        if count > most:
            return f"there are {count} {what}; the checker's rounding is proved up to {most}"
    return None


def _not_units(problem: MechanismProblem) -> str | None:
    for joint in problem.mechanism.joints:
        if joint.kind in ("hinge", "slide") and not abs(float(np.linalg.norm(joint.axis)) - 1.0) <= 1e-12:
            return f"the axis of joint {joint.name!r} is no unit vector"
    for goal in problem.goals:
        for vector in (goal.axis, goal.direction):
            if vector is not None and not abs(float(np.linalg.norm(vector)) - 1.0) <= SHARP:
                return f"the goal of {goal.frame!r} has a direction that is no unit vector"
        R = goal.rotation
        if R is not None and not (np.abs(R @ R.T - np.eye(3)).max() <= SHARP and np.linalg.det(R) > 0.0):
            return f"the goal of {goal.frame!r} has a rotation that is none"
    return None
