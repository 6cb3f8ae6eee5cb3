"""`Mechanism`: a kinematic graph of hinges, slides, balls and floating bodies, its loops closed by ties.

Where a `Robot` is the driven joints up to one tool, a mechanism is everything that moves: passive joints, linkages,
several hands on one object. It comes from a compiled model (`workcell.model.mechanism.from_model`), or is a `Robot`
(`of_robot`); solvers need not know which.

A configuration q (size,) has the joints' values one after the other, as MuJoCo has them: one number of a hinge
(radians) or a slide (metres), a unit quaternion wxyz of a ball, position and quaternion of a floating body. What moves
it, its tangent (dof,), has one number of a hinge or a slide, three of a ball (angular velocity in the child), six of a
floating body (velocity in the world, angular velocity in the child).
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from functools import cached_property
from itertools import pairwise
from types import MappingProxyType
from typing import TYPE_CHECKING, Literal

import numpy as np
from numpy.typing import ArrayLike, NDArray

from workcell.errors import InputError, ModelError, UnknownNameError
from workcell.pose import Array, Pose, read_only

if TYPE_CHECKING:
    from workcell.model.mechanism.compiled import CompiledMechanism

JointKind = Literal["hinge", "slide", "ball", "free"]
VALUES: Mapping[JointKind, int] = MappingProxyType({"hinge": 1, "slide": 1, "ball": 4, "free": 7})
"""Numbers that a joint has in a configuration."""
RATES: Mapping[JointKind, int] = MappingProxyType({"hinge": 1, "slide": 1, "ball": 3, "free": 6})
"""Numbers that a joint has in a tangent."""
WORLD = 0
"""The link that everything fixed is part of."""


@dataclass(frozen=True, slots=True)
class Joint:
    """One joint: it moves its child link, `T_world_child = T_world_parent T_parent_joint motion(value)`.

    Attributes:
        name: its name, or a label.
        kind: see `JointKind`; the motion of a free joint is a pose in the world, its parent link 0.
        parent: index of the link that carries it.
        T_parent_joint: the joint's frame in that link; the child's frame is there too, turned or shifted by the motion.
            A free joint has none: it counts as the identity.
        axis: (3,) unit vector in the joint's frame, of a hinge or a slide; zeros else.
        lower, upper: limits of a hinge or a slide, infinite where there are none; a ball turns by `upper` at most, in
            radians; a free joint has none.
        id: its id in the compiled model; -1: it comes from none.
        driven: whether something drives it: an actuator, or a driven joint that it follows.
    """

    name: str
    kind: JointKind
    parent: int
    T_parent_joint: Pose
    axis: Array
    lower: float = -np.inf
    upper: float = np.inf
    id: int = -1
    driven: bool = True

    def __post_init__(self) -> None:
        object.__setattr__(self, "axis", read_only(self.axis))

    @property
    def limited(self) -> bool:
        """Whether it has limits that say something."""
        return bool(np.isfinite(self.lower) or np.isfinite(self.upper))


@dataclass(frozen=True, slots=True)
class Closure:
    """A tie between two links, which closes a loop: frames on both coincide, or their origins alone.

    Attributes:
        name: for messages, such as `connect 'c' (rod, bracket)`.
        kind: `connect`: the origins; `weld`: the whole frames.
        links: the two links.
        frames: where on each of them.
        id: of the equality constraint in the compiled model; -1: it comes from none.
    """

    name: str
    kind: Literal["connect", "weld"]
    links: tuple[int, int]
    frames: tuple[Pose, Pose]
    id: int = -1


@dataclass(frozen=True, slots=True)
class Follower:
    """A hinge or slide that follows another: its value is `sum_i coefficients[i] leader^i`.

    Attributes:
        name: for messages.
        joint, leader: indices of the joints; leader -1: it has the value `coefficients[0]`.
        coefficients: (d + 1,) in rising powers.
        id: of the equality constraint in the compiled model; -1: it comes from none.
    """

    name: str
    joint: int
    leader: int
    coefficients: Array
    id: int = -1

    def __post_init__(self) -> None:
        object.__setattr__(self, "coefficients", read_only(self.coefficients))


@dataclass(frozen=True, slots=True)
class JointSum:
    """A sum of multiples of hinges and slides that is kept between two numbers: a fixed tendon's length.

    Attributes:
        name: for messages.
        joints: indices.
        multiples: (k,).
        lower, upper: of the sum; equal where an equality constraint holds it.
        id: of the equality constraint in the compiled model; -1: of a tendon's limits, or of none.
    """

    name: str
    joints: tuple[int, ...]
    multiples: Array
    lower: float
    upper: float
    id: int = -1

    def __post_init__(self) -> None:
        object.__setattr__(self, "multiples", read_only(self.multiples))


@dataclass(frozen=True, slots=True)
class Frame:
    """A named frame on a link: a site of the model, a robot's tool, or a body's own frame."""

    name: str
    link: int
    T_link_frame: Pose


@dataclass(frozen=True)
class Mechanism:
    """A kinematic graph. Link 0 is the world; joint k moves link k + 1.

    No joint comes before the one it hangs on.

    Attributes:
        name: for messages.
        joints: parent first.
        link_names: one more than joints, `world` first.
        closures, followers, sums: what ties the joints.
        frames: by name.
        home: (size,) a configuration to begin at, as the model is assembled; it need not close the loops.
        compiled: where it lives in its compiled model, which is the truth about it; None: it comes from none.
        notes: of ties that say what others say already and were left out, in words.
    """

    name: str
    joints: tuple[Joint, ...]
    link_names: tuple[str, ...]
    closures: tuple[Closure, ...] = ()
    followers: tuple[Follower, ...] = ()
    sums: tuple[JointSum, ...] = ()
    frames: Mapping[str, Frame] = field(default_factory=dict)
    home: Array = field(default_factory=lambda: np.zeros(0))
    compiled: CompiledMechanism | None = None
    notes: tuple[str, ...] = ()

    def __post_init__(self) -> None:
        object.__setattr__(self, "frames", MappingProxyType(dict(self.frames)))
        if not self.joints:
            raise ModelError(f"{self.name!r} has no joint", remedy="a mechanism needs at least one")
        if len(self.link_names) != len(self.joints) + 1:
            raise ModelError(f"{self.name!r} has {len(self.joints)} joints but {len(self.link_names)} links")
        for k, joint in enumerate(self.joints):
            if not 0 <= joint.parent <= k:
                raise ModelError(f"joint {joint.name!r} comes before what it hangs on", where=self.name)
            if joint.kind == "free" and joint.parent != WORLD:
                raise ModelError(f"the free joint {joint.name!r} is not on the world", where=self.name)
            if not joint.lower <= joint.upper:
                raise ModelError(
                    f"the limits of joint {joint.name!r} are [{joint.lower:g}, {joint.upper:g}]",
                    where=self.name,
                    remedy="the lower limit, then the upper one",
                )
        if len(self.joint_index) != len(self.joints):
            names = [joint.name for joint in self.joints]
            twice = next(name for name in names if names.count(name) > 1)
            raise ModelError(f"two joints are called {twice!r}", where=self.name)
        home = self.neutral if np.size(self.home) == 0 else self.configuration(self.home, where="home")
        object.__setattr__(self, "home", read_only(home))

    @cached_property
    def value_slices(self) -> tuple[slice, ...]:
        """For each joint its numbers in a configuration."""
        return _slices([VALUES[joint.kind] for joint in self.joints])

    @cached_property
    def rate_slices(self) -> tuple[slice, ...]:
        """For each joint its numbers in a tangent."""
        return _slices([RATES[joint.kind] for joint in self.joints])

    @property
    def size(self) -> int:
        """Numbers of a configuration."""
        return int(self.value_slices[-1].stop)

    @property
    def dof(self) -> int:
        """Numbers of a tangent."""
        return int(self.rate_slices[-1].stop)

    @property
    def link_count(self) -> int:
        """Links, the world among them."""
        return len(self.link_names)

    @property
    def neutral(self) -> Array:
        """(size,) zeros, and no rotation."""
        q = np.zeros(self.size)
        for joint, at in zip(self.joints, self.value_slices, strict=True):
            if joint.kind in ("ball", "free"):
                q[at.stop - 4] = 1.0
        return q

    @cached_property
    def joint_index(self) -> Mapping[str, int]:
        """Index of each joint, by name."""
        return MappingProxyType({joint.name: k for k, joint in enumerate(self.joints)})

    @cached_property
    def ancestors(self) -> NDArray[np.bool_]:
        """(links, joints) whether a joint moves a link."""
        moved = np.zeros((self.link_count, len(self.joints)), dtype=bool)
        for k, joint in enumerate(self.joints):
            moved[k + 1] = moved[joint.parent]
            moved[k + 1, k] = True
        return moved

    @property
    def is_closed(self) -> bool:
        """Whether it has loops."""
        return bool(self.closures)

    def frame(self, name: str) -> Frame:
        """The frame of that name; raises UnknownNameError."""
        if name not in self.frames:
            raise UnknownNameError("site", name, self.frames, where=self.name)
        return self.frames[name]

    def joint(self, name: str) -> int:
        """Index of the joint of that name; raises UnknownNameError."""
        if name not in self.joint_index:
            raise UnknownNameError("joint", name, self.joint_index, where=self.name)
        return self.joint_index[name]

    def configuration(self, q: ArrayLike | Mapping[str, ArrayLike], *, where: str = "q") -> Array:
        """`q` as a (size,) array, checked, its quaternions made units; a mapping is by joint name, the rest at home.

        Raises:
            InputError: wrong size, not finite, or a quaternion that is none; UnknownNameError: an unknown joint.
        """
        if isinstance(q, Mapping):
            values = np.array(self.home)
            for name, value in q.items():
                at = self.value_slices[self.joint(name)]
                given = np.atleast_1d(np.asarray(value, dtype=float))
                if given.shape != (at.stop - at.start,):
                    raise InputError(
                        f"joint {name!r} takes {at.stop - at.start} numbers, not {given.tolist()}",
                        where=where,
                    )
                values[at] = given
            q = values
        array = np.array(q, dtype=float)
        if array.shape != (self.size,) or not np.all(np.isfinite(array)):
            raise InputError(
                f"{self.name} takes {self.size} finite numbers, not an array of shape {array.shape}",
                where=where,
                remedy=", ".join(f"{j.name} ({VALUES[j.kind]})" for j in self.joints),
            )
        for joint, at in zip(self.joints, self.value_slices, strict=True):
            if joint.kind in ("ball", "free"):
                quat = array[at.stop - 4 : at.stop]
                length = float(np.linalg.norm(quat))
                if not abs(length - 1.0) <= 1e-3:
                    raise InputError(
                        f"the quaternion of joint {joint.name!r} has length {length:g}", where=where
                    )
                array[at.stop - 4 : at.stop] = quat / length
        return array


def _slices(sizes: list[int]) -> tuple[slice, ...]:
    ends = np.cumsum([0, *sizes]).tolist()
    return tuple(slice(a, b) for a, b in pairwise(ends))
