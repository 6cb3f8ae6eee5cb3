"""A robot among obstacles as arrays for the compiled kernels of planning and proof."""

from __future__ import annotations

import functools
import importlib
from collections.abc import Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from workcell.errors import InputError
from workcell.geometry.packing import axis_frames, pack_couple, pack_cover, pack_obstacles, pack_variables
from workcell.geometry.types import Piece, SphereCover
from workcell.identity_cache import ByIdentity
from workcell.ik.problem import Clearance
from workcell.kernels.constants import FAR
from workcell.model.robot import LIMIT_SLACK, Robot
from workcell.pose import Array, read_only

if TYPE_CHECKING:
    from workcell.motion.kernels.body import Body

NO_CONE = np.array([0.0, 0.0, 1.0, 0.0, 0.0, 1.0, -2.0])
"""Any direction of the tool is allowed."""


@functools.cache
def kernels() -> Any:
    """The compiled kernels (`workcell.motion.kernels.entries`), imported on first use: numba takes half a second."""
    return importlib.import_module("workcell.motion.kernels.entries")


@dataclass(frozen=True, slots=True)
class Upright:
    """A limit on the tool's orientation: an axis of it stays within an angle of a direction (a cup stays upright).

    Attributes:
        angle: largest angle between the two, radians, in (0, pi).
        tool_axis: (3,) unit vector in the tool's frame; its z by default.
        direction: (3,) unit vector in the world; up by default.

    Raises:
        InputError: an angle outside (0, pi), or a vector without direction.
    """

    angle: float
    tool_axis: ArrayLike = (0.0, 0.0, 1.0)
    direction: ArrayLike = (0.0, 0.0, 1.0)

    def __post_init__(self) -> None:
        if not 0 < self.angle < np.pi:
            raise InputError(
                f"the tool may tilt by {self.angle} rad", where="upright", remedy="an angle between 0 and pi"
            )
        for name in ("tool_axis", "direction"):
            vector = np.asarray(getattr(self, name), dtype=float)
            length = np.linalg.norm(vector) if vector.shape == (3,) else np.nan
            if not (np.isfinite(length) and length > 0):
                raise InputError(
                    f"the {name.replace('_', ' ')} {vector.tolist()} has no direction",
                    where="upright",
                    remedy="three finite numbers, not all zero",
                )
            object.__setattr__(self, name, read_only(vector / length))

    def tilt(self, robot: Robot, q: ArrayLike) -> float:
        """The angle between the axis and its direction at a configuration (n,), radians."""
        axis = robot.fk_transform(np.asarray(q, dtype=float))[:3, :3] @ np.asarray(self.tool_axis)
        wanted = np.asarray(self.direction)
        return float(np.arctan2(np.linalg.norm(np.cross(axis, wanted)), axis @ wanted))

    def kept(self, robot: Robot, q: ArrayLike) -> bool:
        """Whether a configuration (n,) keeps the limit."""
        return self.tilt(robot, q) <= self.angle

    def row(self) -> Array:
        """The cone as the kernels take it."""
        row: Array = np.concatenate([self.tool_axis, self.direction, [np.cos(self.angle)]])  # type: ignore[list-item]
        return row


def pack_body(
    robot: Robot,
    cover: SphereCover | None,
    obstacles: Sequence[Piece],
    *,
    self_pairs: ArrayLike | None = None,
    upright: Upright | None = None,
    floor: float = 0.0,
) -> Body:
    """What the kernels need to know.

    Args:
        robot: serial; its default tool is the one that `upright` speaks of.
        cover: spheres of all that moves, in link frames (those of an attached object too); None: nothing can collide.
        obstacles: convex pieces in the world frame.
        self_pairs: (p, 2) indices of spheres of the cover that must keep clear of each other; None: none.
        upright: limit on the tool's orientation; None: none.
        floor: metres of clearance to keep.

    Raises:
        InputError: a robot that is no chain, a pair of spheres that does not exist, a floor that is not finite.
    """
    if not robot.is_serial:
        raise InputError(f"{robot.name} is a tree", where="robot", remedy="pass robot.chain(tool)")
    if not np.isfinite(floor):
        raise InputError(f"a clearance of {floor} m can't be kept", where="floor")
    arm = pack_variables(robot)
    if cover is None:
        cover = SphereCover(np.zeros(0, dtype=np.int64), np.zeros((0, 3)), np.zeros(0))
    spheres, balls = pack_cover(robot, cover)
    rows, faces = pack_obstacles(obstacles)
    pairs, apart = _pairs(cover, spheres, self_pairs)
    body: Body = kernels().Body(
        arm.frames,
        arm.bounds,
        spheres,
        balls,
        rows,
        faces,
        column_bounds(robot, cover),
        pairs,
        apart,
        NO_CONE if upright is None else upright.row(),
        float(floor),
        pack_couple(robot),
    )
    return body


def unbounded(body: Body) -> Body:
    """The same body without a floor and a cone: to measure, not to demand."""
    return body._replace(floor=-1e6, cone=NO_CONE)


class BodyClearance:
    """Clearances in the kernels' model, in words: a judge of single configurations.

    Args:
        body: as `pack_body` makes it.
        cover, obstacles: what it was made of, for the names.
    """

    def __init__(self, body: Body, cover: SphereCover | None, obstacles: Sequence[Piece]) -> None:
        self._body, self._cover, self._obstacles = unbounded(body), cover, obstacles

    def many(self, q: ArrayLike, limit: float = FAR) -> Array:
        """(k,) smallest clearances at configurations (k, n); those beyond `limit` metres may come as 1000 m."""
        rows = np.ascontiguousarray(q, dtype=float)
        out = np.empty((len(rows), 3))
        kernels().gaps(self._body, rows, limit, out)
        return out[:, 0]

    def __call__(self, q: ArrayLike) -> Clearance:
        """The smallest clearance at q (n,), and its pair."""
        out = np.empty((1, 3))
        kernels().gaps(self._body, np.asarray(q, dtype=float)[None], FAR, out)
        return Clearance(float(out[0, 0]), self.pair(int(out[0, 1]), int(out[0, 2])))

    def pair(self, first: int, second: int) -> tuple[str, str]:
        """Names of a pair as the kernels report it (`kernels.steps.Steps`)."""
        if first < 0:
            return ("", "")
        if second >= 0:
            return (self._sphere(first), self._obstacles[second].name)
        return (self._sphere(first), self._sphere(-second - 3))

    def _sphere(self, row: int) -> str:
        assert self._cover is not None
        index = int(self._body.spheres[row, 4])
        source = self._cover.source[index] if self._cover.source else f"link {int(self._cover.link[index])}"
        return f"sphere {index} ({source})"


def _pairs(
    cover: SphereCover, spheres: Array, wanted: ArrayLike | None
) -> tuple[NDArray[np.int64], NDArray[np.uint8]]:
    """Pairs of links, and which rows of packed spheres must keep clear, from pairs of the cover's spheres."""
    apart = np.zeros((len(cover), len(cover)), dtype=np.uint8)
    if wanted is None:
        return np.zeros((0, 2), dtype=np.int64), apart
    pairs = np.asarray(wanted, dtype=np.int64).reshape(-1, 2)
    if np.any(pairs < 0) or np.any(pairs >= len(cover)):
        raise InputError(f"a pair names a sphere that is not among {len(cover)}", where="self_pairs")
    row = np.empty(len(cover), dtype=np.int64)
    row[spheres[:, 4].astype(np.int64)] = np.arange(len(cover))
    apart[row[pairs[:, 0]], row[pairs[:, 1]]] = apart[row[pairs[:, 1]], row[pairs[:, 0]]] = 1
    links = np.sort(cover.link[pairs], axis=1)
    # spheres of one link never move relative to each other
    return np.unique(links[links[:, 0] < links[:, 1]], axis=0), apart


_columns = ByIdentity()


def column_bounds(robot: Robot, cover: SphereCover) -> Array:
    """(n + 1, n) upper bounds on the distance of a link's sphere centres from each joint's axis.

    Over all configurations within the limits of slides. Row l, column k: at most the radial part of the next
    joint's origin plus the lengths of the links beyond it; exact for the link's own joint. 1 for a prismatic
    joint, whose column of the Jacobian is a unit vector; 0 for joints that don't move the link. Remembered
    for a robot and its cover.
    """
    bounds: Array = _columns.get((robot, cover), lambda: _column_bounds(robot.uncoupled, cover))
    return bounds


def _column_bounds(robot: Robot, cover: SphereCover) -> Array:
    n = robot.dof
    turned = axis_frames(robot)
    bound = np.zeros((n + 1, n))
    travel = np.where(
        robot.prismatic, np.maximum(np.abs(robot.lower), np.abs(robot.upper)) + LIMIT_SLACK, 0.0
    )
    for link in range(1, n + 1):
        centres = cover.centre[cover.link == link]
        if len(centres) == 0:
            continue
        local = centres @ turned[link]
        bound[link, link - 1] = np.hypot(local[:, 0], local[:, 1]).max()
        beyond = float(np.linalg.norm(centres, axis=1).max())
        for k in range(link - 2, -1, -1):
            # the origin of joint k + 1, seen from the axis of joint k, and all that it carries
            step = robot.joint_xyz[k + 1] @ turned[k + 1]
            beyond += float(travel[k + 1])
            bound[link, k] = float(np.hypot(step[0], step[1])) + beyond
            beyond += float(np.linalg.norm(step))
        bound[link, :link] = np.where(robot.prismatic[:link], 1.0, bound[link, :link])
    return bound
