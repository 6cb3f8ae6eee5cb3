"""`MechanismProblem`: one question about a whole mechanism, and what counts as an answer."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field
from typing import Any

import numpy as np
from numpy.typing import NDArray

from workcell.errors import InputError
from workcell.geometry.types import FreeSpace, Piece, SphereCover
from workcell.ik.mechanisms.goals import FrameGoal, InRegion
from workcell.ik.problem import Growing
from workcell.model.mechanism.mechanism import Mechanism
from workcell.pose import Array, read_only

FARTHEST = 1e4
"""Metres or radians beyond which a tolerance or a margin can only be a mistake."""


@dataclass(frozen=True, slots=True)
class MechanismTolerances:
    """When a configuration of a mechanism is an answer.

    Attributes:
        position, rotation: metres and radians of goals.
        closure: metres and radians that ties may miss: loops, and joints that follow others.
        region: metres that a point may be outside its region.
        safety_margin: metres of clearance to keep.
        overlap: metres that geoms which may touch may be inside each other, where the compiled model has them.
    """

    position: float = 1e-4
    rotation: float = 1e-3
    closure: float = 1e-6
    region: float = 1e-6
    safety_margin: float = 0.0
    overlap: float = 5e-3

    def __post_init__(self) -> None:
        positive = self.position, self.rotation, self.closure, self.region, self.overlap
        if not (all(0 < value <= FARTHEST for value in positive) and 0 <= self.safety_margin <= FARTHEST):
            raise InputError(
                f"tolerances must be positive, the safety margin zero or more, none above {FARTHEST:g}",
                where="tolerances",
            )


@dataclass(frozen=True, slots=True)
class UserConstraint:
    """A convex constraint of the user's, in cvxpy's terms.

    Attributes:
        name: for messages.
        build: takes a `workcell.ik.ikspark.mechanisms.users.expressions.Expressions`, whose points and rotations of
            frames are cvxpy expressions, and returns a list of cvxpy constraints; convex, or they are refused by name.
        tolerance: by how much a configuration may break it (cvxpy's own measure of violation).
    """

    name: str
    build: Callable[[Any], list[Any]]
    tolerance: float = 1e-6


@dataclass(frozen=True, slots=True)
class MechanismProblem:
    """Bring frames of a mechanism where they are asked to be, its ties kept, clear of obstacles and of itself.

    Attributes:
        mechanism: what moves.
        goals: of frames; all of them hold.
        regions: of points of frames, contacts among them; all of them hold.
        constraints: the user's own; all of them hold.
        obstacles: convex pieces in the world.
        cover: spheres that stand for the mechanism's links in the solvers' model; None: no collision avoidance.
        free_space: regions free of obstacles that spheres may be kept in.
        grow: adds regions around points, as of `IKProblem`, for spheres that touch obstacles; None: no more than those.
        apart: (p, 2) pairs of the cover's spheres that must keep clear of each other; None: none.
        collisions: whether the judge asks the compiled model what touches.
        touching: pairs of geoms (names) of the compiled model that may touch: contacts that are asked for.
        q_reference: (size,) a configuration to begin at, and from which `max_step` is measured; None: anywhere.
        q_towards: (size,) a configuration to begin at instead; None: `q_reference`.
        max_step: largest change of each number of the tangent against `q_reference`, radians or metres; None: no bound.
        max_link_rotation: bound on the Frobenius change of each link's world rotation (Eq. 75); None: no bound.
        tolerances: what counts as reached.
    """

    mechanism: Mechanism
    goals: tuple[FrameGoal, ...] = ()
    regions: tuple[InRegion, ...] = ()
    constraints: tuple[UserConstraint, ...] = ()
    obstacles: tuple[Piece, ...] = ()
    cover: SphereCover | None = None
    free_space: FreeSpace | None = None
    grow: Growing | None = None
    apart: NDArray[np.int64] | None = None
    collisions: bool = True
    touching: tuple[tuple[str, str], ...] = ()
    q_reference: Array | None = None
    q_towards: Array | None = None
    max_step: float | Array | None = None
    max_link_rotation: float | None = None
    tolerances: MechanismTolerances = field(default_factory=MechanismTolerances)

    def __post_init__(self) -> None:
        mechanism = self.mechanism
        for frame in [goal.frame for goal in self.goals] + [region.frame for region in self.regions]:
            mechanism.frame(frame)
        for name in ("q_reference", "q_towards"):
            if (given := getattr(self, name)) is not None:
                object.__setattr__(self, name, read_only(mechanism.configuration(given, where=name)))
        for name in ("max_step", "max_link_rotation"):
            bound = getattr(self, name)
            if bound is None:
                continue
            if self.q_reference is None:
                raise InputError(f"{name} needs q_reference", where=name)
            if not np.all(np.asarray(bound, dtype=float) > 0):
                raise InputError(f"{name} must be positive", where=name)
        if self.max_step is not None:
            step = np.broadcast_to(np.asarray(self.max_step, dtype=float), (mechanism.dof,))
            object.__setattr__(self, "max_step", read_only(step))
        if self.cover is not None and np.any(self.cover.link >= mechanism.link_count):
            raise InputError(
                "a sphere is on a link that is not there",
                where="cover",
                remedy=f"links 0 to {mechanism.link_count - 1}",
            )
        if self.apart is not None:
            pairs, spheres = np.asarray(self.apart), 0 if self.cover is None else len(self.cover)
            if pairs.ndim != 2 or pairs.shape[1] != 2 or np.any(pairs < 0) or np.any(pairs >= spheres):
                raise InputError("pairs of spheres are indices (p, 2) into the cover", where="apart")
            object.__setattr__(self, "apart", read_only(pairs, np.int64))

    @property
    def q_ahead(self) -> Array | None:
        """(size,) where the convex solver begins: `q_towards`, or `q_reference`; None: anywhere."""
        return self.q_reference if self.q_towards is None else self.q_towards
