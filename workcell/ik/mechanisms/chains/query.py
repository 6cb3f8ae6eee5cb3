"""The question that a way through a mechanism has to answer, as one about a serial robot.

Whatever configuration answers the mechanism's question, the chain's joints are within its limits, and bring its end
within its tolerances: these make up for what ties may miss, with the levers at which that counts. So a proof that the
chain can't do it is one that the mechanism can't. Balls, and connects on the way, are three hinges; what joints that
follow others, sums, other loops, obstacles and users' constraints say is left out.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, field

import numpy as np

from workcell.ik.mechanisms.chains.ways import LONGEST_WAY, Way, ends_of, is_point
from workcell.ik.mechanisms.goals import FrameGoal
from workcell.ik.mechanisms.problem import MechanismProblem
from workcell.ik.problem import Goal, IKProblem, Tolerances
from workcell.model.mechanism.mechanism import WORLD, Closure, Joint
from workcell.model.robot import LIMIT_SLACK, Robot, Tool
from workcell.pose import Array, Pose

MISSED, TWISTED = 2.0, 4.0
"""A tie kept within C (at most `LOOSEST`) leaves less than 2 C metres and 4 C radians, however that is measured."""
LOOSEST = 0.1
"""Metres and radians that ties may miss at most."""
SHARP, BLURRED = 1e-9, 1e-8
"""By how much goals' rotations and directions may be none, and the radians that they then stand for."""
SPARE = 1e-9
"""Metres and radians for rounding: of a chain of at most `MOST_LENGTH` metres."""
MOST_LENGTH = 50.0
_WIDE = 2.0 * np.pi


class NoChainError(ValueError):
    """Why a way is none that a proof can be about."""


@dataclass
class _Chain:
    """A chain as it grows from the world on.

    Attributes:
        T: from the frame after the last joint to where the chain has come.
        joints: (rotation, xyz, axis, prismatic, lower, upper) of each joint of the robot.
        values: for each, the mechanism's joint whose value it has; -1: of none.
        lengths: of all pieces that the chain is made of, in order.
        ties: how many of these were before each tie, and whether it is a weld.
    """

    T: Pose = field(default_factory=Pose.identity)
    joints: list[tuple[Array, Array, Array, bool, float, float]] = field(default_factory=list)
    values: list[int] = field(default_factory=list)
    lengths: list[float] = field(default_factory=list)
    ties: list[tuple[int, bool]] = field(default_factory=list)

    def move(self, T: Pose) -> None:
        """Go on by a fixed transform."""
        self.T = self.T @ T
        self.lengths.append(float(np.linalg.norm(T.position)))

    def joint(self, axis: Array, slide: bool, lower: float, upper: float, value: int = -1) -> None:
        """Go on by a joint."""
        self.joints.append((self.T.rotation, self.T.position, axis, slide, lower, upper))
        self.values.append(value)
        self.T = Pose.identity()

    def ball(self) -> None:
        """Go on by any rotation."""
        for axis, half in zip(np.eye(3), (np.pi, 0.5 * np.pi, np.pi), strict=True):
            self.joint(axis, False, -half, half)


@dataclass(frozen=True, slots=True)
class ChainQuery:
    """A way's question.

    Attributes:
        problem: of the serial robot. A hinge with no limits has one turn, [-pi, pi].
        values: for each of its joints, the mechanism's joint whose value it has; -1: of none.
    """

    problem: IKProblem
    values: tuple[int, ...]


def chain_query(problem: MechanismProblem, way: Way) -> ChainQuery:
    """The question of a way, which may be any numbers.

    Raises:
        NoChainError: it does not lead from the world to a goal, passes what has no end, or is too long.
    """
    mechanism, tolerances = problem.mechanism, problem.tolerances
    edges, joints = way.edges, len(mechanism.joints)
    if not 0 < len(edges) <= LONGEST_WAY or not 0 <= way.goal < len(problem.goals):
        raise NoChainError("the way has no edges or too many, or no goal")
    if not all(0 <= edge < joints + len(mechanism.closures) for edge in edges):
        raise NoChainError("the way has an edge that is not there")
    if not tolerances.closure <= LOOSEST:
        raise NoChainError(f"ties may miss more than {LOOSEST:g}")
    goal, chain, link = problem.goals[way.goal], _Chain(), WORLD
    frame = mechanism.frame(goal.frame)
    asked, kind = _asked(goal)
    for position, edge in enumerate(edges):
        a, b = ends_of(mechanism, edge)
        if link not in (a, b) or a == b:
            raise NoChainError("an edge of the way does not go on where the one before ends")
        forward = link == a
        link = b if forward else a
        known = link == frame.link and kind == "pose"
        if known and position == len(edges) - 1 and is_point(mechanism, edge):
            here, there = _points(problem, edge)[:: 1 if forward else -1]
            chain.move(Pose.from_xyz(here))
            if edge >= joints:
                chain.ties.append((len(chain.lengths), False))
            local = frame.T_link_frame.inverse().apply(there)
            point = Pose.from_xyz(asked.apply(local))
            return _made(problem, chain, point, "position", lever=float(np.linalg.norm(local)))
        if edge < joints:
            _through_joint(problem, chain, edge, forward)
        else:
            _through_tie(chain, mechanism.closures[edge - joints], forward)
    if link != frame.link:
        raise NoChainError("the way does not end at its goal")
    chain.move(frame.T_link_frame)
    if kind == "axis":
        assert goal.axis is not None
        chain.move(Pose.from_rotation(np.zeros(3), _with_z(goal.axis)))
    return _made(problem, chain, asked, kind, within=goal.within if kind == "axis" else 0.0)


def _asked(goal: FrameGoal) -> tuple[Pose, Goal]:
    """The target of a goal and what of it counts."""
    if goal.position is None:
        raise NoChainError("the goal has no position")
    if goal.rotation is not None:
        R = goal.rotation
        if not (np.abs(R @ R.T - np.eye(3)).max() <= SHARP and np.linalg.det(R) > 0.0):
            raise NoChainError("the goal's rotation is none")
        return Pose.from_rotation(goal.position, R), "pose"
    if goal.axis is None or goal.direction is None:
        return Pose.from_xyz(goal.position), "position"
    if not max(abs(float(np.linalg.norm(v)) - 1.0) for v in (goal.axis, goal.direction)) <= SHARP:
        raise NoChainError("the goal's axis or direction is no unit vector")
    return Pose.from_rotation(goal.position, _with_z(goal.direction)), "axis"


def _through_joint(problem: MechanismProblem, chain: _Chain, k: int, forward: bool) -> None:
    joint = problem.mechanism.joints[k]
    if joint.kind == "free":
        raise NoChainError("the way passes a floating body")
    if forward:
        chain.move(joint.T_parent_joint)
    if joint.kind == "ball":
        chain.ball()
    else:
        if not abs(float(np.linalg.norm(joint.axis)) - 1.0) <= 1e-12:
            raise NoChainError(f"the axis of joint {joint.name!r} is no unit vector")
        sign, slide = (1.0 if forward else -1.0), joint.kind == "slide"
        lower, upper = _limits(problem, joint, k)
        chain.joint(sign * joint.axis, slide, lower, upper, k)
        if slide:
            chain.lengths.append(max(abs(lower), abs(upper)) + LIMIT_SLACK)
    if not forward:
        chain.move(joint.T_parent_joint.inverse())


def _limits(problem: MechanismProblem, joint: Joint, k: int) -> tuple[float, float]:
    """The values of a hinge or slide, cut with the largest step; of a hinge that turns fully, one turn."""
    lower, upper = joint.lower, joint.upper
    if problem.max_step is not None and problem.q_reference is not None:
        mechanism = problem.mechanism
        at = float(problem.q_reference[mechanism.value_slices[k].start])
        step = float(np.asarray(problem.max_step)[mechanism.rate_slices[k].start])
        lower, upper = max(lower, at - step), min(upper, at + step)
    if joint.kind == "hinge" and not upper - lower < _WIDE:
        return -np.pi, np.pi
    if not (math.isfinite(lower) and math.isfinite(upper) and lower <= upper):
        raise NoChainError("a joint of the way has no limits, or no value within them")
    return lower, upper


def _through_tie(chain: _Chain, closure: Closure, forward: bool) -> None:
    here, there = closure.frames if forward else closure.frames[::-1]
    weld = closure.kind == "weld"
    chain.move(here if weld else Pose.from_xyz(here.position))
    chain.ties.append((len(chain.lengths), weld))
    if not weld:
        chain.ball()
    chain.move(there.inverse() if weld else Pose.from_xyz(-there.position))


def _points(problem: MechanismProblem, edge: int) -> tuple[Array, Array]:
    """Where the point that a ball or a connect ties is, on both of its links."""
    joints = problem.mechanism.joints
    if edge < len(joints):
        return joints[edge].T_parent_joint.position, np.zeros(3)
    one, two = problem.mechanism.closures[edge - len(joints)].frames
    return one.position, two.position


def _made(
    problem: MechanismProblem,
    chain: _Chain,
    target: Pose,
    kind: Goal,
    *,
    lever: float = 0.0,
    within: float = 0.0,
) -> ChainQuery:
    """The query; `lever` is how far from the goal's origin the point is that has to be at the target."""
    if not chain.joints:
        raise NoChainError("the way has no joint")
    length = sum(chain.lengths) + float(np.linalg.norm(target.position)) + lever
    if not length <= MOST_LENGTH:
        raise NoChainError(f"the way is {length:.3g} m long; at most {MOST_LENGTH:g} are accounted for")
    allowed, tie = problem.tolerances, problem.tolerances.closure
    turned = sum(TWISTED * tie for _, weld in chain.ties if weld)
    missed = sum(
        MISSED * tie + (TWISTED * tie * sum(chain.lengths[before:]) if weld else 0.0)
        for before, weld in chain.ties
    )
    rotation = allowed.rotation + within + BLURRED
    position = allowed.position + lever * rotation + missed + SPARE
    tolerances = Tolerances(position, rotation + turned + SPARE)
    robot = _robot(f"{problem.mechanism.name}: a chain", chain)
    return ChainQuery(IKProblem(robot, target, tolerances=tolerances, goal=kind), tuple(chain.values))


def _robot(name: str, chain: _Chain) -> Robot:
    columns, n = list(zip(*chain.joints, strict=True)), len(chain.joints)
    unlimited = np.full(n, np.inf)
    return Robot(
        name=name,
        joint_names=tuple(f"j{k}" for k in range(n)),
        link_names=("world", *(f"link{k + 1}" for k in range(n))),
        parents=np.arange(n),
        joint_rotation=np.array(columns[0]),
        joint_xyz=np.array(columns[1]),
        axis=np.array(columns[2]),
        prismatic=np.array(columns[3], dtype=bool),
        lower=np.array(columns[4]),
        upper=np.array(columns[5]),
        velocity=unlimited,
        acceleration=unlimited,
        effort=unlimited,
        tools={"end": Tool("end", n, chain.T)},
        default_tool="end",
    )


def _with_z(axis: Array) -> Array:
    """(3, 3) a rotation whose third column is a unit vector."""
    z = axis / np.linalg.norm(axis)
    x = np.cross(np.eye(3)[int(np.argmin(np.abs(z)))], z)
    x /= np.linalg.norm(x)
    return np.stack([x, np.cross(z, x), z], axis=1)
