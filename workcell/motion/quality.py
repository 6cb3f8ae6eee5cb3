"""How good a path is: steps, the tool between waypoints, clearance, manipulability, distance from joint limits."""

from __future__ import annotations

from collections.abc import Iterable

import numpy as np

from workcell.ik.problem import Clearance
from workcell.kernels.constants import ROTATION_WEIGHT
from workcell.model.robot import Robot
from workcell.motion.path import Path, PathMetrics
from workcell.pose import Array


def manipulability(robot: Robot, q: Array) -> Array:
    """(...,) Yoshikawa's measure sqrt(det(J J^T)) at q (..., n), a radian weighing 0.3 m; 0 at a singularity.

    For an arm of fewer than six joints: sqrt(det(J^T J)).
    """
    J = robot.jacobian(q) * np.repeat([1.0, ROTATION_WEIGHT], 3)[:, None]
    values: Array = np.linalg.svd(J, compute_uv=False).prod(axis=-1)
    return values


def limit_distance(robot: Robot, q: Array) -> Array:
    """(...,) distance of q (..., n) from the nearest joint limit, radians or metres."""
    distance: Array = np.minimum(q - robot.lower, robot.upper - q).min(axis=-1)
    return distance


def measured(path: Path, at_waypoints: Clearance, between: float, evaluations: int) -> PathMetrics:
    """The metrics of a path whose clearances are known already."""
    metres, radians = path.tool_deviation()
    return PathMetrics(
        waypoints=len(path),
        largest_step=path.largest_step,
        largest_link_rotation=path.largest_link_rotation,
        deviation_m=float(metres.max()),
        deviation_rad=float(radians.max()),
        clearance_at_waypoints=at_waypoints,
        clearance_between=between,
        evaluations=evaluations,
        manipulability=float(manipulability(path.robot, path.configurations).min()),
        limit_distance=float(limit_distance(path.robot, path.configurations).min()),
    )


def smallest(clearances: Iterable[Clearance]) -> Clearance:
    """The smallest of one or more clearances."""
    return min(clearances, key=lambda found: found.distance)
