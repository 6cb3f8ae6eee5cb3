"""Whether a configuration answers a query of several goals: these, the joint limits and the workspace.

Links are placed by products of exponentials, and errors measured here: the judge shares nothing with a search.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike

from workcell.ik.judge.exact import exact_kinematics, rotation_angle
from workcell.ik.trees.query import PLANE_SLACK, Goal, Query
from workcell.model.robot import LIMIT_SLACK
from workcell.pose import Array


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


def judge_query(query: Query, q: ArrayLike) -> Verdict:
    """Judge a configuration (n,); anything that is not one is refused with the reason, not raised."""
    robot = query.robot
    try:
        values = np.asarray(q, dtype=float)
    except (TypeError, ValueError):
        return _refused("the configuration is not a list of numbers")
    if values.shape != (robot.dof,) or not np.isfinite(values).all():
        return _refused(f"no configuration of {robot.dof} finite joint values")
    rotation, position = exact_kinematics(robot).links(values)
    errors = [_goal_error(query, goal, rotation, position) for goal in query.goals]
    away, turned = (max(values) for values in zip(*errors, strict=True))
    reasons = []
    if not away <= query.position_tolerance:
        reasons.append(f"a tool is {1e3 * away:.3g} mm from its goal")
    if not turned <= query.rotation_tolerance:
        reasons.append(f"a tool is turned by {turned:.3g} rad from its goal")
    for k in np.flatnonzero((values < robot.lower - LIMIT_SLACK) | (values > robot.upper + LIMIT_SLACK)):
        reasons.append(f"joint {robot.joint_names[k]} = {values[k]:.6g} is outside its limits")
    clearance, worst = _workspace_clearance(query, rotation, position)
    if not clearance >= 0:
        reasons.append(f"{worst} is broken by {-1e3 * clearance:.3g} mm")
    return Verdict(away, turned, clearance, tuple(reasons))


def _refused(reason: str) -> Verdict:
    nan = float("nan")
    return Verdict(nan, nan, nan, (reason,))


def _workspace_clearance(query: Query, rotation: Array, position: Array) -> tuple[float, str]:
    """Least distance (metres) by which points keep the workspace, negative where broken; and the rule that has it.

    The links are at rotations (n + 1, 3, 3) and positions (n + 1, 3). Points that can't move count as well. Points in
    planes (`equal`) are broken from a hundredth of a millimetre on.
    """
    space = query.workspace
    link, local, radius = space.points.link, space.points.local, space.points.radius
    y = np.einsum("mij,mj->mi", rotation[link], local) + position[link]
    found: list[tuple[float, str]] = [(float("inf"), "nothing")]
    for balls, name, sign in ((space.obstacles, "obstacle", 1.0), (space.inside, "containing sphere", -1.0)):
        if len(balls) and len(y):
            centre = balls.centre
            if query.dimension == 2:
                # a planar arm sees the discs in its own plane
                normal = rotation[0] @ (query.robot.joint_rotation[0] @ query.robot.axis[0])
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
            gap_here = PLANE_SLACK - abs(height) if plane.equal else height - float(radius[i])
            found.append((gap_here, f"plane {k} by point {i}"))
    return min(found)


def _goal_error(query: Query, goal: Goal, rotation: Array, position: Array) -> tuple[float, float]:
    """Metres and radians that a tool has yet to go; no radians where the goal leaves its rotation free."""
    tool = query.robot.tool(goal.tool)
    R = rotation[tool.link] @ tool.T_link_tool.rotation
    tip = rotation[tool.link] @ tool.T_link_tool.position + position[tool.link]
    away = math.dist(tip.tolist(), goal.position.tolist())
    # each axis of the tool that the goal speaks of, in the world, against the direction that it is to have
    have = goal.axes @ R.T
    if goal.kind == "position":
        return away, 0.0
    if goal.kind == "direction":
        return away, _angle_between(have[0], goal.directions[0])
    return away, rotation_angle(goal.directions.T @ have)


def _angle_between(one: Array, two: Array) -> float:
    """Angle in [0, pi] of two directions."""
    return math.atan2(float(np.linalg.norm(np.cross(one, two))), float(one @ two))
