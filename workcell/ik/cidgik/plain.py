"""CIDGIK's relaxation plainly in cvxpy, as the paper has it: to read, to test the fast path against, to extend.

    problem, model = relaxation(query)
    low = model.squared_distance(model.point(3, np.zeros(3)), obstacle) >= 0.3**2
    cvxpy.Problem(cvxpy.Minimize(cvxpy.trace(model.Z)), problem.constraints + [low]).solve(solver="CLARABEL")

Every link's points are variables of their own, tied by all their mutual distances (Eq. 4): no reduction, (2 n +
d)-sized or larger Z. cvxpy takes seconds to import, and a solve a hundred times longer than
`workcell.ik.cidgik.solver`.
"""

from __future__ import annotations

from dataclasses import dataclass
from itertools import combinations
from typing import TYPE_CHECKING, Any

import numpy as np

from workcell.errors import InputError
from workcell.ik.cidgik.skeleton import Skeleton, frame_about
from workcell.ik.trees.query import Query
from workcell.model.robot import LIMIT_SLACK
from workcell.pose import Array, axis_angle_to_matrix

if TYPE_CHECKING:
    import cvxpy

Expression = Any
"""A cvxpy expression; cvxpy carries no types."""


@dataclass(frozen=True, slots=True)
class Affine:
    """A vector: a combination of the variable points, plus a constant; base frame."""

    weights: Array
    constant: Array

    def plus(self, other: Affine, scale: float = 1.0) -> Affine:
        """Their sum, the other one scaled."""
        return Affine(self.weights + scale * other.weights, self.constant + scale * other.constant)


class PlainModel:
    """The vectors of a query's robot as expressions in Z = [X I]^T [X I].

    Attributes:
        Z: the matrix variable (m + 3, m + 3).
        count: m, number of variable points.
    """

    def __init__(self, query: Query) -> None:
        import cvxpy as cp

        robot, points = query.robot, query.workspace.points
        if query.dimension != 3:
            raise InputError("the plain relaxation is three-dimensional", where="dimension")
        self.query = query
        self.skeleton = Skeleton(robot, query.goals, (points.link, points.local), robot.lower, robot.upper)
        self._first: dict[int, int] = {}
        self.count = 0
        for link in range(1, robot.dof + 1):
            if link not in self.skeleton.known:
                self._first[link] = self.count
                self.count += 1 + self.skeleton.basis[link].shape[1]
        self.Z: Expression = cp.Variable((self.count + 3, self.count + 3), symmetric=True)
        self._known = {0: (np.eye(3), np.zeros(3))} | {
            robot.tool(goal.tool).link: self._posed(goal) for goal in query.goals if goal.kind == "pose"
        }

    def _posed(self, goal: Any) -> tuple[Array, Array]:
        """Rotation and origin of a posed tool's link."""
        base, tool = self.query.robot.T_world_base, self.query.robot.tool(goal.tool).T_link_tool
        R = base.rotation.T @ goal.directions.T @ tool.rotation.T
        return R, base.rotation.T @ (goal.position - base.position) - R @ tool.position

    def constant(self, vector: Array) -> Affine:
        """A known vector (3,), base frame."""
        return Affine(np.zeros(self.count), np.asarray(vector, dtype=float))

    def _variable(self, index: int) -> Affine:
        return Affine(np.eye(self.count)[index], np.zeros(3))

    def direction(self, link: int, local: Array) -> Affine:
        """A direction (3,) fixed to a link."""
        if link in self._known:
            return self.constant(self._known[link][0] @ local)
        total, first = self.constant(np.zeros(3)), self._first[link]
        for k, weight in enumerate(self.skeleton.in_link(link, local)):
            total = total.plus(self._variable(first + 1 + k), float(weight))
            total = total.plus(self._variable(first), -float(weight))
        return total

    def point(self, link: int, local: Array) -> Affine:
        """A point (3,) of a link."""
        if link in self._known:
            R, origin = self._known[link]
            return self.constant(R @ local + origin)
        return self._variable(self._first[link]).plus(self.direction(link, local))

    def product(self, a: Affine, b: Affine) -> Expression:
        """a . b, linear in Z."""
        left, right = (np.concatenate([v.weights, v.constant]) for v in (a, b))
        return left @ self.Z @ right

    def squared_distance(self, a: Affine, b: Affine) -> Expression:
        """|a - b|^2, linear in Z."""
        difference = a.plus(b, -1.0)
        return self.product(difference, difference)

    def cluster(self, link: int) -> list[tuple[Affine, Array]]:
        """Points that move with a link, and where they are in its frame: its own, its children's axes, its goals."""
        robot = self.query.robot
        own = np.eye(3) if link in self._known else self.skeleton.basis[link]
        places = [np.zeros(3), *own.T]
        found = [(self.point(link, place), place) for place in places]
        for joint in np.flatnonzero(robot.parents == link):
            origin, child = robot.joint_xyz[joint], int(joint) + 1
            along = robot.joint_rotation[joint] @ robot.axis[joint]
            found.append((self.point(child, np.zeros(3)), origin))
            found.append((self.point(child, robot.axis[joint]), origin + along))
        for goal in self.query.goals:
            tool, base = robot.tool(goal.tool), robot.T_world_base
            if tool.link == link and goal.kind != "pose":
                position = base.rotation.T @ (goal.position - base.position)
                found.append((self.constant(position), tool.T_link_tool.position))
                for axis, wanted in zip(goal.axes, goal.directions @ base.rotation, strict=True):
                    place = tool.T_link_tool.position + tool.T_link_tool.rotation @ axis
                    found.append((self.constant(position + wanted), place))
        return found


def relaxation(query: Query) -> tuple[cvxpy.Problem, PlainModel]:
    """Problem 3 for a query, its limits and all of its obstacle spheres included; and the vectors in it.

    Containment, planes and self-collision are left out: add them with the model's expressions.

    Raises:
        InputError: a planar query, or a robot that points and distances can't describe.
    """
    import cvxpy as cp

    model = PlainModel(query)
    constraints = [model.Z >> 0, model.Z[-3:, -3:] == np.eye(3)]
    for link in range(query.robot.dof + 1):
        cluster = model.cluster(link)
        for (a, here), (b, there) in combinations(cluster, 2):
            if np.any(a.weights) or np.any(b.weights):
                constraints.append(model.squared_distance(a, b) == float(np.sum((here - there) ** 2)))
    constraints += _frames(model) + _limits(model) + _obstacles(model)
    return cp.Problem(cp.Minimize(0), constraints), model


def _frames(model: PlainModel) -> list[Expression]:
    """Whole frames are right-handed: by their neighbours' frames, and by their quaternions' matrices."""
    import cvxpy as cp

    skeleton, robot = model.skeleton, model.query.robot
    rows = []
    for joint in range(robot.dof):
        parent, child = int(robot.parents[joint]), joint + 1
        if {parent, child} <= skeleton.framed and not {parent, child} <= skeleton.known:
            frame = frame_about(robot.axis[joint])
            a, b = (model.direction(child, frame[:, i]) for i in (1, 2))
            x, y = (model.direction(parent, robot.joint_rotation[joint] @ frame[:, i]) for i in (1, 2))
            rows.append(model.product(a, x) == model.product(b, y))
            rows.append(model.product(a, y) == -model.product(b, x))
    for link in sorted(skeleton.framed - skeleton.known):
        frame = skeleton.basis[link]
        axes = [model.direction(link, frame[:, j]) for j in range(3)]
        R = [[model.product(model.constant(np.eye(3)[i]), axis) for axis in axes] for i in range(3)]
        rows.append(cp.bmat(_quaternion(R)) >> 0)
    return rows


def _quaternion(R: list[list[Expression]]) -> list[list[Expression]]:
    """4 q q^T of a rotation's unit quaternion q, wxyz: linear in the rotation."""
    w = [1 + R[0][0] + R[1][1] + R[2][2], R[2][1] - R[1][2], R[0][2] - R[2][0], R[1][0] - R[0][1]]
    x = [w[1], 1 + R[0][0] - R[1][1] - R[2][2], R[0][1] + R[1][0], R[0][2] + R[2][0]]
    y = [w[2], x[2], 1 - R[0][0] + R[1][1] - R[2][2], R[1][2] + R[2][1]]
    return [w, x, y, [w[3], x[3], y[3], 1 - R[0][0] - R[1][1] + R[2][2]]]


def _limits(model: PlainModel) -> list[Expression]:
    """cos(angle - middle) >= cos(half) for each joint that is watched."""
    robot = model.query.robot
    middle = 0.5 * (robot.lower + robot.upper)
    half = 0.5 * (robot.upper - robot.lower) + LIMIT_SLACK
    rows = []
    for plan in model.skeleton.limited:
        k = plan.joint
        u, v = plan.sign * plan.parent, plan.child
        turn = axis_angle_to_matrix(robot.axis[k], middle[k])
        if plan.how == "parent":
            u = robot.joint_rotation[k] @ turn @ robot.joint_rotation[k].T @ u
        elif plan.how == "child":
            v = turn.T @ v
        parent = model.direction(int(robot.parents[k]), u)
        rows.append(model.product(parent, model.direction(k + 1, v)) >= np.cos(half[k]))
    return rows


def _obstacles(model: PlainModel) -> list[Expression]:
    """Eq. 6 for every point that can move and every sphere."""
    space, base = model.query.workspace, model.query.robot.T_world_base
    centres = (space.obstacles.centre - base.position) @ base.rotation
    rows = []
    for link, local, radius in zip(space.points.link, space.points.local, space.points.radius, strict=True):
        point = model.point(int(link), local)
        if np.any(point.weights):
            for centre, size in zip(centres, space.obstacles.radius, strict=True):
                squared = model.squared_distance(point, model.constant(centre))
                rows.append(squared >= float(radius + size) ** 2)
    return rows
