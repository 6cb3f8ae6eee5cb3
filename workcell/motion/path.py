"""`Path` and `Trajectory`: what motion planning hands to retiming, and what retiming hands to the simulation."""

from __future__ import annotations

from dataclasses import dataclass
from itertools import pairwise

import numpy as np
from numpy.typing import ArrayLike

from workcell.errors import InputError
from workcell.ik.problem import Clearance
from workcell.model.robot import Robot
from workcell.pose import Array, Pose, read_only, rotation_vector

_TIME_TOLERANCE = 1e-9


@dataclass(frozen=True, slots=True)
class Path:
    """Configurations joined by straight lines in joint space.

    Attributes:
        robot: the serial robot that moves.
        configurations: (k, n) unwrapped joint values, k >= 2, read-only.
        tool_poses: the k poses `T_world_tool` asked of the tool; empty for a path that was planned in joint space.

    Raises:
        InputError: wrong shape, fewer than two configurations, not finite, or outside the joint limits.
    """

    robot: Robot
    configurations: Array
    tool_poses: tuple[Pose, ...] = ()

    def __post_init__(self) -> None:
        q = np.asarray(self.configurations, dtype=float)
        if q.ndim != 2 or q.shape[1] != self.robot.dof or len(q) < 2:
            raise InputError(
                f"a path of {self.robot.name} takes two or more configurations of {self.robot.dof} joints, "
                f"not an array of shape {q.shape}",
                where="configurations",
            )
        if not np.all(np.isfinite(q)):
            raise InputError("a path's configurations must be finite", where="configurations")
        outside = np.flatnonzero(~self.robot.within_limits(q))
        if len(outside):
            self.robot.check_limits(q[outside[0]], where=f"configurations[{outside[0]}]")
        if self.tool_poses and len(self.tool_poses) != len(q):
            raise InputError(
                f"{len(self.tool_poses)} tool poses for {len(q)} configurations",
                where="tool_poses",
                remedy="one each, or none",
            )
        object.__setattr__(self, "configurations", read_only(q))
        object.__setattr__(self, "tool_poses", tuple(self.tool_poses))

    def __len__(self) -> int:
        return len(self.configurations)

    def __add__(self, other: Path) -> Path:
        """This path, then one that begins where this one ends."""
        gap = float(np.abs(self.configurations[-1] - other.configurations[0]).max())
        if self.robot.name != other.robot.name or gap > _TIME_TOLERANCE:
            raise InputError(
                f"the second path begins {gap:.3g} rad away from the end of the first", where="path"
            )
        both = bool(self.tool_poses) and bool(other.tool_poses)
        poses = self.tool_poses + other.tool_poses[1:] if both else ()
        return Path(self.robot, np.vstack([self.configurations, other.configurations[1:]]), poses)

    def reversed(self) -> Path:
        """The same path, travelled backwards."""
        return Path(self.robot, self.configurations[::-1], self.tool_poses[::-1])

    def part(self, first: int, last: int) -> Path:
        """The stretch from waypoint `first` to waypoint `last`, both included."""
        rows = slice(first, last + 1)
        return Path(self.robot, self.configurations[rows], self.tool_poses[rows])

    def split(self, places: ArrayLike) -> list[Path]:
        """The stretches between the waypoints at which the tool is nearest to some places.

        Args:
            places: (k, 3) in the world, in the order in which the tool comes to them; not the path's ends.

        Raises:
            InputError: two places with one waypoint nearest to both, or in another order.
        """
        tools = self.robot.fk_transform(self.configurations)[:, :3, 3]
        rows = [
            int(np.argmin(np.linalg.norm(tools - place, axis=1))) for place in np.asarray(places, dtype=float)
        ]
        ends = [0, *rows, len(self) - 1]
        if any(first >= last for first, last in pairwise(ends)):
            raise InputError(
                f"the waypoints nearest to the places are {ends}",
                where="split",
                remedy="name places along the path, in its order, apart from each other and from its ends",
            )
        return [self.part(first, last) for first, last in pairwise(ends)]

    @property
    def start(self) -> Array:
        """(n,) the first configuration."""
        first: Array = self.configurations[0]
        return first

    @property
    def end(self) -> Array:
        """(n,) the last configuration."""
        last: Array = self.configurations[-1]
        return last

    @property
    def largest_step(self) -> float:
        """Largest change of any joint between neighbouring waypoints (L-infinity), radians or metres."""
        return float(np.abs(np.diff(self.configurations, axis=0)).max())

    @property
    def largest_link_rotation(self) -> float:
        """Largest change of any link's world rotation between neighbouring waypoints (Frobenius norm).

        Of a rotation by an angle phi it is 2 sqrt(2) sin(phi / 2): what Eq. 75 of IKSPARK bounds.
        """
        turned = np.diff(self.robot.link_transforms(self.configurations)[..., :3, :3], axis=0)
        return float(np.linalg.norm(turned, axis=(-2, -1)).max())

    def at(self, u: ArrayLike) -> Array:
        """Configurations (..., n) at path parameters u (...) in [0, k - 1]; waypoint i stands at u = i."""
        inside = np.clip(np.asarray(u, dtype=float), 0, len(self) - 1)
        i = np.minimum(inside.astype(int), len(self) - 2)
        fraction = (inside - i)[..., None]
        mixed: Array = (1 - fraction) * self.configurations[i] + fraction * self.configurations[i + 1]
        return mixed

    def tool_deviation(self) -> tuple[Array, Array]:
        """How far the tool is from the straight tool path half-way between waypoints: m and rad, (k - 1,) each.

        The straight tool path joins the poses that were asked for (or, without them, the poses at the waypoints)
        by lines in position and shortest great arcs in rotation.
        """
        poses = self.tool_poses or tuple(
            Pose.from_matrix(T) for T in self.robot.fk_transform(self.configurations)
        )
        half = self.robot.fk_transform(self.at(np.arange(len(self) - 1) + 0.5))
        straight = np.stack([a.interpolate(b, 0.5).matrix for a, b in pairwise(poses)])
        return _pose_distance(half, straight)


@dataclass(frozen=True, slots=True)
class PathMetrics:
    """How good a path is, and what was checked.

    Attributes:
        waypoints: how many.
        largest_step: L-infinity joint step between neighbours (radians or metres).
        largest_link_rotation: see `Path.largest_link_rotation`.
        deviation_m, deviation_rad: largest half-way deviation of the tool from the straight tool path.
        clearance_at_waypoints: smallest clearance at a waypoint (metres), with its pair.
        clearance_between: lower bound on the clearance everywhere on the path, proved by subdivision.
        evaluations: collision queries spent on that proof.
        manipulability: smallest at a waypoint, see `workcell.motion.quality`.
        limit_distance: smallest distance from a joint limit at a waypoint (radians or metres).
    """

    waypoints: int
    largest_step: float
    largest_link_rotation: float
    deviation_m: float
    deviation_rad: float
    clearance_at_waypoints: Clearance
    clearance_between: float
    evaluations: int
    manipulability: float
    limit_distance: float


@dataclass(frozen=True, slots=True)
class Trajectory:
    """Joint motion over time, sampled at a constant step.

    Attributes:
        robot_name: the robot that moves.
        time: (T,) seconds, from 0, evenly spaced.
        q, qd, qdd: (T, n) positions, velocities and accelerations of the joints; read-only.
        base: where the robot's base stood when this was planned; None: not known.
    """

    robot_name: str
    time: Array
    q: Array
    qd: Array
    qdd: Array
    base: Pose | None = None

    def __post_init__(self) -> None:
        for name in ("time", "q", "qd", "qdd"):
            object.__setattr__(self, name, read_only(getattr(self, name)))
        if self.q.ndim != 2 or len(self.time) < 2 or len(self.q) != len(self.time):
            raise InputError(
                "a trajectory takes two or more samples of (T, n) joint values", where="trajectory"
            )
        if self.qd.shape != self.q.shape or self.qdd.shape != self.q.shape:
            raise InputError("q, qd and qdd of a trajectory must have the same shape", where="trajectory")
        if not all(np.all(np.isfinite(a)) for a in (self.time, self.q, self.qd, self.qdd)):
            raise InputError("a trajectory must be finite", where="trajectory")
        if (
            np.ptp(np.diff(self.time)) > _TIME_TOLERANCE * max(1.0, self.time[-1])
            or self.time[1] <= self.time[0]
        ):
            raise InputError("a trajectory's time steps must be equal and positive", where="trajectory")

    def __len__(self) -> int:
        return len(self.time)

    @property
    def dt(self) -> float:
        """Seconds between samples."""
        return float(self.time[-1] - self.time[0]) / (len(self.time) - 1)

    @property
    def duration(self) -> float:
        """Seconds from the first sample to the last."""
        return float(self.time[-1] - self.time[0])


def stationary(robot_name: str, q: ArrayLike, duration: float, dt: float = 0.002) -> Trajectory:
    """Stand still at `q` (n,) for `duration` seconds."""
    steps = max(round(duration / dt), 1)
    held = np.tile(np.asarray(q, dtype=float), (steps + 1, 1))
    zero = np.zeros_like(held)
    time: Array = dt * np.arange(steps + 1, dtype=float)
    return Trajectory(robot_name, time, held, zero, zero)


def _pose_distance(a: Array, b: Array) -> tuple[Array, Array]:
    """Metres and radians between transforms (k, 4, 4)."""
    distance = np.linalg.norm(a[:, :3, 3] - b[:, :3, 3], axis=-1)
    relative = np.swapaxes(a[:, :3, :3], -1, -2) @ b[:, :3, :3]
    return distance, np.linalg.norm(rotation_vector(relative), axis=-1)
