"""A C2 joint motion through waypoints: a cubic spline that stays near the straight lines and inside the limits."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from itertools import pairwise

import numpy as np

from workcell.errors import InputError
from workcell.model.robot import LIMIT_SLACK
from workcell.motion.path import Path
from workcell.pose import Array

_RINGING = 0.05
"""Corner angle times segment length (radians squared) from which a corner gets support points: 1 mrad off the line."""
SMALLEST = 1e-12
"""What counts as zero: of steps, lengths, speeds, and of what they are divided by."""
_TWIN, _TOOL_TWIN = 1e-3, 1e-4
"""Radians (metres) within which a waypoint counts as the one before it: of a path in joint space, and of a tool path,
where less is noticed. Between two such points lies no way, but any direction: the motion would stop to turn there."""
_ROUNDS = 40
"""Rounds of moving points to bring a spline inside the joint limits."""


@dataclass(frozen=True, slots=True)
class JointSpline:
    """A C2 cubic spline q(s), natural at both ends, over chord length."""

    knots: Array
    points: Array
    second: Array

    @staticmethod
    def through(points: Array) -> JointSpline:
        """Solve the tridiagonal system for the second derivatives at the knots."""
        h = np.linalg.norm(np.diff(points, axis=0), axis=1)
        knots = np.concatenate([[0.0], np.cumsum(h)])
        second = np.zeros_like(points)
        if len(points) > 2:
            from scipy.linalg import solve_banded

            slope = np.diff(points, axis=0) / h[:, None]
            bands = np.zeros((3, len(points) - 2))
            bands[0, 1:], bands[1], bands[2, :-1] = h[1:-1], 2 * (h[:-1] + h[1:]), h[1:-1]
            second[1:-1] = solve_banded((1, 1), bands, 6 * np.diff(slope, axis=0))
        return JointSpline(knots, points, second)

    @property
    def length(self) -> float:
        """Chord length from the first point to the last."""
        return float(self.knots[-1])

    def derivatives(self, s: Array) -> tuple[Array, Array, Array]:
        """q, dq/ds and d2q/ds2 at s (T,): (T, n) each."""
        s = np.clip(s, 0.0, self.length)
        i = np.clip(np.searchsorted(self.knots, s, side="right") - 1, 0, len(self.knots) - 2)
        h = (self.knots[i + 1] - self.knots[i])[:, None]
        b = (s - self.knots[i])[:, None] / h
        a = 1 - b
        p0, p1, m0, m1 = self.points[i], self.points[i + 1], self.second[i], self.second[i + 1]
        q = a * p0 + b * p1 + ((a**3 - a) * m0 + (b**3 - b) * m1) * h**2 / 6
        first = (p1 - p0) / h + ((3 * b**2 - 1) * m1 - (3 * a**2 - 1) * m0) * h / 6
        return q, first, a * m0 + b * m1

    def extremes(self) -> tuple[Array, Array]:
        """(k, n) smallest and largest value of each joint on each of k intervals, where its derivative is zero too."""
        h = np.diff(self.knots)[:, None] ** 2
        p0, p1, m0, m1 = self.points[:-1], self.points[1:], self.second[:-1], self.second[1:]
        # dq/db = a b^2 + 2 c b + d along an interval, b from 0 to 1;
        # its roots, without cancellation, are w / a and d / w
        a, c, d = h * (m1 - m0) / 2, h * m0 / 2, p1 - p0 - h * (2 * m0 + m1) / 6
        w = -(c + np.copysign(np.sqrt(np.maximum(c * c - a * d, 0.0)), c))
        found = [p0, p1]
        for over, under in ((w, a), (d, w)):
            b = np.clip(np.divide(over, under, out=np.zeros_like(w), where=np.abs(under) > SMALLEST), 0, 1)
            left = 1 - b
            found.append(left * p0 + b * p1 + ((left**3 - left) * m0 + (b**3 - b) * m1) * h / 6)
        return np.min(found, axis=0), np.max(found, axis=0)

    def motion(self, s: Array, sd: Array, sdd: Array) -> tuple[Array, Array, Array]:
        """q, qd and qdd (T, n) of a motion s(t) along the spline."""
        q, first, second = self.derivatives(s)
        return q, first * sd[:, None], second * sd[:, None] ** 2 + first * sdd[:, None]


def spline_within_limits(path: Path, support: float) -> JointSpline:
    """A spline that keeps the joint limits, see `spline_inside`."""
    robot, twin = path.robot, _TOOL_TWIN if path.tool_poses else _TWIN
    waypoints = _without_twins(path.configurations, twin)
    return spline_inside(waypoints, robot.lower, robot.upper, robot.joint_names, support)


def spline_inside(
    waypoints: Array, lower: Array, upper: Array, names: Sequence[str], support: float
) -> JointSpline:
    """A spline that keeps limits: where it would swing beyond one, inner points move inside by as much.

    Where that is not enough, support points at every corner shorten the swings first.

    Args:
        waypoints: (k, n).
        lower, upper: (n,) limits.
        names: of the n numbers, for messages.
        support: distance from a sharp corner to the first of the extra points that hold the motion on straight lines.

    Raises:
        InputError: nothing moves, or no such spline was found.
    """
    low, high = lower - LIMIT_SLACK, upper + LIMIT_SLACK
    for ringing in (_RINGING, 0.0):
        points = _with_support(waypoints, support, ringing)
        for _ in range(_ROUNDS):
            spline = JointSpline.through(points)
            smallest, largest = spline.extremes()
            if np.all((smallest >= low) & (largest <= high)):
                return spline
            beyond = np.maximum(largest - upper, 0.0) - np.maximum(lower - smallest, 0.0)
            worst = np.where(np.abs(beyond[1:]) > np.abs(beyond[:-1]), beyond[1:], beyond[:-1])
            points = points.copy()
            points[1:-1] -= 1.2 * worst
    k = int(np.argmax(np.abs(beyond).max(axis=0)))
    raise InputError(
        f"between waypoints the smooth motion would leave the limits of {names[k]}",
        where="path",
        remedy="keep the waypoints a little further inside the joint limits",
    )


def _without_twins(waypoints: Array, near: float) -> Array:
    """Waypoints (k, n) but for those within `near` of the last one kept; both ends are kept.

    A path that is shorter than that keeps all that differ.
    """
    kept = [0]
    for k in range(1, len(waypoints) - 1):
        if np.linalg.norm(waypoints[k] - waypoints[kept[-1]]) > near:
            kept.append(k)
    while len(kept) > 1 and np.linalg.norm(waypoints[-1] - waypoints[kept[-1]]) <= near:
        kept.pop()
    if len(kept) == 1 and np.linalg.norm(waypoints[-1] - waypoints[0]) <= near:
        return waypoints
    return waypoints[[*kept, len(waypoints) - 1]]


def _with_support(points: Array, support: float, ringing: float) -> Array:
    """Waypoints without repetitions, with points at 1, 2, 4 ... times `support` from corners along long segments.

    A cubic spline rings after a corner by about a fiftieth of the corner's angle times the length of the segment; where
    that is too much, extra points hold it on the line. The ringing decays by a factor of about four a knot, so that
    the spacing may double from knot to knot.
    """
    points = points[np.append(True, np.abs(np.diff(points, axis=0)).max(axis=1) > SMALLEST)]
    if len(points) < 2:
        raise InputError(
            "the path does not move", where="path", remedy="a path takes two different configurations"
        )
    corners = np.concatenate([[0.0], _turning_angles(points), [0.0]])
    out = [points[:1]]
    for (a, b), (before, after) in zip(pairwise(points), pairwise(corners), strict=True):
        length = float(np.linalg.norm(b - a))
        far = length / (2.5 * support)
        near = support * 2.0 ** np.arange(int(np.log2(far)) + 1) / length if far > 1 else np.zeros(0)
        first = near if before * length > ringing else np.zeros(0)
        last = 1 - near[::-1] if after * length > ringing else np.zeros(0)
        fractions = np.concatenate([first, last, [1.0]])
        out.append(a + fractions[:, None] * (b - a))
    return np.vstack(out)


def _turning_angles(points: Array) -> Array:
    """Angles (k - 2,) between the directions of neighbouring segments."""
    steps = np.diff(points, axis=0)
    steps = steps / np.linalg.norm(steps, axis=1, keepdims=True)
    angles: Array = 2 * np.arcsin(np.clip(np.linalg.norm(np.diff(steps, axis=0), axis=1) / 2, 0.0, 1.0))
    return angles
