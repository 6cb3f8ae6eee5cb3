"""`IKProblem`: one question to a solver, and what counts as an answer."""

from __future__ import annotations

import sys
from collections.abc import Callable, Collection
from dataclasses import dataclass, field, replace
from typing import Literal, Protocol, get_args

import numpy as np
from numpy.typing import NDArray

from workcell.errors import InputError
from workcell.geometry.types import FreeSpace, Piece, SphereCover
from workcell.model.robot import Robot
from workcell.pose import Array, Pose, read_only

STEP_SLACK = 1e-9
"""Radians, or Frobenius norm, by which a configuration may exceed the bounds against its reference."""
Goal = Literal["pose", "position", "axis"]
"""What of the target counts: the whole pose; the tool's position alone; its position and the direction of its z
axis."""


FARTHEST = 1e6
"""Metres or radians beyond which a number can only be a mistake, and arithmetic loses digits."""


@dataclass(frozen=True, slots=True)
class Tolerances:
    """When a configuration reaches its target: metres, radians, and the clearance it must keep (metres)."""

    position: float = 1e-4
    rotation: float = 1e-3
    safety_margin: float = 0.0

    def __post_init__(self) -> None:
        tolerances = self.position, self.rotation
        if not (all(0 < value <= FARTHEST for value in tolerances) and 0 <= self.safety_margin <= FARTHEST):
            raise InputError(
                "tolerances must be positive and the safety margin zero or more, "
                f"none of them above {FARTHEST:g}",
                where="tolerances",
            )


@dataclass(frozen=True, slots=True)
class Budget:
    """How much a solver may spend on one problem.

    Seconds end a query, and decide nothing else; work is counted. So a query that ends before its seconds do has the
    same answer on every machine and at any load, and `effort` ends it at the same place everywhere.

    Attributes:
        cpu_s: seconds of the process's CPU time, or fewer.
        threads: branch and bound makes use of several; the other solvers work on one. An answer may depend on how many.
        iterations: random starts that a sampling solver may make in a turn; None: as many as its turn has.
        effort: work to be done at most: what takes so many seconds, about, on one quiet core. Each solver counts in its
            own units: random starts, boxes of branch and bound, cone programs. None: only the seconds end a query.
    """

    cpu_s: float = 5.0
    threads: int = 1
    iterations: int | None = None
    effort: float | None = None

    def shared(self, among: int) -> Budget:
        """One of so many equal parts of it."""
        effort = None if self.effort is None else self.effort / among
        return replace(self, cpu_s=self.cpu_s / among, effort=effort)

    def work(self, a_second: float) -> float:
        """The effort in a solver's units, of which a quiet core does so many a second; inf: no bound."""
        return float("inf") if self.effort is None else float(np.ceil(self.effort * a_second))

    def __post_init__(self) -> None:
        if not 0 <= self.cpu_s <= sys.float_info.max:  # whole numbers may be larger than any float
            raise InputError(
                f"a budget of {self.cpu_s} s makes no sense", where="budget", remedy="a finite number >= 0"
            )
        if isinstance(self.threads, bool) or not isinstance(self.threads, int) or self.threads < 1:
            raise InputError(
                f"{self.threads!r} threads make no sense", where="budget", remedy="a whole number >= 1"
            )
        if self.effort is not None and not self.effort >= 0:
            raise InputError(
                f"an effort of {self.effort} makes no sense", where="budget", remedy="0 or more, or None"
            )
        most = self.iterations
        if most is not None and (isinstance(most, bool) or not isinstance(most, int) or most < 1):
            raise InputError(
                f"{most!r} iterations make no sense", where="budget", remedy="a whole number >= 1, or None"
            )


ITSELF = "the robot itself"
"""The name by which `IKProblem.without` knows the robot's collisions with itself."""
POSE_BUDGET = Budget(60.0, effort=5.0)
"""For one pose of something longer. Work ends it, so that what comes after it is the same at any load."""


@dataclass(frozen=True, slots=True)
class Clearance:
    """Smallest signed distance (metres) and the two bodies, geoms or spheres that have it.

    Where there is no such configuration of the mechanism, `reason` says why, and the distance is negative.
    """

    distance: float
    pair: tuple[str, str] = ("", "")
    reason: str = ""


@dataclass(frozen=True, slots=True)
class Checks:
    """What is looked at when the clearance of a configuration is judged, and what that is worth in words.

    Attributes:
        obstacles: pairs of a part of the robot, or of what it holds, with something else.
        itself: pairs of two of its own parts.
        asked: whether collision was asked about at all.
        by_checker: whether a checker judges that does not say what it looks at.
    """

    obstacles: int = 0
    itself: int = 0
    asked: bool = True
    by_checker: bool = False

    @property
    def nothing(self) -> bool:
        """Whether nothing at all is looked at: such a clearance says nothing."""
        return not (self.obstacles or self.itself or self.by_checker)

    @property
    def words(self) -> str:
        """How a configuration is that passes: what follows on "it is ..."."""
        if not self.asked:
            return "not checked for collisions, which were not asked about"
        if self.by_checker:
            return "clear, as the problem's own checker has it"
        if self.nothing:
            return "not checked for collisions, as there is no collision geometry that could meet"
        if not self.itself:
            return "clear of obstacles (the robot's own parts were not checked against each other)"
        return (
            "clear of obstacles and of itself"
            if self.obstacles
            else "clear of itself (there is nothing else to meet)"
        )


class CollisionChecker(Protocol):
    """The truth about collisions for one problem (the compiled model, or the exact kernel).

    It may have a method `second_opinion`, of q too, which says by another way what touches, or None. Where it disagrees
    with what is to be accepted, it holds. It may also have a method `self_pairs`, of the robot, its cover and
    configurations (c, n) at which it finds nothing (or None), which says what spheres (p, 2) it would have keep clear
    of each other.
    """

    def __call__(self, q: Array) -> Clearance:
        """Smallest clearance at configuration `q` of the problem's serial robot."""
        ...


class Growing(Protocol):
    """A free space that queries share and that grows where it is asked for."""

    def __call__(self, points: Array, radii: Array | None = None) -> FreeSpace:
        """Adds what holds spheres of such radii (k,) around points (k, 3); None: as large as its own spheres are."""
        ...


@dataclass(frozen=True, slots=True)
class IKProblem:
    """Bring a serial robot's tool to a pose, clear of obstacles.

    Attributes:
        robot: serial (`Robot.chain(tool)`); its default tool, on its last link, is the one to place.
        target: `T_world_tool`.
        obstacles: convex pieces in the world frame.
        cover: spheres that stand for the robot in the solvers' model; None: no collision avoidance.
        free_space: cuboids free of obstacles, for the solvers that need them; None: they make their own.
        grow: adds cuboids around points (k, 3), in the world frame, to the free space and returns it whole, for queries
            that share one (no points: as it is now); None: solvers keep to themselves what they add.
        checker: the truth about collisions that `verify` asks; None: the exact kernel on `cover` and `obstacles`.
        tool_pose: where the compiled model has the tool at a configuration, for `verify`, which then asks both it and
            its own kinematics; None: its own alone.
        q_reference: a configuration to stay near, and from which `max_step` is measured; None: anywhere.
        q_towards: a configuration that the convex solvers head for, among all that solve the problem; None:
            `q_reference`, where there is one.
        q_near: where the robot stands: of configurations that differ by whole turns, answers are the nearest to it that
            the limits allow; no solver begins there. None: to `q_reference`, where there is one.
        max_step: largest change of each joint against `q_reference` (scalar or (n,)), radians; None: no bound.
        max_link_rotation: bound on the Frobenius change of each link's world rotation (r_b in Eq. 75 of
            IKSPARK, see `workcell.ik.ikspark.solver`); None: no bound.
        tolerances: what counts as reached.
        goal: what of the target counts, see `Goal`; the rotation's tolerance bounds the tilt of the z axis for `axis`.
        self_collision: (p, 2) pairs of the cover's spheres that must keep clear of each other; None: none.
        inner: turns this question into one about a model inside the geometry that `checker` knows (a cover of kind
            `inner` among obstacles that collide with all of it), for proofs that hold of that geometry; None: there
            is none.
        without: turns this question into one with some obstacles (by name) out of the way, for `checker` too, and
            without collisions of the robot with itself where `ITSELF` is among the names; None: it is enough to leave
            out their pieces, and `self_collision`.
    """

    robot: Robot
    target: Pose
    obstacles: tuple[Piece, ...] = ()
    cover: SphereCover | None = None
    free_space: FreeSpace | None = None
    grow: Growing | None = None
    checker: CollisionChecker | Callable[[Array], Clearance] | None = None
    tool_pose: Callable[[Array], Pose] | None = None
    q_reference: Array | None = None
    q_towards: Array | None = None
    q_near: Array | None = None
    max_step: Array | float | None = None
    max_link_rotation: float | None = None
    tolerances: Tolerances = field(default_factory=Tolerances)
    goal: Goal = "pose"
    self_collision: NDArray[np.int64] | None = None
    inner: Callable[[IKProblem], IKProblem] | None = None
    without: Callable[[IKProblem, Collection[str]], IKProblem] | None = None

    def __post_init__(self) -> None:
        if self.goal not in get_args(Goal):
            raise InputError(f"unknown goal {self.goal!r}", where="goal", remedy=", ".join(get_args(Goal)))
        self._check_pairs()
        if np.abs(self.target.position).max() > FARTHEST:
            raise InputError(
                f"the target is at {self.target.position.tolist()}",
                where="target",
                remedy=f"metres, of at most {FARTHEST:g} each",
            )
        if not self.robot.is_serial:
            raise InputError(
                f"{self.robot.name} is a tree",
                where="robot",
                remedy="pass robot.chain(tool), the joints up to one tool",
            )
        tool = self.robot.tool()
        if tool.link != self.robot.joint_count:
            raise InputError(
                f"the tool {tool.name!r} of {self.robot.name} sits on link {tool.link} of {self.robot.joint_count}",
                where="robot",
                remedy="choose a tool on the last link, or pass robot.chain(tool), the joints up to the tool",
            )
        for name in ("q_reference", "q_towards", "q_near"):
            if (given := getattr(self, name)) is not None:
                object.__setattr__(self, name, read_only(self.robot.configuration(given, where=name)))
        if self.max_step is not None:
            if self.q_reference is None:
                raise InputError("max_step needs q_reference", where="max_step")
            step = np.broadcast_to(np.asarray(self.max_step, dtype=float), (self.robot.dof,))
            if np.any(~np.isfinite(step)) or np.any(step <= 0):
                raise InputError("max_step must be positive", where="max_step")
            object.__setattr__(self, "max_step", read_only(step))
        if self.max_link_rotation is not None:
            if self.q_reference is None:
                raise InputError("max_link_rotation needs q_reference", where="max_link_rotation")
            if not self.max_link_rotation > 0:
                raise InputError(
                    f"max_link_rotation must be positive, not {self.max_link_rotation}",
                    where="max_link_rotation",
                )

    @property
    def q_ahead(self) -> Array | None:
        """(n,) where the convex solvers begin: `q_towards`, or `q_reference`; None: anywhere."""
        return self.q_reference if self.q_towards is None else self.q_towards

    def _check_pairs(self) -> None:
        if self.self_collision is None:
            return
        pairs = np.asarray(self.self_collision)
        spheres = 0 if self.cover is None else len(self.cover)
        if pairs.ndim != 2 or pairs.shape[1] != 2 or not np.issubdtype(pairs.dtype, np.integer):
            raise InputError("pairs of spheres are whole numbers (p, 2)", where="self_collision")
        if np.any(pairs < 0) or np.any(pairs >= spheres) or np.any(pairs[:, 0] == pairs[:, 1]):
            raise InputError(
                "a pair names a sphere that isn't there, or the same one twice",
                where="self_collision",
                remedy=f"two different indices from 0 to {spheres - 1}" if spheres else "a cover",
            )
        object.__setattr__(self, "self_collision", read_only(pairs, np.int64))

    @property
    def checks(self) -> Checks:
        """What the judge looks at for the clearance of a configuration."""
        if self.checker is not None:
            known = getattr(self.checker, "checks", None)
            return known if isinstance(known, Checks) else Checks(by_checker=True)
        if self.cover is None:
            return Checks(asked=False)
        own = 0 if self.self_collision is None else len(self.self_collision)
        return Checks(len(self.cover) * len(self.obstacles), own)

    def inside(self) -> IKProblem | None:
        """The same question of the model inside the real geometry, where there is one."""
        if self.inner is None or self.cover is None or self.checker is None:
            return None
        return self.inner(self)

    def unwrapped(self, q: Array) -> Array:
        """A configuration (n,) with its joints whole turns nearer to where the robot stands, where that is known."""
        near = self.q_reference if self.q_near is None else self.q_near
        return q if near is None else self.robot.unwrap(q, near)

    @property
    def T_base_tool(self) -> Pose:
        """The target seen from the robot's base."""
        return self.robot.T_world_base.inverse() @ self.target
