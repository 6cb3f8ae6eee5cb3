"""Whether a path that somebody claims is right: by kinematics and distances of its own, and a bound of its own.

Nothing here is shared with the planners' kernels: links are placed by products of exponentials, distances are those of
`workcell.ik.judge.exact`, and between the configurations that are looked at a sphere is bounded to first order: joint
by joint from the sphere towards the base, a centre at distance d from an axis moves by at most `2 sin(h / 2) (d + r)`
on top of the r that the joints before have moved it, while that joint stays within h of its value.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike

from workcell.errors import InputError
from workcell.ik.judge.exact import ExactDistances, exact_kinematics, joint_positions, skew
from workcell.ik.judge.verify import Verifier, sphere_name
from workcell.ik.problem import Clearance, IKProblem
from workcell.model.robot import LIMIT_SLACK, Robot
from workcell.pose import Array

START_TOLERANCE = 1e-6
"""Radians between a path's first configuration and the start."""
UNSEEN = 1e-4
"""Metres that the rigorous bound may leave open below zero, on short intervals alone; what is looked at must be
clear."""
_SHORT, _FINEST = 1e-5, 1e-7
"""Radians: intervals whose joints move less may use that tolerance, and are not halved further."""
_BATCH = 256


@dataclass(frozen=True, slots=True)
class PathVerdict:
    """What the judge found.

    Attributes:
        accepted: starts at the start, ends at the target, keeps the limits, is clear all along.
        reason: why not, in words; empty when accepted.
        clearance: smallest clearance that was looked at, with its pair.
        bound: proved lower bound on the clearance everywhere on the path; -inf where none was proved.
        length: of the path, radians (L2).
        looks: configurations looked at.
    """

    accepted: bool
    reason: str
    clearance: Clearance
    bound: float
    length: float
    looks: int


def judge_path(problem: IKProblem, start: ArrayLike, path: ArrayLike) -> PathVerdict:
    """Judge corners (k, n), joined by straight joint lines, as an answer to a problem of spheres and pieces.

    Anything that is no path is refused with the reason, not raised.

    Raises:
        InputError: the problem has a judge of its own (`checker`), or pairs of spheres that must keep clear.
    """
    if problem.checker is not None or problem.self_collision is not None:
        raise InputError("paths are judged among spheres and pieces only", where="problem")
    robot, refused = problem.robot, Clearance(float("nan"))
    try:
        points = np.asarray(path, dtype=float)
    except (TypeError, ValueError, OverflowError):
        return PathVerdict(False, "the path is not a list of configurations", refused, -np.inf, np.nan, 0)
    reason = _shape_reason(robot, np.asarray(start, dtype=float), points)
    if not reason:
        end = Verifier(problem)(points[-1])
        reason = "" if end.accepted else f"its end: {'; '.join(end.reasons)}"
    if reason:
        return PathVerdict(False, reason, refused, -np.inf, np.nan, 0)
    length = float(np.linalg.norm(np.diff(points, axis=0), axis=1).sum())
    if problem.cover is None or len(problem.cover) == 0 or not problem.obstacles:
        return PathVerdict(True, "", Clearance(np.inf), np.inf, length, 0)
    return _PathProof(problem, points).run(length)


def _shape_reason(robot: Robot, start: Array, points: Array) -> str:
    if points.ndim != 2 or points.shape[1] != robot.dof or len(points) < 1:
        return f"the path has shape {points.shape}, not (k, {robot.dof})"
    if not np.all(np.isfinite(points)):
        return "the path is not finite"
    away = float(np.abs(points[0] - start).max())
    if away > START_TOLERANCE:
        return f"it begins {away:.3g} rad from the start"
    outside = np.argwhere((points < robot.lower - LIMIT_SLACK) | (points > robot.upper + LIMIT_SLACK))
    if len(outside):
        row, joint = (int(i) for i in outside[0])
        return (
            f"corner {row}: joint {robot.joint_names[joint]} = {points[row, joint]:.6g} is outside "
            f"[{robot.lower[joint]:.6g}, {robot.upper[joint]:.6g}]"
        )
    return ""


class _PathProof:
    """Breadth-first subdivision of all segments, a batch of configurations at a time."""

    def __init__(self, problem: IKProblem, points: Array) -> None:
        assert problem.cover is not None
        self.problem, self.points, self.cover = problem, points, problem.cover
        self.links = BatchLinks(problem.robot)
        self.distances = ExactDistances(problem.obstacles)
        self.carried = self.cover.link[:, None] > np.arange(problem.robot.joint_count)

    def run(self, length: float) -> PathVerdict:
        segments = max(len(self.points) - 1, 1)
        begin = np.arange(segments, dtype=float)
        end = begin + 1.0
        smallest, bound, looks, where = np.inf, np.inf, 0, (0, 0)
        while len(begin):
            later: list[tuple[Array, Array]] = []
            for first in range(0, len(begin), _BATCH):
                a, b = begin[first : first + _BATCH], end[first : first + _BATCH]
                middle, half = self._intervals(a, b)
                gaps, pieces, moved = self._look(middle, half)
                looks += len(a)
                row, sphere = np.unravel_index(int(np.argmin(gaps)), gaps.shape)
                if gaps[row, sphere] < smallest:
                    smallest, where = float(gaps[row, sphere]), (int(sphere), int(pieces[row, sphere]))
                if smallest < 0.0:
                    place = 0.5 * float(a[row] + b[row])
                    pair = self._pair(where)
                    reason = (
                        f"{pair[0]} is {-1e3 * smallest:.3g} mm inside {pair[1]} at {place:.4f} of {segments}"
                    )
                    return PathVerdict(False, reason, Clearance(smallest, pair), -np.inf, length, looks)
                kept = (gaps - moved).min(axis=1)
                widest = half.max(axis=1)
                open_ = kept < np.where(widest < _SHORT, -UNSEEN, 0.0)
                bound = min(bound, float(kept[~open_].min(initial=np.inf)))
                if np.any(open_ & (widest < _FINEST)):
                    pair = self._pair(where)
                    return PathVerdict(
                        False,
                        "no proof between the configurations looked at",
                        Clearance(smallest, pair),
                        -np.inf,
                        length,
                        looks,
                    )
                centre = 0.5 * (a + b)
                later += [(a[open_], centre[open_]), (centre[open_], b[open_])]
            begin = np.concatenate([pair[0] for pair in later]) if later else np.zeros(0)
            end = np.concatenate([pair[1] for pair in later]) if later else np.zeros(0)
        return PathVerdict(True, "", Clearance(smallest, self._pair(where)), bound, length, looks)

    def _pair(self, where: tuple[int, int]) -> tuple[str, str]:
        return sphere_name(self.problem, where[0]), self.problem.obstacles[where[1]].name

    def _intervals(self, a: Array, b: Array) -> tuple[Array, Array]:
        """Configurations (k, n) in the middle of parameter intervals, and how far each joint moves from there."""
        if len(self.points) == 1:
            return self.points, np.zeros_like(self.points)
        row = np.minimum(a.astype(np.int64), len(self.points) - 2)
        step = self.points[row + 1] - self.points[row]
        middle = self.points[row] + (0.5 * (a + b) - row)[:, None] * step
        return middle, 0.5 * (b - a)[:, None] * np.abs(step)

    def _look(self, q: Array, half: Array) -> tuple[Array, Array, Array]:
        """For configurations (k, n): each sphere's clearance, nearest piece, and how far it may move; (k, m) each."""
        R, p = self.links(q)
        link = self.cover.link
        centres = np.einsum("kmij,mj->kmi", R[:, link], self.cover.centre) + p[:, link]
        distances = self.distances(centres.reshape(-1, 3)).reshape(*centres.shape[:2], -1)
        nearest = distances.argmin(axis=2)
        gaps = np.take_along_axis(distances, nearest[..., None], axis=2)[..., 0] - self.cover.radius
        robot = self.problem.robot
        half = _joint_widths(robot, q, half)
        axis = np.einsum("kjab,jb->kja", R[:, 1:], robot.axis)
        chord = np.where(robot.prismatic, 0.0, 2 * np.sin(np.minimum(half, np.pi) / 2))
        slide = np.where(robot.prismatic, half, 0.0)
        moved = np.zeros(gaps.shape)
        for j in range(robot.joint_count - 1, -1, -1):
            arm = np.linalg.norm(np.cross(centres - p[:, None, j + 1], axis[:, None, j]), axis=2)
            turned = slide[:, None, j] + chord[:, None, j] * (arm + moved)
            moved += np.where(self.carried[:, j], turned, 0.0)
        return gaps, nearest, moved


def _joint_widths(robot: Robot, q: Array, half: Array) -> Array:
    """(k, m) how far each joint may be from its value at q (k, n) while each variable is within `half` of its own."""
    if robot.coupling is None:
        return half
    middle, width = q[:, robot.coupling.variable], half[:, robot.coupling.variable]
    reach, total = np.abs(middle) + width, np.zeros_like(width)
    for power in range(1, robot.coupling.coefficients.shape[1]):
        # |x^i - c^i| <= i |x - c| max(|x|, |c|)^(i - 1)
        total += np.abs(robot.coupling.coefficients[:, power]) * power * width * reach ** (power - 1)
    return total


class BatchLinks:
    """World poses of a serial robot's links for many configurations, by products of exponentials."""

    def __init__(self, robot: Robot) -> None:
        self._robot = robot
        exact = exact_kinematics(robot)
        self._zero_rotation, self._zero_position = exact.zero_rotation, exact.zero_position
        self._axis = np.einsum("kij,kj->ki", exact.zero_rotation[1:], robot.axis)
        self._cross = skew(self._axis)

    def __call__(self, q: Array) -> tuple[Array, Array]:
        """Rotations (k, m + 1, 3, 3) and positions (k, m + 1, 3) at configurations (k, n)."""
        q = joint_positions(self._robot, q)
        k, n = q.shape
        R, p = np.empty((k, n + 1, 3, 3)), np.empty((k, n + 1, 3))
        turned, moved = np.tile(np.eye(3), (k, 1, 1)), np.zeros((k, 3))
        R[:, 0], p[:, 0] = self._zero_rotation[0], self._zero_position[0]
        for j in range(n):
            K, origin = self._cross[j], self._zero_position[j + 1]
            if self._robot.prismatic[j]:
                moved = moved + turned @ self._axis[j] * q[:, j, None]
            else:
                angle = q[:, j, None, None]
                rotation = np.eye(3) + np.sin(angle) * K + (1 - np.cos(angle)) * (K @ K)
                moved = moved + np.einsum(
                    "kab,kb->ka", turned, origin - np.einsum("kab,b->ka", rotation, origin)
                )
                turned = turned @ rotation
            R[:, j + 1] = turned @ self._zero_rotation[j + 1]
            p[:, j + 1] = np.einsum("kab,b->ka", turned, self._zero_position[j + 1]) + moved
        return R, p
