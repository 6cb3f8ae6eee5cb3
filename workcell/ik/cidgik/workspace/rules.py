"""What the points of a query keep, and how a row on them is named."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Literal

import numpy as np
from numpy.typing import NDArray

from workcell.ik.cidgik.workspace.solids import Solids
from workcell.ik.trees.query import Balls, Plane
from workcell.pose import Array

Kind = Literal["ball", "inside", "apart", "plane", "cover"]
KINDS: tuple[Kind, ...] = ("ball", "inside", "apart", "plane")
"""Of the rows that every solution keeps: the balls of a solid's cover are larger than the solid."""
Key = tuple[Kind, int, int]
"""A lasting row: point i and obstacle, containing sphere, plane or covering ball j, or points i and j apart."""


@dataclass(frozen=True, slots=True)
class Rules:
    """What points keep, in the world: see `Workspace`.

    Attributes:
        radius: (m,) of the spheres around the points.
        obstacles, inside, planes, apart: as there.
        solids: to keep out of, None: there are none.
        tangent: whether solids are parted from points by planes that touch them, not by the spheres that cover them.
        start: (m, 3) where the points are at the configuration that a step begins from; None: it is no step.
        spare: (m,) metres by which a sphere may stick out of the robot; None: none does, or nobody knows better.
        margin: metres to keep from obstacles and between points.
    """

    radius: Array
    obstacles: Balls
    inside: Balls
    planes: tuple[Plane, ...] = ()
    apart: tuple[tuple[int, int], ...] = ()
    solids: Solids | None = None
    tangent: bool = False
    start: Array | None = None
    spare: Array | None = None
    margin: float = 0.0

    def of_points(self, mine: NDArray[np.int64]) -> Rules:
        """The same for some of the points."""
        start, spare = (None if of is None else of[mine] for of in (self.start, self.spare))
        return replace(self, radius=self.radius[mine], start=start, spare=spare)
