"""Tool paths: poses on lines, arcs, circles and splines, and how far the tool may stray from them, axis by axis."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from itertools import pairwise
from typing import Literal

import numpy as np
from numpy.typing import ArrayLike

from workcell.errors import InputError
from workcell.model.robot import Robot
from workcell.pose import Array, Pose, axis_angle_to_matrix, read_only, rotation_vector

Axes = Literal["tool", "world"]
FREE = float("inf")
"""No bound."""
_SMALLEST = 1e-9


@dataclass(frozen=True, slots=True)
class PathTolerance:
    """How far the tool may be from its pose on the path.

    The tool's coordinates from its pose are a position and a rotation vector, both in the axes of `frame`. The tool may
    be anywhere within a box of them: `PathTolerance(rotation=(0, 0, FREE))` leaves the rotation about the tool's z axis
    free; `PathTolerance(position=(1e-3, 0, 0), frame="world")` allows 1 mm along the world's x.

    Attributes:
        position: (3,) metres, each 0 or more; `FREE` for no bound.
        rotation: (3,) radians, each 0 or more; `FREE` (or pi and more) for no bound.
        frame: `tool`: axes of the path's pose; `world`.

    Raises:
        InputError: a bound that is negative or NaN, a wrong number of bounds, an unknown frame.
    """

    position: ArrayLike = (0.0, 0.0, 0.0)
    rotation: ArrayLike = (0.0, 0.0, 0.0)
    frame: Axes = "tool"

    def __post_init__(self) -> None:
        for name in ("position", "rotation"):
            bounds = np.asarray(getattr(self, name), dtype=float)
            if bounds.shape != (3,) or not np.all(bounds >= 0):
                raise InputError(
                    f"a tolerance takes three bounds, zero or more, not {bounds.tolist()}",
                    where=f"tolerance.{name}",
                    remedy="metres or radians; inf for no bound",
                )
            object.__setattr__(self, name, read_only(bounds))
        if self.frame not in ("tool", "world"):
            raise InputError(f"unknown frame {self.frame!r}", where="tolerance.frame", remedy="tool or world")

    @property
    def exact(self) -> bool:
        """Whether the pose itself is asked for."""
        return not np.any(self.box)

    @property
    def box(self) -> Array:
        """(6,) metres and radians; inf for no bound."""
        rotation = np.where(np.asarray(self.rotation) >= np.pi, FREE, self.rotation)
        return np.concatenate([np.asarray(self.position), rotation])

    def coordinates(self, pose: Pose, actual: Pose) -> Array:
        """(6,) position (m) and rotation vector (rad) of the tool at `actual` from `pose`, in the frame's axes."""
        R, now = pose.rotation, actual.rotation
        apart = actual.position - pose.position
        if self.frame == "tool":
            return np.concatenate([R.T @ apart, rotation_vector(R.T @ now)])
        return np.concatenate([apart, rotation_vector(now @ R.T)])

    def nearest(self, pose: Pose, actual: Pose) -> Pose:
        """The allowed pose that is nearest to `actual`, coordinate by coordinate, where the path asks for `pose`."""
        if self.exact:
            return pose
        return self.moved(pose, np.clip(self.coordinates(pose, actual), -self.box, self.box))

    def allowed(self, pose: Pose, robot: Robot, q: Array) -> Pose:
        """The allowed pose that is nearest to the robot's tool at q (n,), where the path asks for `pose`."""
        return pose if self.exact else self.nearest(pose, robot.fk(q))

    def moved(self, pose: Pose, x: Array) -> Pose:
        """The pose whose coordinates from `pose` are x (6,)."""
        angle = float(np.linalg.norm(x[3:]))
        turn = axis_angle_to_matrix(x[3:] / max(angle, 1e-300), angle) if angle > 0 else np.eye(3)
        R = pose.rotation
        if self.frame == "tool":
            return Pose.from_rotation(pose.position + R @ x[:3], R @ turn)
        return Pose.from_rotation(pose.position + x[:3], turn @ R)

    def excess(self, pose: Pose, actual: Pose) -> tuple[float, float]:
        """Metres and radians by which the tool at `actual` is beyond what is allowed where the path asks for `pose`."""
        return self.nearest(pose, actual).error_to(actual)


def check_tool_path(poses: Sequence[Pose]) -> tuple[Pose, ...]:
    """The poses of a tool path; raises InputError, naming the element, for fewer than two or what is no pose."""
    found = tuple(poses)
    for i, pose in enumerate(found):
        if not isinstance(pose, Pose):
            raise InputError(
                f"a tool path is made of poses, not {type(pose).__name__}",
                where=f"tool_poses[{i}]",
                remedy="Pose(position, quat_wxyz), or what line, arc, circle and through return",
            )
    if len(found) < 2:
        raise InputError(f"a tool path takes two or more poses, not {len(found)}", where="tool_poses")
    return found


def line(start: Pose, end: Pose, spacing: float = 0.02, spacing_rad: float = 0.1) -> tuple[Pose, ...]:
    """Poses on a straight line with the rotation on the shortest great arc, `start` and `end` included.

    Args:
        start, end: `T_world_tool`.
        spacing, spacing_rad: largest distance (metres) and angle (radians) between neighbours.
    """
    pieces = _pieces(*start.error_to(end), spacing, spacing_rad)
    inner = (start.interpolate(end, i / pieces) for i in range(1, pieces))
    return (start, *inner, end)


def turned(pose: Pose, count: int, near: Pose) -> list[Pose]:
    """A pose turned about its own z axis by each of `count` equal parts of a whole turn.

    The one turned least from `near` comes first. A gripper may hold a round or many-sided object at any of
    them.

    Raises:
        InputError: a count below one.
    """
    if count < 1:
        raise InputError(f"a whole turn in {count} parts", where="count", remedy="1 or more")
    halves = np.pi * np.arange(count) / count
    poses = [pose @ Pose(np.zeros(3), np.array([np.cos(a), 0.0, 0.0, np.sin(a)])) for a in halves]
    return sorted(poses, key=lambda turn: turn.error_to(near)[1])


def polyline(corners: Sequence[Pose], spacing: float = 0.02, spacing_rad: float = 0.1) -> tuple[Pose, ...]:
    """Straight lines from corner to corner; each corner once."""
    corners = check_tool_path(corners)
    path = [corners[0]]
    for a, b in pairwise(corners):
        path += line(a, b, spacing, spacing_rad)[1:]
    return tuple(path)


def arc(
    start: Pose,
    centre: ArrayLike,
    axis: ArrayLike,
    angle: float,
    spacing: float = 0.02,
    *,
    turning: bool = False,
    spacing_rad: float = 0.1,
) -> tuple[Pose, ...]:
    """Poses on a circular arc from `start` about an axis through `centre`.

    Args:
        start: `T_world_tool`; it may lie at any height along the axis.
        centre, axis: (3,) metres and a direction, in the world; counter-clockwise seen from the axis's tip.
        angle: radians, negative for clockwise; not zero.
        spacing, spacing_rad: largest distance along the arc (metres) and angle (radians) between neighbours.
        turning: whether the tool turns with the arc; otherwise it keeps its orientation.

    Raises:
        InputError: numbers that are not finite, an axis without direction, an angle of zero, a start on the axis.
    """
    middle, direction = _vector(centre, "centre"), _vector(axis, "axis")
    length = float(np.linalg.norm(direction))
    if not (np.isfinite(angle) and abs(angle) > _SMALLEST and length > _SMALLEST):
        raise InputError(
            f"no arc turns by {angle} rad about {direction.tolist()}",
            where="arc",
            remedy="a finite angle and an axis with a direction",
        )
    direction = direction / length
    arm = start.position - middle
    radius = float(np.linalg.norm(np.cross(direction, arm)))
    if radius < _SMALLEST:
        raise InputError("the arc begins on its own axis", where="centre", remedy="another centre or axis")
    pieces = _pieces(radius * abs(angle), abs(angle), spacing, spacing_rad)
    turns = axis_angle_to_matrix(np.tile(direction, (pieces + 1, 1)), np.linspace(0.0, angle, pieces + 1))
    R = start.rotation
    return (
        start,
        *(Pose.from_rotation(middle + T @ arm, T @ R if turning else R) for T in turns[1:]),
    )


def circle(
    start: Pose, centre: ArrayLike, axis: ArrayLike, spacing: float = 0.02, *, turning: bool = False
) -> tuple[Pose, ...]:
    """A whole `arc`: the last pose is the first one again."""
    return (*arc(start, centre, axis, 2 * np.pi, spacing, turning=turning)[:-1], start)


def through(knots: Sequence[Pose], spacing: float = 0.02, spacing_rad: float = 0.1) -> tuple[Pose, ...]:
    """Poses on a smooth curve through the given ones: a natural cubic spline in position over chord length.

    Rotations lie on the shortest great arcs from knot to knot.

    Raises:
        InputError: fewer than two poses, or neighbours at one place.
    """
    from scipy.interpolate import CubicSpline

    knots = check_tool_path(knots)
    points = np.stack([pose.position for pose in knots])
    chords = np.linalg.norm(np.diff(points, axis=0), axis=1)
    if chords.min() < _SMALLEST:
        raise InputError(
            "two neighbouring poses of a spline lie at one place",
            where=f"tool_poses[{int(np.argmin(chords))}]",
            remedy="leave one of them out",
        )
    s = np.concatenate([[0.0], np.cumsum(chords)])
    curve = CubicSpline(s, points, bc_type="natural")
    path = [knots[0]]
    for (a, b), (s_a, s_b) in zip(pairwise(knots), pairwise(s), strict=True):
        u = np.linspace(s_a, s_b, 9)
        length = float(np.linalg.norm(np.diff(curve(u), axis=0), axis=1).sum())
        pieces = _pieces(length, a.error_to(b)[1], spacing, spacing_rad)
        for i in range(1, pieces):
            here = a.interpolate(b, i / pieces)
            path.append(Pose(curve(s_a + (s_b - s_a) * i / pieces), here.quat_wxyz))
        path.append(b)
    return tuple(path)


def distance_to_path(points: ArrayLike, poses: Sequence[Pose]) -> Array:
    """Metres (k,) of points (k, 3) from the straight lines between the positions of neighbouring poses."""
    x = np.asarray(points, dtype=float).reshape(-1, 1, 3)
    corners = np.stack([pose.position for pose in check_tool_path(poses)])
    begin, along = corners[:-1], np.diff(corners, axis=0)
    square = np.maximum(np.einsum("si,si->s", along, along), 1e-300)
    share = np.clip(np.einsum("ksi,si->ks", x - begin, along) / square, 0.0, 1.0)
    nearest: Array = np.linalg.norm(x - begin - share[..., None] * along, axis=-1).min(axis=1)
    return nearest


def _pieces(length: float, angle: float, spacing: float, spacing_rad: float) -> int:
    if not (0 < spacing < np.inf and 0 < spacing_rad < np.inf):
        raise InputError("the spacing of a tool path must be positive and finite", where="spacing")
    return max(int(np.ceil(length / spacing - 1e-9)), int(np.ceil(angle / spacing_rad - 1e-9)), 1)


def _vector(values: ArrayLike, name: str) -> Array:
    vector = np.asarray(values, dtype=float)
    if vector.shape != (3,) or not np.all(np.isfinite(vector)):
        raise InputError(f"{name} takes three finite numbers, not {vector.tolist()}", where=name)
    return vector
