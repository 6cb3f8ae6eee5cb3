"""Proof that a whole motion is clear of collisions, not only the configurations that were looked at.

Over an interval of the motion each joint stays within `h` of its value at the centre. Undoing the joints from the tool
towards the base, a point whose distance from axis j is d at the centre moves by at most `2 sin(h_j / 2) (d + r)` on top
of the r that the joints beyond j have moved it already. If the clearance at the centre exceeds that bound for every
point of the robot, the interval is free: a pair of bodies can't lose more distance than the robot's points move. The
same bound serves self-collision, since the motion of one link relative to another is due to a subset of the joints.
Intervals that fail the test are halved.
"""

from __future__ import annotations

import functools
import importlib
from collections import deque
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from itertools import pairwise
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from workcell.errors import InputError
from workcell.geometry.packing import pack_cover, pack_tree
from workcell.geometry.types import SphereCover
from workcell.ik.problem import Clearance
from workcell.model.collision_model import CollisionModel
from workcell.model.robot import Robot
from workcell.motion.path import Path, Trajectory
from workcell.motion.polynomials import PolynomialMotion
from workcell.pose import Array
from workcell.world.model_clearance import ModelClearance

Checker = Callable[[Array], Clearance]
Look = Callable[[Array, Array], tuple[Clearance, float]]
"""Of a configuration (n,) and half-widths (n,): its clearance, and a lower bound (metres) on all those within them."""

_RESOLUTION, _LOOKS = 1e-5, 20_000
"""Radians of intervals that are not halved further, and collision queries of a proof, unless others are asked for."""
_STRETCH = 0.2
"""Radians of the first intervals in a scene."""
_DISTANCE_TOLERANCE = 1e-6
"""Metres by which the distances of a checker that is no compiled model may be off."""


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
    return float(link_motion(robot, q, half, extent)[0].max())


def link_motion(robot: Robot, q: Array, half: Array, extent: SphereCover) -> Array:
    """How far points of one link can move relative to another, while each joint stays within `half` of its value.

    Arguments as in `motion_bound`; every geom lies within the spheres of the link that carries it.

    Returns:
        (n + 1, n + 1) metres, upper bounds: row a, column b > a for points of link b as seen from link a; row 0 is the
        world. Zero elsewhere.
    """
    bounds = np.empty((robot.joint_count + 1, robot.joint_count + 1))
    values, widths = np.array(robot.joint_values(q), dtype=float), np.array(half, dtype=float)
    if robot.coupling is not None:
        widths = robot.coupling.spans(np.asarray(q, dtype=float), widths)
    _kernels().link_motion(pack_tree(robot), pack_cover(robot, extent)[0], values, widths, bounds)
    return bounds


@functools.cache
def _kernels() -> Any:
    """Compiled kernels, imported on first use: numba takes half a second."""
    return importlib.import_module("workcell.motion.kernels.extent")


def prove_path(
    path: Path,
    checker: Checker,
    extent: SphereCover,
    *,
    floor: float = 0.0,
    slack: ArrayLike = 0.0,
    resolution: float = _RESOLUTION,
    max_evaluations: int = _LOOKS,
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
    collision = _compiled_model(checker)
    look = _look(path.robot, checker, collision, extent)
    edges = _first_edges(path) if collision is not None else [0.0, float(len(path) - 1)]
    if collision is not None and (found := _refuted(path, collision)) is not None:
        return found
    return prove_by_halving(
        path,
        look,
        edges,
        floor=floor,
        slack=slack,
        resolution=resolution,
        max_evaluations=max_evaluations,
    )


def prove_by_halving(
    path: Path,
    look: Look,
    edges: Sequence[float],
    *,
    floor: float = 0.0,
    slack: ArrayLike = 0.0,
    resolution: float = _RESOLUTION,
    max_evaluations: int = _LOOKS,
) -> Proof:
    """The same for whatever tells what is left of clearances about a configuration.

    So several robots are proved against each other too.

    Args:
        path, floor, slack, resolution, max_evaluations: as of `prove_path`.
        look: see `Look`.
        edges: path parameters from 0 to the last waypoint's: between them lie the first intervals.
    """
    stray = np.broadcast_to(np.asarray(slack, dtype=float), (len(path) - 1, path.robot.dof))
    queue: deque[tuple[float, float]] = deque(pairwise(edges))
    margin, smallest, spent = np.inf, Clearance(np.inf), 0
    while queue:
        begin, end = queue.popleft()
        middle = 0.5 * (begin + end)
        q = path.at(middle)
        half = _half_widths(path, stray, begin, end, q)
        found, kept = look(q, half)
        spent += 1
        if found.distance < smallest.distance or not np.isfinite(smallest.distance):
            smallest = found
        if not found.distance >= floor:
            return Proof(False, -np.inf, smallest, middle, _words(found, floor), spent)
        if kept >= floor:
            margin = min(margin, kept)
        elif (end - begin < 1 and half.max() < resolution + stray.max()) or spent >= max_evaluations:
            why = f"no proof within {spent} queries: {_words(found, floor)}"
            return Proof(False, -np.inf, smallest, middle, why, spent)
        else:
            queue += [(begin, middle), (middle, end)]
    return Proof(True, float(margin), smallest, float("nan"), "", spent)


def _compiled_model(checker: Checker) -> CollisionModel | None:
    """The model behind the `clearance` of a scene's world; None: the checker can only be called."""
    return checker.collision if isinstance(checker, ModelClearance) else None


def _refuted(path: Path, collision: CollisionModel) -> Proof | None:
    """That a path is none, because of what is seen at its waypoints.

    MuJoCo itself has something in contact at one of them, or passive loops can't go along from one to the next.
    """
    for k, q in enumerate(path.configurations):
        met = collision.contact(q)
        if met is not None:
            found = Clearance(met.distance, met.pair)
            return Proof(False, -np.inf, found, float(k), _words(found, 0.0), k + 1)
    for k, (one, two) in enumerate(pairwise(path.configurations)):
        reason = collision.torn(one, two)
        if reason:
            return Proof(False, -np.inf, Clearance(-np.inf, reason=reason), float(k), reason, k + 1)
    return None


def _first_edges(path: Path) -> list[float]:
    """Path parameters at most `_STRETCH` apart: over longer intervals too many pairs of geoms come into question."""
    length = np.concatenate([[0.0], np.cumsum(np.abs(np.diff(path.configurations, axis=0)).max(axis=1))])
    count = max(int(np.ceil(length[-1] / _STRETCH)), 1)
    inner = np.interp(np.linspace(0.0, length[-1], count + 1)[1:-1], length, np.arange(len(path)))
    return [0.0, *np.unique(inner).tolist(), float(len(path) - 1)]


def _look(robot: Robot, checker: Checker, collision: CollisionModel | None, extent: SphereCover) -> Look:
    """How to look at one configuration: a clearance, and what is left of all clearances within `half` of it.

    A scene's compiled model is asked link by link: there a pair loses no more than its own links move. Any other
    checker knows the smallest clearance alone, which loses what any point of the robot moves.
    """
    if collision is not None and len(extent):

        def of_pairs(q: Array, half: Array) -> tuple[Clearance, float]:
            kept, found = collision.excess(q, link_motion(robot, q, half, extent), half)
            _check_extent(extent, found.pair)
            return Clearance(found.distance, found.pair, found.reason), kept - collision.tolerance

        return of_pairs

    def of_all(q: Array, half: Array) -> tuple[Clearance, float]:
        found = checker(q)
        _check_extent(extent, found.pair)
        return found, found.distance - motion_bound(robot, q, half, extent) - _DISTANCE_TOLERANCE

    return of_all


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

    It is compared with straight lines between every `every`-th sample (see `chords`).

    Raises:
        InputError: the trajectory leaves the joint limits.
    """
    q, slack = chords(trajectory, every)
    return prove_path(Path(robot, q), checker, extent, floor=floor, slack=slack)


def chords(trajectory: Trajectory, every: int) -> tuple[Array, Array]:
    """Straight lines between samples of a timed motion, and how far it strays from them.

    Between its samples a trajectory is the quintics that share position, velocity and acceleration there. Over h
    seconds a coordinate whose acceleration stays below a, which is read off the quintics' coefficients, strays from
    the straight line by at most `a h^2 / 8`.

    Returns:
        every `every`-th configuration (k, n), the last too; and for each line (k - 1, n) what joints stray, radians or
        metres.
    """
    keep = np.unique(np.append(np.arange(0, len(trajectory), max(every, 1)), len(trajectory) - 1))
    acceleration = PolynomialMotion.of_trajectory(trajectory).largest(2)
    largest = np.maximum.reduceat(acceleration, keep[:-1], axis=0)
    slack = largest * np.diff(trajectory.time[keep])[:, None] ** 2 / 8
    return trajectory.q[keep], slack


def _check_extent(extent: SphereCover, pair: tuple[str, str]) -> None:
    """Spheres that don't contain what the checker measures would prove too much."""
    if extent.kind == "inner" or (len(extent) == 0 and any(pair)):
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
    if found.reason:
        return found.reason
    a, b = found.pair
    between = f" between {a} and {b}" if a or b else ""
    if found.distance < 0:
        return f"collision{between}, {-1000 * found.distance:.2f} mm deep"
    return f"clearance {1000 * found.distance:.2f} mm{between}, below {1000 * floor:.2f} mm"
