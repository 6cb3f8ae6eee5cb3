"""Which vectors of a robot CIDGIK looks at: for every link, as few directions as its points and joint axes span.

A link whose vectors lie in a plane needs two directions, and its mirror image is then itself turned (the paper's case
of neighbouring axes in a plane). Where they don't (skew axes, points off the plane, limits off centre) the link
carries a whole frame, whose handedness the relaxation keeps.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from workcell.errors import InputError
from workcell.ik.registry import takers
from workcell.ik.trees.query import Goal
from workcell.model.robot import LIMIT_SLACK, Robot
from workcell.pose import Array, axis_angle_to_matrix

_ROUNDED = 1e-11
"""Length (metres, or of unit vectors) of a component, or sine of an angle, that counts as zero.

It is far below what proofs keep back for rounding. What is larger is not zero: a file's 3.1416 makes axes that are not
parallel, and rows that said so would be false."""
_FLAT = 1e-9
"""Sine below which axes are too nearly parallel, and metres below which they are too near, to tell points apart."""


def frame_about(axis: Array) -> Array:
    """A rotation (3, 3) whose first column is `axis`."""
    helper = np.eye(3)[int(np.argmin(np.abs(axis)))]
    y = np.cross(helper, axis)
    y /= np.linalg.norm(y)
    return np.stack([axis, y, np.cross(axis, y)], axis=1)


@dataclass(frozen=True, slots=True)
class Limited:
    """How the angle of a joint is bounded: `cos(angle - middle) = sum of products of directions`.

    Attributes:
        joint: its index.
        how: `aligned` (u_parent . u_child is sign times that cosine), `parent` or `child` (that link has a frame).
        parent, child: (3,) unit directions in the two links, normal to the axis, which coincide at angle zero
            (but for `aligned`: at the middle, up to the sign).
        parent_side, child_side: (3,) the same turned by a right angle about the axis.
        sign: of `aligned`.
    """

    joint: int
    how: str
    parent: Array
    child: Array
    parent_side: Array
    child_side: Array
    sign: float = 1.0


class Skeleton:
    """The vectors of every link.

    Attributes:
        robot: the tree; all vectors are seen from its base.
        dimension: 3, or 2 for planar arms.
        goals: for their tools, kinds and axes.
        basis: by link, (3, s) orthonormal directions in its frame, s = 1, 2 or 3, the joint's axis first (in three
            dimensions; in two the axis is left out).
        framed: links with a whole frame.
        known: links whose rotation is given: the base, and the links of posed tools.
        limited: the joints with limits that must be watched.
    """

    def __init__(
        self,
        robot: Robot,
        goals: Sequence[Goal],
        points: tuple[NDArray[np.int64], Array],
        lower: Array,
        upper: Array,
        dimension: int = 3,
        generic: bool = False,
    ) -> None:
        _refuse(robot, dimension)
        self.robot, self.goals, self.dimension = robot, tuple(goals), dimension
        self.plane = np.eye(3) if dimension == 3 else _plane_of(robot)
        self._facing = np.sign(_home_axes(robot) @ _home_axes(robot)[0])
        self.known = {0} | {robot.tool(goal.tool).link for goal in goals if goal.kind == "pose"}
        spans = [self._span(link, points) for link in range(robot.dof + 1)]
        wide = {link for link, span in enumerate(spans) if span.shape[1] == dimension}
        self.points = tuple((int(k), v) for k, v in zip(*points, strict=True))
        self.limited, self.framed = _plan_limits(robot, lower, upper, spans, wide | self.known, generic)
        self.basis = [self._frame(link) if link in self.framed else span for link, span in enumerate(spans)]

    def _span(self, link: int, points: tuple[NDArray[np.int64], Array]) -> Array:
        """Orthonormal basis (3, s) of what is fixed to a link, seen from its origin."""
        robot = self.robot
        if link in self.known:
            return self._frame(link)
        vectors = [] if self.dimension == 2 else [robot.axis[link - 1]]
        for joint in np.flatnonzero(robot.parents == link):
            vectors += [robot.joint_rotation[joint] @ robot.axis[joint], robot.joint_xyz[joint]]
        for goal in self.goals:
            tool = robot.tool(goal.tool)
            if tool.link == link:
                vectors.append(tool.T_link_tool.position)
                vectors += list(goal.axes @ tool.T_link_tool.rotation.T)
        vectors += list(points[1][points[0] == link])
        return _gram_schmidt([self._flat(link, v) for v in vectors])

    def _flat(self, link: int, vector: Array) -> Array:
        """In two dimensions, without the part along the axis."""
        if self.dimension == 3 or link == 0:
            return vector
        axis = self.robot.axis[link - 1]
        return np.asarray(vector - axis * (axis @ vector))

    def _frame(self, link: int) -> Array:
        if self.dimension == 2:
            if link == 0:
                return self.plane.T
            # seen from the same side as the plane, whichever way the joint's axis points
            return frame_about(self._facing[link - 1] * self.robot.axis[link - 1])[:, 1:]
        return np.eye(3) if link == 0 else frame_about(self.robot.axis[link - 1])

    def in_link(self, link: int, vector: Array) -> Array:
        """Coordinates (s,) of a vector fixed to a link in its basis."""
        coordinates: Array = self.basis[link].T @ vector
        return coordinates


def _gram_schmidt(vectors: list[Array]) -> Array:
    basis: list[Array] = []
    for vector in vectors:
        rest = vector - sum((b * (b @ vector) for b in basis), np.zeros(3))
        length = float(np.linalg.norm(rest))
        if length > _ROUNDED * max(1.0, float(np.linalg.norm(vector))) and len(basis) < 3:
            rest = rest / length
            rest = rest - sum((b * (b @ rest) for b in basis), np.zeros(3))
            basis.append(rest / np.linalg.norm(rest))
    return np.stack(basis, axis=1) if basis else np.zeros((3, 0))


def _refuse(robot: Robot, dimension: int) -> None:
    """Raise InputError for robots that points and distances can't describe."""
    if robot.coupling is not None:
        raise InputError(
            f"joint {robot.all_joint_names[robot.coupling.followers[0]]!r} follows another, which cidgik does not know",
            where=robot.name,
            remedy=f"{takers(couples=True)} do",
        )
    sliding = [name for name, prismatic in zip(robot.joint_names, robot.prismatic, strict=True) if prismatic]
    if sliding:
        raise InputError(
            f"joint {sliding[0]!r} is prismatic, which cidgik does not support",
            where=robot.name,
            remedy=f"{takers(slides=True)} do",
        )
    axes = _home_axes(robot)
    sines = np.linalg.norm(np.cross(axes, axes[0]), axis=1)
    if dimension == 3 and robot.dof > 1 and np.all(sines < _FLAT):
        raise InputError(
            "all joint axes are parallel: the arm moves in a plane, and points on its axes cannot tell its height",
            where=robot.name,
            remedy="ask cidgik in two dimensions, Query(..., dimension=2), or use another solver",
        )
    if dimension == 2 and not np.all(sines < _ROUNDED):
        raise InputError(
            f"a planar arm has parallel axes; these are up to {sines.max():.1g} rad apart",
            where=robot.name,
            remedy="dimension=3",
        )
    for joint in range(robot.dof):
        parent = int(robot.parents[joint])
        if parent == 0:
            continue
        along = robot.joint_rotation[joint] @ robot.axis[joint]
        axis, offset = robot.axis[parent - 1], robot.joint_xyz[joint]
        apart = float(np.linalg.norm(offset - axis * (axis @ offset)))
        if np.linalg.norm(np.cross(axis, along)) < _FLAT and apart < _FLAT:
            raise InputError(
                f"joints {robot.joint_names[parent - 1]!r} and {robot.joint_names[joint]!r} turn about one axis: "
                "their points coincide",
                where=robot.name,
                remedy="make them one joint, or use another solver",
            )


def _home_axes(robot: Robot) -> Array:
    R = robot.link_transforms(np.zeros(robot.dof))[1:, :3, :3]
    axes: Array = np.einsum("kij,kj->ki", R, robot.axis)
    return axes


def _plane_of(robot: Robot) -> Array:
    """(2, 3) two directions in the base that span the plane of a planar arm."""
    axis = robot.joint_rotation[0] @ robot.axis[0]
    plane: Array = frame_about(axis)[:, 1:].T
    return plane


def _plan_limits(
    robot: Robot, lower: Array, upper: Array, spans: list[Array], framed: set[int], generic: bool
) -> tuple[tuple[Limited, ...], set[int]]:
    """How each limited joint is watched, and the links that need frames for it (the most useful first)."""
    framed = set(framed)
    joints = [k for k in range(robot.dof) if generic or 0.5 * (upper[k] - lower[k]) + LIMIT_SLACK < np.pi]
    # with intervals that change from query to query no angle is special
    middle = np.full(robot.dof, np.nan) if generic else 0.5 * (lower + upper)
    open_joints = []
    plans: dict[int, Limited] = {}
    for k in joints:
        plan = _limit_plan(robot, k, middle[k], spans, framed)
        if plan is None:
            open_joints.append(k)
        else:
            plans[k] = plan
    while open_joints:
        links = [link for k in open_joints for link in (int(robot.parents[k]), k + 1)]
        links = [link for link in links if link not in framed]
        chosen = max(sorted(set(links)), key=links.count)
        framed.add(chosen)
        for k in [k for k in open_joints if chosen in (int(robot.parents[k]), k + 1)]:
            plan = _limit_plan(robot, k, middle[k], spans, framed)
            # None: the other link has nothing off the axis, and needs a frame too
            if plan is not None:
                plans[k] = plan
                open_joints.remove(k)
    return tuple(plans[k] for k in joints), framed


def _limit_plan(robot: Robot, k: int, middle: float, spans: list[Array], framed: set[int]) -> Limited | None:
    """How joint k can be watched with the vectors there are, or None."""
    parent, child = int(robot.parents[k]), k + 1
    J, axis = robot.joint_rotation[k], robot.axis[k]
    from_parent, from_child = _across(J.T @ spans[parent], axis), _across(spans[child], axis)
    if parent in framed:
        u = frame_about(axis)[:, 1] if child in framed else from_child
        return None if u is None else _limited(k, "parent", J, axis, u)
    if child in framed:
        return None if from_parent is None else _limited(k, "child", J, axis, from_parent)
    if from_parent is None or from_child is None:
        return None
    turned = axis_angle_to_matrix(axis, middle) @ from_child
    if not np.linalg.norm(np.cross(from_parent, turned)) < _ROUNDED:
        return None
    cosine = float(from_parent @ turned)
    side = np.zeros(3)
    return Limited(k, "aligned", J @ from_parent, from_child, side, side, float(np.sign(cosine)))


def _limited(k: int, how: str, J: Array, axis: Array, u: Array) -> Limited:
    side = np.cross(axis, u)
    return Limited(k, how, J @ u, u, J @ side, side)


def _across(span: Array, axis: Array) -> Array | None:
    """The one direction of a flat link (3, s) that is normal to the axis; None when it has none."""
    rest = span - np.outer(axis, axis @ span)
    lengths = np.linalg.norm(rest, axis=0)
    if lengths.max(initial=0.0) < _ROUNDED:
        return None
    best = int(lengths.argmax())
    direction: Array = rest[:, best] / lengths[best]
    return direction
