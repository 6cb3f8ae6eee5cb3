"""The ball that no part of a robot leaves, and obstacles cut down to what lies in it."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from workcell.geometry.obstacle_arrays import ObstacleArrays
from workcell.geometry.types import Piece, SphereCover
from workcell.model.robot import LIMIT_SLACK, Robot
from workcell.pose import Array, Pose

_SLIVER = 1e-3
"""Metres by which cut boxes exceed the reach, so that none is flat."""

_SLAB = 0.05
"""Metres: least thickness of the slab that stands for a half-space."""


@dataclass(frozen=True, slots=True)
class ReachBall:
    """A ball in the world: centre (3,) and radius in metres."""

    centre: Array
    radius: float


def reach_ball(robot: Robot, cover: SphereCover) -> ReachBall:
    """A ball around the first joint's origin that holds every sphere of the moving links at any configuration.

    By the triangle inequality along the tree: offsets between joints, travel of prismatic ones, and each sphere's
    distance from its link's origin and radius.
    """
    robot = robot.uncoupled
    away = np.zeros(robot.dof + 1)
    for joint in range(robot.dof):
        parent = int(robot.parents[joint])
        start = robot.joint_xyz[joint] - (robot.joint_xyz[0] if parent == 0 else 0.0)
        farthest = max(abs(robot.lower[joint]), abs(robot.upper[joint])) + LIMIT_SLACK
        travel = farthest if robot.prismatic[joint] else 0.0
        away[joint + 1] = away[parent] + float(np.linalg.norm(start)) + float(travel)
    moving = cover.link > 0
    sticks = np.linalg.norm(cover.centre[moving], axis=1) + cover.radius[moving]
    radius = float(np.max(away[cover.link[moving]] + sticks, initial=0.0))
    return ReachBall(robot.T_world_base.apply(robot.joint_xyz[0]), radius)


def part_in_reach(piece: Piece, ball: ReachBall) -> Piece | None:
    """What must be covered so that all of the piece inside the ball is: None when they don't meet.

    Of a box its part in the smallest box, along its own sides, that holds all of it inside the ball; of a half-space
    such a box, too, from its surface down; any other piece stays whole.
    """
    if ObstacleArrays([piece]).floor(ball.centre) > ball.radius:
        return None
    if piece.kind not in ("box", "halfspace"):
        return piece
    centre = piece.pose.inverse().apply(ball.centre)
    size = piece.size if piece.kind == "box" else np.array([np.inf, np.inf, np.inf])
    lower, upper = -size, size
    if piece.kind == "halfspace":
        upper = np.array([np.inf, np.inf, 0.0])
    gap = np.maximum(np.maximum(lower - centre, centre - upper), 0.0) ** 2
    half_chord = np.sqrt(np.maximum(ball.radius**2 - (gap.sum() - gap), 0.0)) + _SLIVER
    low, high = np.maximum(lower, centre - half_chord), np.minimum(upper, centre + half_chord)
    if piece.kind == "halfspace":
        low[2] = min(low[2], -_SLAB)
    elif np.all(low <= lower) and np.all(high >= upper):
        return piece
    middle = Pose(piece.pose.apply(0.5 * (low + high)), piece.pose.quat_wxyz)
    return replace(piece, kind="box", pose=middle, size=0.5 * (high - low))
