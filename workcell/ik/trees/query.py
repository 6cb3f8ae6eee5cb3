"""What a tree of revolute joints is asked to do in CIDGIK's terms: goals of its tools, and a workspace to keep."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field
from typing import Literal

import numpy as np
from numpy.typing import NDArray

from workcell.errors import InputError
from workcell.geometry.types import SphereCover
from workcell.model.robot import Robot
from workcell.pose import Array, Pose, read_only

PLANE_SLACK = 1e-5
"""Metres within which a point counts as being in a plane that it has to be in."""
GoalKind = Literal["position", "direction", "pose"]


@dataclass(frozen=True, slots=True)
class Goal:
    """What one tool is to reach: use `Goal.at`, `Goal.pointing` or `Goal.posed`.

    Attributes:
        tool: its name.
        kind: which part of the pose counts.
        position: (3,) metres, world.
        directions: (k, 3) unit vectors in the world that `axes` must take: none, one, or three.
        axes: (k, 3) unit vectors in the tool's frame.
    """

    tool: str
    kind: GoalKind
    position: Array
    directions: Array
    axes: Array

    def __post_init__(self) -> None:
        for name in ("position", "directions", "axes"):
            values = np.asarray(getattr(self, name), dtype=float)
            if not np.all(np.isfinite(values)):
                raise InputError(f"the goal's {name} is not finite", where=self.tool)
            object.__setattr__(self, name, read_only(values))

    @staticmethod
    def at(tool: str, position: Sequence[float] | Array) -> Goal:
        """The tool's origin at a point (3,)."""
        nothing = np.zeros((0, 3))
        return Goal(tool, "position", _vector(position, tool), nothing, nothing)

    @staticmethod
    def pointing(
        tool: str,
        position: Sequence[float] | Array,
        direction: Sequence[float] | Array,
        axis: Sequence[float] | Array = (0.0, 0.0, 1.0),
    ) -> Goal:
        """The tool's origin at a point, and an axis of its frame along a direction."""
        return Goal(
            tool,
            "direction",
            _vector(position, tool),
            _unit(direction, tool)[None],
            _unit(axis, tool)[None],
        )

    @staticmethod
    def posed(tool: str, T_world_tool: Pose) -> Goal:
        """The whole pose."""
        return Goal(tool, "pose", T_world_tool.position, T_world_tool.rotation.T, np.eye(3))


def _vector(values: Sequence[float] | Array, where: str) -> Array:
    array = np.asarray(values, dtype=float)
    if array.shape != (3,):
        raise InputError(f"a point or direction has 3 numbers, not shape {array.shape}", where=where)
    return array


def _unit(values: Sequence[float] | Array, where: str) -> Array:
    array = _vector(values, where)
    length = float(np.linalg.norm(array))
    if not length > 0:
        raise InputError("a direction has length zero", where=where)
    unit: Array = array / length
    return unit


@dataclass(frozen=True, slots=True)
class Points:
    """Points carried by links: where the workspace is kept.

    Attributes:
        link: (m,) index of the link.
        local: (m, 3) metres in the link's frame.
        radius: (m,) metres of the sphere around each; zero for a bare point.
    """

    link: NDArray[np.int64]
    local: Array
    radius: Array

    def __post_init__(self) -> None:
        object.__setattr__(self, "link", read_only(self.link, np.int64))
        object.__setattr__(self, "local", read_only(np.asarray(self.local, dtype=float).reshape(-1, 3)))
        object.__setattr__(self, "radius", read_only(self.radius))
        if not len(self.link) == len(self.local) == len(self.radius):
            raise InputError("link, local and radius of points must have the same length", where="points")
        if np.any(~np.isfinite(self.local)) or not np.all(self.radius >= 0):
            raise InputError("points take finite places and radii of zero or more", where="points")

    def __len__(self) -> int:
        return len(self.radius)

    @staticmethod
    def none() -> Points:
        """No points."""
        return Points(np.zeros(0, dtype=np.int64), np.zeros((0, 3)), np.zeros(0))

    @staticmethod
    def of_cover(cover: SphereCover) -> Points:
        """The spheres of a robot's cover."""
        return Points(cover.link, cover.centre, cover.radius)

    @staticmethod
    def joints(robot: Robot) -> Points:
        """Each link's origin but the base's, on the axis of the joint that moves it: the paper's p_i."""
        links = np.arange(1, robot.dof + 1)
        return Points(links, np.zeros((robot.dof, 3)), np.zeros(robot.dof))


@dataclass(frozen=True, slots=True)
class Balls:
    """Spheres in the world: centres (k, 3) and radii (k,), metres.

    Raises:
        InputError: a radius of zero or less, or anything that is not finite.
    """

    centre: Array
    radius: Array

    def __post_init__(self) -> None:
        object.__setattr__(self, "centre", read_only(np.asarray(self.centre, dtype=float).reshape(-1, 3)))
        object.__setattr__(self, "radius", read_only(np.asarray(self.radius, dtype=float).reshape(-1)))
        if len(self.centre) != len(self.radius) or not np.all(np.isfinite(self.centre)):
            raise InputError("spheres take as many finite centres as radii", where="spheres")
        wrong = np.flatnonzero(~(np.isfinite(self.radius) & (self.radius > 0)))
        if len(wrong):
            k = int(wrong[0])
            raise InputError(
                f"the radius is {self.radius[k]:g} m", where=f"sphere {k}", remedy="a radius > 0"
            )

    def __len__(self) -> int:
        return len(self.radius)

    @staticmethod
    def of_cover(cover: SphereCover) -> Balls:
        """The spheres of an obstacle's cover, whose link 0 is the world.

        Raises:
            InputError: some sphere is on another link.
        """
        if np.any(cover.link != 0):
            raise InputError("obstacles stand in the world, link 0", where="cover")
        return Balls(cover.centre, cover.radius)

    @staticmethod
    def none() -> Balls:
        """No spheres."""
        return Balls(np.zeros((0, 3)), np.zeros(0))


@dataclass(frozen=True, slots=True)
class Plane:
    """`normal . x >= offset` for the points (all, or those listed), or `==` when `equal`; unit normal, in the world.

    A point with a radius keeps its whole sphere on that side; with `equal` its centre lies in the plane.
    """

    normal: Array
    offset: float
    equal: bool = False
    points: tuple[int, ...] | None = None

    def __post_init__(self) -> None:
        length = float(np.linalg.norm(self.normal))
        if np.shape(self.normal) != (3,) or not (length > 0 and np.isfinite(length + self.offset)):
            raise InputError("a plane takes a finite normal (3,) other than zero", where="plane")
        object.__setattr__(self, "normal", read_only(np.asarray(self.normal, dtype=float) / length))
        object.__setattr__(self, "offset", float(self.offset) / length)


@dataclass(frozen=True, slots=True)
class Workspace:
    """What the points must keep.

    Attributes:
        points: on the links.
        obstacles: spheres that every point keeps out of (its own radius added).
        inside: spheres that every point stays in (its own radius subtracted).
        planes: see `Plane`.
        apart: (i, j) pairs of points whose spheres must not meet (self-collision).
    """

    points: Points = field(default_factory=Points.none)
    obstacles: Balls = field(default_factory=Balls.none)
    inside: Balls = field(default_factory=Balls.none)
    planes: tuple[Plane, ...] = ()
    apart: tuple[tuple[int, int], ...] = ()

    def __post_init__(self) -> None:
        count = len(self.points)
        listed = [k for pair in self.apart for k in pair]
        listed += [k for plane in self.planes for k in plane.points or ()]
        wrong = [k for k in listed if not 0 <= k < count]
        if wrong:
            raise InputError(f"there is no point {wrong[0]}", where="workspace", remedy=f"0 to {count - 1}")


@dataclass(frozen=True, slots=True)
class Query:
    """A question to CIDGIK itself; `workcell.ik.cidgik.query.solve_query` answers it.

    Attributes:
        robot: a tree of revolute joints.
        goals: one or more, of different tools.
        workspace: what to keep meanwhile.
        dimension: 3; or 2 for a planar arm, whose axes are all parallel.
        position_tolerance, rotation_tolerance: metres and radians within which a goal counts as reached.
    """

    robot: Robot
    goals: tuple[Goal, ...]
    workspace: Workspace = field(default_factory=Workspace)
    dimension: int = 3
    position_tolerance: float = 1e-4
    rotation_tolerance: float = 1e-3

    def __post_init__(self) -> None:
        if not self.goals:
            raise InputError("a query takes at least one goal", where="goals")
        tools = [goal.tool for goal in self.goals]
        for tool in tools:
            self.robot.tool(tool)
        if len(set(tools)) < len(tools):
            raise InputError("two goals are about the same tool", where="goals")
        if self.dimension not in (2, 3):
            raise InputError(f"the dimension is {self.dimension}", where="dimension", remedy="2 or 3")
        if np.any(self.workspace.points.link > self.robot.dof):
            raise InputError(f"a point is on a link that {self.robot.name} does not have", where="points")
