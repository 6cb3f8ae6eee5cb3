"""`Robot`: a kinematic tree of revolute and prismatic joints, with limits, tools and a base pose, in numpy.

A robot comes from a compiled MuJoCo model (`workcell.model.loading.load`) or from a problem-set file
(`workcell.sets.problems`); from then on no solver needs to know which.

Where joints follow others (`Robot.coupling`), configurations are of the n variables, and links and the arrays that
place them of the m joints; n = m otherwise.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from types import MappingProxyType

import numpy as np
from numpy.typing import ArrayLike, NDArray

from workcell.errors import InputError, ModelError, UnknownNameError
from workcell.identity_cache import ByIdentity
from workcell.model.coupling import Coupling, value_range
from workcell.model.exact_frames import NEARLY, rotations, unit_vectors
from workcell.model.turns import Room, all_turns, has_turns, nearest_turn
from workcell.pose import Array, Pose, axis_angle_to_matrix, read_only

LIMIT_SLACK = 1e-6
"""Radians (metres) by which a configuration may exceed its limits and still count as inside them."""


@dataclass(frozen=True, slots=True)
class Tool:
    """A named frame fixed to a link."""

    name: str
    link: int
    T_link_tool: Pose


@dataclass(frozen=True, slots=True)
class Robot:
    """A kinematic tree. Link 0 is the base; joint k (from 0) moves link k + 1.

    The pose of link k + 1 is `T_parent * Trans(joint_xyz[k]) * joint_rotation[k] * motion(axis[k], q[k])`, with
    the parent link `parents[k] <= k`. For n variables and m joints:

    Attributes:
        name: the robot's name.
        joint_names: n names, of the joints that are variables.
        link_names: m + 1 names, base first.
        parents: (m,) index of the link that carries each joint.
        joint_xyz: (m, 3) metres, joint frame in the parent link.
        joint_rotation: (m, 3, 3), joint frame in the parent link; what is a rotation to 1e-6 is made one.
        axis: (m, 3) unit vectors in the joint frame; what is given to 1e-6 is made one.
        prismatic: (m,) bool; False means revolute.
        lower, upper: (n,) radians or metres; joints that follow keep their own limits within these.
        velocity, acceleration, effort: (n,) largest absolute values; inf where unknown.
        tools: by name; `default_tool` is used where none is named.
        T_world_base: pose of link 0.
        home: (n,) a configuration inside the limits.
        coupling: how joints follow from the variables; None: each joint is a variable (n = m).
    """

    name: str
    joint_names: tuple[str, ...]
    link_names: tuple[str, ...]
    parents: NDArray[np.int64]
    joint_xyz: Array
    joint_rotation: Array
    axis: Array
    prismatic: NDArray[np.bool_]
    lower: Array
    upper: Array
    velocity: Array
    acceleration: Array
    effort: Array
    tools: Mapping[str, Tool]
    default_tool: str
    T_world_base: Pose = field(default_factory=Pose.identity)
    home: Array = field(default_factory=lambda: np.zeros(0))
    coupling: Coupling | None = None

    def __post_init__(self) -> None:
        n = len(self.joint_names)
        if n == 0:
            raise ModelError(
                f"the robot {self.name!r} has no actuated joint", remedy="a robot needs at least one"
            )
        for name in (
            "joint_xyz",
            "joint_rotation",
            "axis",
            "lower",
            "upper",
            "velocity",
            "acceleration",
            "effort",
        ):
            object.__setattr__(self, name, read_only(getattr(self, name)))
        object.__setattr__(self, "parents", read_only(self.parents, np.int64))
        object.__setattr__(self, "prismatic", read_only(self.prismatic, np.bool_))
        object.__setattr__(self, "tools", MappingProxyType(dict(self.tools)))
        home = np.asarray(self.home, dtype=float)
        if home.size == 0:
            home = np.zeros(n)
        object.__setattr__(self, "home", read_only(np.clip(home, self.lower, self.upper)))
        self._validate(n)
        object.__setattr__(self, "axis", read_only(unit_vectors(self.axis)))
        object.__setattr__(self, "joint_rotation", read_only(rotations(self.joint_rotation)))

    def _validate(self, n: int) -> None:
        m = self.joint_count
        if self.coupling is not None and (len(self.coupling.own) != n or len(self.parents) != m):
            raise ModelError(f"the coupling of {self.name!r} is not of its {n} variables and {m} joints")
        if len(self.link_names) != m + 1:
            raise ModelError(f"the robot {self.name!r} has {m} joints but {len(self.link_names)} links")
        if np.any(self.parents > np.arange(m)) or np.any(self.parents < 0):
            raise ModelError(f"the robot {self.name!r} must list its joints parent first")
        for k, joint in enumerate(self.joint_names):
            if (
                not (np.isfinite(self.lower[k]) and np.isfinite(self.upper[k]))
                or self.lower[k] > self.upper[k]
            ):
                raise ModelError(
                    f"the limits of joint {joint!r} are [{self.lower[k]}, {self.upper[k]}]",
                    where=self.name,
                    remedy="lower and upper must be finite, with lower <= upper",
                )
        names = self.all_joint_names
        for joint, axis, R in zip(names, self.axis, self.joint_rotation, strict=True):
            if not abs(np.linalg.norm(axis) - 1.0) <= NEARLY:
                raise ModelError(f"the axis of joint {joint!r} is not a unit vector", where=self.name)
            if not np.abs(R @ R.T - np.eye(3)).max() <= NEARLY or np.linalg.det(R) < 0:
                raise ModelError(f"the frame of joint {joint!r} is not turned by a rotation", where=self.name)
        if self.default_tool not in self.tools:
            raise UnknownNameError("tool", self.default_tool, self.tools, where=self.name)

    @property
    def dof(self) -> int:
        """Number of variables n: of actuated joints."""
        return len(self.joint_names)

    @property
    def joint_count(self) -> int:
        """Number of joints m, those that follow others included."""
        return self.dof if self.coupling is None else len(self.coupling.variable)

    @property
    def all_joint_names(self) -> tuple[str, ...]:
        """m names."""
        return self.joint_names if self.coupling is None else self.coupling.joint_names

    @property
    def is_serial(self) -> bool:
        """Whether every joint sits on the link that the previous one moves."""
        return bool(np.array_equal(self.parents, np.arange(self.joint_count)))

    @property
    def repeats(self) -> NDArray[np.bool_]:
        """(n,) bool: whether a whole turn of the variable leaves every link where it is."""
        turning: NDArray[np.bool_] = ~self.prismatic
        if self.coupling is None:
            return turning
        slope = self.coupling.coefficients[:, 1]
        bent = np.any(self.coupling.coefficients[:, 2:], axis=1)
        whole = (turning & ~bent & (slope == np.round(slope))) | (~bent & (slope == 0.0))
        return np.array([bool(np.all(whole[self.coupling.variable == v])) for v in range(self.dof)])

    @property
    def slides(self) -> NDArray[np.bool_]:
        """(n,) bool: whether the variable is metres of a prismatic joint."""
        return self.prismatic if self.coupling is None else self.prismatic[self.coupling.own]

    def joint_values(self, q: ArrayLike) -> Array:
        """Values (..., m) of all joints at configurations (..., n)."""
        return np.asarray(q, dtype=float) if self.coupling is None else self.coupling.values(q)

    def joint_motion(self, q: Array, qd: Array, qdd: Array) -> tuple[Array, Array, Array]:
        """Values, velocities and accelerations (..., m) of all joints, of those of the variables (..., n)."""
        return (q, qd, qdd) if self.coupling is None else self.coupling.moving(q, qd, qdd)

    def variable_forces(self, q: Array, forces: Array) -> Array:
        """Forces (..., n) on the variables at q (..., n) that do what forces (..., m) on the joints would."""
        return forces if self.coupling is None else self.coupling.gathered(forces, q)

    @property
    def uncoupled(self) -> Robot:
        """The robot whose m joints move by themselves, each within the range that the coupling leaves it.

        What no configuration of it can do, none of this one can. A robot without a coupling is itself.
        """
        if self.coupling is None:
            return self
        return _uncoupled_robots.get((self,), lambda: _uncoupled(self))

    @property
    def joint_limits(self) -> Array:
        """(n, 2) lower and upper limits."""
        return np.stack([self.lower, self.upper], axis=1)

    def tool(self, name: str | None = None) -> Tool:
        """The tool of that name, or the default one; raises UnknownNameError."""
        name = self.default_tool if name is None else name
        if name not in self.tools:
            raise UnknownNameError("tool", name, self.tools, where=self.name)
        return self.tools[name]

    def configuration(self, q: ArrayLike | Mapping[str, float], *, where: str = "q") -> Array:
        """`q` as an (n,) array, checked: right size, finite. A mapping is by joint name; joints left out are at home.

        Raises:
            InputError: wrong size or not finite; UnknownNameError: an unknown joint.
        """
        if isinstance(q, Mapping):
            values = np.array(self.home)
            for joint, value in q.items():
                if joint not in self.joint_names:
                    raise UnknownNameError("joint", joint, self.joint_names, where=where)
                values[self.joint_names.index(joint)] = value
            q = values
        array = np.asarray(q, dtype=float)
        if array.shape != (self.dof,):
            raise InputError(
                f"{self.name} takes {self.dof} joint values, not an array of shape {array.shape}",
                where=where,
                remedy=f"in this order: {', '.join(self.joint_names)}",
            )
        if not np.all(np.isfinite(array)):
            raise InputError(f"joint values are not finite: {array.tolist()}", where=where)
        return array

    def check_limits(self, q: ArrayLike, *, where: str = "q") -> None:
        """Raise InputError, naming the joints, where `q` lies outside the limits by more than `LIMIT_SLACK`."""
        values = self.configuration(np.asarray(q, dtype=float), where=where)
        outside = (values < self.lower - LIMIT_SLACK) | (values > self.upper + LIMIT_SLACK)
        if np.any(outside):
            listed = "; ".join(
                f"{self.joint_names[k]} = {values[k]:.4f} outside [{self.lower[k]:.4f}, {self.upper[k]:.4f}]"
                for k in np.flatnonzero(outside)
            )
            raise InputError(f"{self.name} is outside its joint limits: {listed}", where=where)

    def within_limits(self, q: ArrayLike) -> NDArray[np.bool_]:
        """Whether configurations (..., n) keep the limits, with `LIMIT_SLACK`."""
        q = np.asarray(q, dtype=float)
        inside: NDArray[np.bool_] = np.all(
            (q >= self.lower - LIMIT_SLACK) & (q <= self.upper + LIMIT_SLACK), axis=-1
        )
        return inside

    def unwrap(self, q: ArrayLike, reference: ArrayLike | None = None) -> Array:
        """Move revolute angles by whole turns into their limits; with a reference, to the allowed turn nearest it.

        Links stay where they are: what doesn't repeat after a turn (`repeats`) keeps its value. Angles (..., n) that no
        turn brings into the limits come nearest to the reference, or to the middle of the limits.
        """
        centre = 0.5 * (self.lower + self.upper) if reference is None else np.asarray(reference, dtype=float)
        return nearest_turn(self._room, q, centre)

    def has_turns(self, q: ArrayLike) -> NDArray[np.bool_]:
        """Whether configurations (..., n) stay within the limits after a whole turn of some joint: (...)."""
        return has_turns(self._room, np.asarray(q, dtype=float))

    def turns(self, q: ArrayLike, reference: ArrayLike, most: int = 64) -> Array:
        """Up to `most` configurations (k, n) with all links where q (n,) has them, within the limits.

        They differ by whole turns of joints; the nearest to the reference (n,) comes first. A q that no turn brings
        into the limits is its only one.
        """
        return all_turns(self._room, q, np.asarray(reference, dtype=float), most)

    @property
    def _room(self) -> Room:
        return Room(self.lower, self.upper, self.repeats, LIMIT_SLACK)

    def random_configuration(self, rng: np.random.Generator, size: int | None = None) -> Array:
        """Uniform in the limits: (n,), or (size, n)."""
        shape = (self.dof,) if size is None else (size, self.dof)
        return rng.uniform(self.lower, self.upper, size=shape)

    def link_transforms(self, q: ArrayLike) -> Array:
        """World poses of all links, (..., m + 1, 4, 4), for configurations (..., n)."""
        q = self.joint_values(q)
        batch = q.shape[:-1]
        T = np.zeros((*batch, self.joint_count + 1, 4, 4))
        T[..., 3, 3] = 1.0
        T[..., 0, :, :] = self.T_world_base.matrix
        motion = self._joint_transforms(q)
        for k in range(self.joint_count):
            T[..., k + 1, :, :] = T[..., int(self.parents[k]), :, :] @ motion[..., k, :, :]
        return T

    def _joint_transforms(self, q: Array) -> Array:
        angle = np.where(self.prismatic, 0.0, q)
        slide = np.where(self.prismatic, q, 0.0)
        M = np.zeros((*q.shape, 4, 4))
        M[..., 3, 3] = 1.0
        M[..., :3, :3] = self.joint_rotation @ axis_angle_to_matrix(self.axis, angle)
        direction = np.einsum("kij,kj->ki", self.joint_rotation, self.axis)
        M[..., :3, 3] = self.joint_xyz + slide[..., None] * direction
        return M

    def fk_transform(self, q: ArrayLike, tool: str | None = None) -> Array:
        """World tool poses (..., 4, 4) for configurations (..., n)."""
        frame = self.tool(tool)
        pose: Array = self.link_transforms(q)[..., frame.link, :, :] @ frame.T_link_tool.matrix
        return pose

    def fk(self, q: ArrayLike, tool: str | None = None) -> Pose:
        """World tool pose `T_world_tool` at one configuration (n,)."""
        T = self.fk_transform(self.configuration(np.asarray(q, dtype=float)), tool)
        return Pose.from_matrix(T)

    def jacobian(self, q: ArrayLike, tool: str | None = None) -> Array:
        """Geometric Jacobian (..., 6, n) in the world frame: rows are linear, then angular velocity of the tool."""
        frame = self.tool(tool)
        T = self.link_transforms(q)
        tip = (T[..., frame.link, :, :] @ frame.T_link_tool.matrix)[..., :3, 3]
        J = self.point_jacobian(T, frame.link, tip)
        return J if self.coupling is None else self.coupling.gathered(J, q)

    def point_jacobian(self, T: Array, link: int, point: Array) -> Array:
        """Jacobian (..., 6, m) by joints of a world point (..., 3) that `link` carries, `T = link_transforms(q)`."""
        J = np.zeros((*T.shape[:-3], 6, self.joint_count))
        for k in self.path_to(link):
            z = T[..., k + 1, :3, :3] @ self.axis[k]
            if self.prismatic[k]:
                J[..., :3, k] = z
            else:
                J[..., :3, k] = np.cross(z, point - T[..., k + 1, :3, 3])
                J[..., 3:, k] = z
        return J

    def path_to(self, link: int) -> tuple[int, ...]:
        """Joints between the base and `link`, base first."""
        path = []
        while link > 0:
            path.append(link - 1)
            link = int(self.parents[link - 1])
        return tuple(reversed(path))

    def chain(self, tool: str | None = None) -> Robot:
        """The serial robot of the joints between the base and a tool: what the IK solvers take.

        A robot that is serial up to its tool is returned with that tool as default; other joints are dropped
        (they stay at home for whoever checks the whole robot).
        """
        frame = self.tool(tool)
        path = self.path_to(frame.link)
        if not path:
            raise InputError(f"no joint of {self.name} moves the tool {frame.name!r}", where="tool")
        if path == tuple(range(self.joint_count)):
            return replace(self, default_tool=frame.name)
        kept, coupling = np.array(path), self.coupling
        variables = kept
        if coupling is not None:
            for follower, leader in coupling.lost(path):
                names = self.all_joint_names
                raise InputError(
                    f"joint {names[follower]!r} follows {names[leader]!r}, which does not move the tool {frame.name!r}",
                    where="tool",
                    remedy="a tool that both of them move",
                )
            variables = np.unique(coupling.variable[kept])
            coupling = coupling.part(path)
        index = {0: 0} | {k + 1: i + 1 for i, k in enumerate(path)}
        tools = {t.name: replace(t, link=index[t.link]) for t in self.tools.values() if t.link in index}
        by_joint = ("joint_xyz", "joint_rotation", "axis", "prismatic")
        by_variable = ("lower", "upper", "velocity", "acceleration", "effort", "home")
        return replace(
            self,
            joint_names=tuple(self.joint_names[k] for k in variables),
            link_names=(self.link_names[0], *(self.link_names[k + 1] for k in path)),
            parents=np.arange(len(path)),
            tools=tools,
            default_tool=frame.name,
            coupling=coupling,
            **{name: getattr(self, name)[kept] for name in by_joint},
            **{name: getattr(self, name)[variables] for name in by_variable},
        )

    def reach(self, tool: str | None = None) -> float:
        """Upper bound in metres on the distance between the first joint's origin and the tool (triangle inequality)."""
        chain = self.chain(tool).uncoupled
        frame = chain.tool()
        travel = np.where(chain.prismatic, np.maximum(np.abs(chain.lower), np.abs(chain.upper)), 0.0)
        links = np.linalg.norm(chain.joint_xyz[1:], axis=1).sum() + np.linalg.norm(frame.T_link_tool.position)
        return float(links + travel.sum())


_uncoupled_robots = ByIdentity()


def _uncoupled(robot: Robot) -> Robot:
    coupling = robot.coupling
    assert coupling is not None
    lower, upper = np.array(robot.lower[coupling.variable]), np.array(robot.upper[coupling.variable])
    for k in coupling.followers:
        # what counts as within the variable's limits is within these
        ends = float(lower[k]) - LIMIT_SLACK, float(upper[k]) + LIMIT_SLACK
        lower[k], upper[k] = value_range(coupling.coefficients[k], *ends)
    unlimited = np.full(len(lower), np.inf)
    return replace(
        robot,
        joint_names=coupling.joint_names,
        lower=lower,
        upper=upper,
        velocity=unlimited,
        acceleration=unlimited,
        effort=unlimited,
        home=coupling.values(robot.home),
        coupling=None,
    )
