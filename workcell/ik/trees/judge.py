"""Whether a configuration answers a query of several goals, by the tree's own kinematics.

What is looked at are its goals, limits and workspace.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from workcell.ik.trees.query import Goal, Query
from workcell.model.robot import LIMIT_SLACK
from workcell.pose import Array

_SIDE = 1e-9


@dataclass(frozen=True, slots=True)
class Verdict:
    """What the judge found: the worst goal's errors (m, rad), the least clearance (m), and what is wrong."""

    position_error: float
    rotation_error: float
    clearance: float
    reasons: tuple[str, ...]

    @property
    def accepted(self) -> bool:
        """Whether everything holds."""
        return not self.reasons


def judge_query(query: Query, q: Array) -> Verdict:
    """Judge a configuration (n,) by forward kinematics alone."""
    robot = query.robot
    T = robot.link_transforms(q)
    away, turned = 0.0, 0.0
    for goal in query.goals:
        position, rotation = _goal_error(query, goal, T)
        away = max(away, float(np.linalg.norm(position)))
        turned = max(turned, float(np.linalg.norm(rotation)))
    reasons = []
    if not away <= query.position_tolerance:
        reasons.append(f"a tool is {1e3 * away:.3g} mm from its goal")
    if not turned <= query.rotation_tolerance:
        reasons.append(f"a tool is turned by {turned:.3g} rad from its goal")
    for k in np.flatnonzero((q < robot.lower - LIMIT_SLACK) | (q > robot.upper + LIMIT_SLACK)):
        reasons.append(f"joint {robot.joint_names[k]} = {q[k]:.6g} is outside its limits")
    clearance, worst = workspace_clearance(query, T)
    if clearance < 0:
        reasons.append(f"{worst} is broken by {-1e3 * clearance:.3g} mm")
    return Verdict(away, turned, clearance, tuple(reasons))


def workspace_clearance(query: Query, T: Array) -> tuple[float, str]:
    """Least distance (m) by which points keep the workspace at link poses T, negative where broken; and the rule.

    Points that can't move count as well. Points in planes (`equal`) are broken from a hundredth of a millimetre on.
    """
    space = query.workspace
    link, local, radius = space.points.link, space.points.local, space.points.radius
    y = np.einsum("mij,mj->mi", T[link, :3, :3], local) + T[link, :3, 3]
    found: list[tuple[float, str]] = [(float("inf"), "nothing")]
    for balls, name, sign in ((space.obstacles, "obstacle", 1.0), (space.inside, "containing sphere", -1.0)):
        if len(balls) and len(y):
            centre = balls.centre
            if query.dimension == 2:
                # a planar arm sees the discs in its own plane
                normal = T[0, :3, :3] @ (query.robot.joint_rotation[0] @ query.robot.axis[0])
                across = (y[:, None] - centre) @ normal
                distance = np.linalg.norm(y[:, None] - centre - across[..., None] * normal, axis=-1)
            else:
                distance = np.linalg.norm(y[:, None] - centre, axis=-1)
            gap = sign * (distance - balls.radius) - radius[:, None]
            point, ball = divmod(int(gap.argmin()), gap.shape[1])
            found.append((float(gap[point, ball]), f"{name} {ball} by point {point}"))
    for i, j in space.apart:
        found.append(
            (float(np.linalg.norm(y[i] - y[j]) - radius[i] - radius[j]), f"the distance of points {i}, {j}")
        )
    for k, plane in enumerate(space.planes):
        for i in range(len(y)) if plane.points is None else plane.points:
            height = float(plane.normal @ y[i]) - plane.offset
            gap_here = 1e-5 - abs(height) if plane.equal else height - float(radius[i])
            found.append((gap_here, f"plane {k} by point {i}"))
    return min(found)


def _goal_error(query: Query, goal: Goal, T: Array) -> tuple[Array, Array]:
    """(3,) metres and (3,) radians that a tool has yet to go: rotation vector, zero where the goal leaves it free."""
    from workcell.pose import rotation_vector

    tool = query.robot.tool(goal.tool)
    pose = T[tool.link] @ tool.T_link_tool.matrix
    position = goal.position - pose[:3, 3]
    if goal.kind == "position":
        return position, np.zeros(3)
    if goal.kind == "pose":
        return position, np.asarray(rotation_vector(goal.directions.T @ pose[:3, :3].T))
    have, want = pose[:3, :3] @ goal.axes[0], goal.directions[0]
    across = np.cross(have, want)
    sine = float(np.linalg.norm(across))
    if sine < _SIDE:
        return position, np.zeros(3) if have @ want > 0 else np.pi * _any_normal(have)
    angle = float(np.arctan2(sine, have @ want))
    return position, across * (angle / sine)


def _any_normal(v: Array) -> Array:
    n = np.cross(v, np.eye(3)[int(np.argmin(np.abs(v)))])
    normal: Array = n / np.linalg.norm(n)
    return normal
