"""Proof that a whole motion is clear of collisions, not only the configurations that were looked at.

Over an interval of the motion each joint stays within `h` of its value at the centre. Undoing the joints from the tool
towards the base, a point whose distance from axis j is d at the centre moves by at most `2 sin(h_j / 2) (d + r)` on top
of the r that the joints beyond j have moved it already. If the clearance at the centre exceeds that bound for every
point of the robot, the interval is free: a pair of bodies can't lose more distance than the robot's points move. The
same bound serves self-collision, since the motion of one link relative to another is due to a subset of the joints.
Intervals that fail the test are halved.
"""

from __future__ import annotations

from collections import deque
from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike

from workcell.errors import InputError
from workcell.geometry.types import SphereCover
from workcell.ik.problem import Clearance
from workcell.model.robot import Robot
from workcell.motion.path import Path, Trajectory
from workcell.pose import Array

Checker = Callable[[Array], Clearance]


@dataclass(frozen=True, slots=True)
class Proof:
    """What subdivision found out about a motion.

    Attributes:
        proved: every configuration of the motion has at least `margin` clearance.
        margin: lower bound on the clearance everywhere (metres); -inf where nothing was proved.
        smallest: smallest clearance that was evaluated, with its pair.
        failed_at: path parameter (waypoint index and fraction) where the proof failed; nan when proved.
        reason: why it failed, in words; empty when proved.
        evaluations: collision queries spent.
    """

    proved: bool
    margin: float
    smallest: Clearance
    failed_at: float
    reason: str
    evaluations: int


def motion_bound(robot: Robot, q: Array, half: Array, extent: SphereCover) -> float:
    """How far any point of the robot can be from where it is at `q`, while each joint stays within `half` of it.

    Args:
        robot: serial.
        q, half: (n,) centre and half-widths of the box of configurations.
        extent: spheres in link frames that contain all that moves (an attached object included).

    Returns:
        metres, an upper bound.
    """
    if len(extent) == 0:
        return 0.0
    T = robot.link_transforms(q)
    centres = extent.centres_world(T)
    axes = np.einsum("kij,kj->ki", T[1:, :3, :3], robot.axis)
    from_axis = np.cross(centres[:, None] - T[None, 1:, :3, 3], axes[None])
    arms = np.sqrt(np.einsum("mki,mki->mk", from_axis, from_axis)) + extent.radius[:, None]
    chords = np.where(robot.prismatic, 0.0, 2 * np.sin(np.minimum(half, np.pi) / 2))
    slides = np.where(robot.prismatic, half, 0.0)
    carried = extent.link[:, None] > np.arange(robot.dof)
    moved = np.zeros(len(extent))
    for j in range(robot.dof - 1, -1, -1):
        moved += carried[:, j] * (slides[j] + chords[j] * (arms[:, j] + moved))
    return float(moved.max())


def prove_path(
    path: Path,
    checker: Checker,
    extent: SphereCover,
    *,
    floor: float = 0.0,
    slack: ArrayLike = 0.0,
    resolution: float = 1e-5,
    max_evaluations: int = 20_000,
) -> Proof:
    """Prove that a joint-linear path keeps its clearance above `floor` everywhere, or find where it does not.

    Args:
        path: straight lines in joint space.
        checker: the truth about collisions at one configuration.
        extent: spheres in link frames that contain all that moves.
        floor: clearance to keep, metres.
        slack: (k - 1, n), or what broadcasts to it: how far the true motion may stray from each straight line.
        resolution: intervals whose joints move less than this (radians) are not halved further: the proof fails there.
        max_evaluations: collision queries to spend before giving up.

    Raises:
        InputError: inner spheres, or none although the robot has geometry.
    """
    stray = np.broadcast_to(np.asarray(slack, dtype=float), (len(path) - 1, path.robot.dof))
    queue: deque[tuple[float, float]] = deque([(0.0, float(len(path) - 1))])
    margin, smallest, spent = np.inf, Clearance(np.inf), 0
    while queue:
        begin, end = queue.popleft()
        middle = 0.5 * (begin + end)
        q = path.at(middle)
        found = checker(q)
        if spent == 0:
            _check_extent(extent, found)
        spent += 1
        if found.distance < smallest.distance or not np.isfinite(smallest.distance):
            smallest = found
        if not found.distance >= floor:
            return Proof(False, -np.inf, smallest, middle, _words(found, floor), spent)
        half = _half_widths(path, stray, begin, end, q)
        kept = found.distance - motion_bound(path.robot, q, half, extent)
        if kept >= floor:
            margin = min(margin, kept)
        elif (end - begin < 1 and half.max() < resolution + stray.max()) or spent >= max_evaluations:
            why = f"no proof within {spent} queries: {_words(found, floor)}"
            return Proof(False, -np.inf, smallest, middle, why, spent)
        else:
            queue += [(begin, middle), (middle, end)]
    return Proof(True, float(margin), smallest, float("nan"), "", spent)


def prove_segment(
    robot: Robot, q_a: ArrayLike, q_b: ArrayLike, checker: Checker, extent: SphereCover, *, floor: float = 0.0
) -> Proof:
    """`prove_path` for the straight joint line between two configurations."""
    ends = np.stack([np.asarray(q_a, dtype=float), np.asarray(q_b, dtype=float)])
    return prove_path(Path(robot, ends), checker, extent, floor=floor)


def trajectory_clearance(
    robot: Robot,
    trajectory: Trajectory,
    checker: Checker,
    extent: SphereCover,
    *,
    floor: float = 0.0,
    every: int = 5,
) -> Proof:
    """Prove that a timed motion keeps its clearance above `floor` over all of time, not only at its samples.

    The motion is compared with straight lines between every `every`-th sample: between samples `h` seconds apart a
    coordinate whose acceleration stays below a strays from the chord by at most `a h^2 / 8`; that is added as slack.
    (The acceleration is read at the samples; that of a retimed trajectory is continuous, see `retime`.)

    Raises:
        InputError: the trajectory leaves the joint limits.
    """
    keep = np.unique(np.append(np.arange(0, len(trajectory), max(every, 1)), len(trajectory) - 1))
    acceleration = np.abs(trajectory.qdd)
    largest = np.maximum.reduceat(acceleration, keep[:-1], axis=0)
    largest = np.maximum(largest, acceleration[keep[1:]])
    slack = largest * np.diff(trajectory.time[keep])[:, None] ** 2 / 8
    return prove_path(Path(robot, trajectory.q[keep]), checker, extent, floor=floor, slack=slack)


def _check_extent(extent: SphereCover, found: Clearance) -> None:
    """Spheres that don't contain what the checker measures would prove too much."""
    if extent.kind == "inner" or (len(extent) == 0 and any(found.pair)):
        raise InputError(
            f"a proof needs spheres that contain the moving robot, not {len(extent)} of kind {extent.kind!r}",
            where="extent",
        )


def _half_widths(path: Path, stray: Array, begin: float, end: float, q: Array) -> Array:
    """Per joint, how far the motion between two path parameters gets from `q`."""
    first, last = int(np.floor(begin)), int(np.ceil(end))
    corners = np.vstack([path.at([begin, end]), path.configurations[first + 1 : last]])
    widths: Array = np.abs(corners - q).max(axis=0) + stray[first:last].max(axis=0)
    return widths


def _words(found: Clearance, floor: float) -> str:
    a, b = found.pair
    between = f" between {a} and {b}" if a or b else ""
    if found.distance < 0:
        return f"collision{between}, {-1000 * found.distance:.2f} mm deep"
    return f"clearance {1000 * found.distance:.2f} mm{between}, below {1000 * floor:.2f} mm"
