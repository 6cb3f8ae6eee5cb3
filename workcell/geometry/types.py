"""What the geometry layer hands upwards, data only: convex pieces, sphere covers, free space.

The makers are beside it.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Literal

import numpy as np
from numpy.typing import NDArray

from workcell.errors import InputError
from workcell.identity_cache import ByIdentity
from workcell.pose import Array, Pose, read_only

PieceKind = Literal["box", "sphere", "capsule", "cylinder", "ellipsoid", "halfspace", "hull"]

_SIZES: dict[str, int] = {
    "box": 3,
    "sphere": 1,
    "capsule": 2,
    "cylinder": 2,
    "ellipsoid": 3,
    "halfspace": 0,
    "hull": 0,
}
_SMALLEST = 1e-5
"""Metres: radius that a sphere keeps when all of it is overshoot."""
_bare = ByIdentity()


@dataclass(frozen=True, slots=True)
class Piece:
    """A convex solid with a pose.

    Attributes:
        name: the geom's name, for messages.
        kind: box, sphere, capsule, cylinder, ellipsoid, halfspace (solid where local z <= 0) or hull.
        pose: `T_frame_piece`; the frame is the world for obstacles, the link for robot geometry.
        size: box half sizes (3,); sphere [r]; capsule and cylinder [r, half length of the straight part along z];
            ellipsoid semi-axes (3,); halfspace and hull: empty.
        vertices: (k, 3) in the piece's frame for a hull, else None.
        body: the MuJoCo body it belongs to, for messages and files; may be empty.
        geom: id of its geom in the compiled model; -1 for a piece that comes from no model.
        part_of: name of the obstacle that it is part of, all of which is taken away together; empty: its own name.
    """

    name: str
    kind: PieceKind
    pose: Pose
    size: Array
    vertices: Array | None = None
    body: str = ""
    geom: int = -1
    part_of: str = ""

    def __post_init__(self) -> None:
        size = np.asarray(self.size, dtype=float).reshape(-1)
        if self.kind not in _SIZES:
            raise InputError(
                f"unknown kind of piece {self.kind!r}", where=self.name, remedy=", ".join(_SIZES)
            )
        if size.shape != (_SIZES[self.kind],) or not np.all(np.isfinite(size)) or np.any(size <= 0):
            raise InputError(
                f"a {self.kind} takes {_SIZES[self.kind]} positive sizes, not {size.tolist()}",
                where=self.name,
            )
        object.__setattr__(self, "size", read_only(size))
        if self.kind == "hull":
            vertices = np.asarray(self.vertices, dtype=float)
            if (
                vertices.ndim != 2
                or vertices.shape[1] != 3
                or len(vertices) < 4
                or not np.all(np.isfinite(vertices))
            ):
                raise InputError("a hull takes at least four finite vertices (k, 3)", where=self.name)
            object.__setattr__(self, "vertices", read_only(vertices))


@dataclass(frozen=True, slots=True)
class SphereCover:
    """Spheres that stand for a robot (in link frames) or for obstacles (link 0 is the world).

    Attributes:
        link: (m,) index of the link that carries each sphere.
        centre: (m, 3) metres in the link frame.
        radius: (m,) metres.
        kind: `outer` covers the geometry, `inner` lies inside it, `given` is the truth itself (problem-set files).
        overshoot: (m,) metres by which each sphere may stick out of the geometry it covers (outer), else zeros.
        source: (m,) name of the piece each sphere covers, or empty.
    """

    link: NDArray[np.int64]
    centre: Array
    radius: Array
    kind: Literal["outer", "inner", "given"] = "given"
    overshoot: Array | None = None
    source: tuple[str, ...] = ()

    def __post_init__(self) -> None:
        object.__setattr__(self, "link", read_only(self.link, np.int64))
        object.__setattr__(self, "centre", read_only(np.asarray(self.centre, dtype=float).reshape(-1, 3)))
        object.__setattr__(self, "radius", read_only(self.radius))
        overshoot = np.zeros(len(self.radius)) if self.overshoot is None else self.overshoot
        object.__setattr__(self, "overshoot", read_only(overshoot))
        if not len(self.link) == len(self.centre) == len(self.radius):
            raise InputError("link, centre and radius of a sphere cover must have the same length")
        if np.any(~np.isfinite(self.centre)) or np.any(~np.isfinite(self.radius)) or np.any(self.radius <= 0):
            raise InputError("a sphere cover takes finite centres and positive radii")

    def __len__(self) -> int:
        return len(self.radius)

    @property
    def bare_radius(self) -> Array:
        """(m,) metres: the radii less the overshoot, zero where all of a sphere is overshoot."""
        assert self.overshoot is not None  # set in __post_init__
        bare: Array = np.maximum(self.radius - self.overshoot, 0.0)
        return bare

    def without_overshoot(self) -> SphereCover:
        """The spheres less their overshoot: they no longer contain the geometry.

        The same object for the same cover, and the cover itself where nothing sticks out.
        """
        return _bare.get((self,), self._shrunk)

    def _shrunk(self) -> SphereCover:
        if not np.any(self.overshoot):
            return self
        radius = np.maximum(self.bare_radius, _SMALLEST)
        return replace(self, radius=radius, overshoot=np.zeros(len(radius)), kind="given")

    def centres_world(self, link_transforms: Array) -> Array:
        """World centres (..., m, 3), given `Robot.link_transforms(q)` (..., n + 1, 4, 4)."""
        T = link_transforms[..., self.link, :, :]
        moved: Array = np.einsum("...mij,mj->...mi", T[..., :3, :3], self.centre) + T[..., :3, 3]
        return moved


@dataclass(frozen=True, slots=True)
class FreePolytope:
    """A bounded convex polytope {x: A x <= b} in the world frame, proved disjoint from every obstacle piece.

    Attributes:
        A: (m, 3) unit normals, outward.
        b: (m,) metres.
        margin: metres, the proved separation from the nearest obstacle (>= 0); infinite without obstacles.
    """

    A: Array
    b: Array
    margin: float

    def __post_init__(self) -> None:
        object.__setattr__(self, "A", read_only(np.asarray(self.A, dtype=float).reshape(-1, 3)))
        object.__setattr__(self, "b", read_only(np.asarray(self.b, dtype=float).reshape(-1)))
        if len(self.A) != len(self.b) or not np.allclose(np.linalg.norm(self.A, axis=1), 1.0, atol=1e-9):
            raise InputError("a polytope takes unit normals (m, 3) and as many offsets")

    def holds_spheres(self, centres: Array, radii: Array) -> NDArray[np.bool_]:
        """Whether each sphere, centres (..., m, 3) and radii (m,), lies inside: bool (..., m)."""
        inside: NDArray[np.bool_] = np.all(
            np.asarray(centres) @ self.A.T + np.asarray(radii)[:, None] <= self.b, axis=-1
        )
        return inside


@dataclass(frozen=True, slots=True)
class FreeSpace:
    """Axis-aligned cuboids, and general polytopes, in the world, each proved disjoint from every obstacle piece.

    Attributes:
        lower, upper: (k, 3) corners of the cuboids in metres.
        covered_fraction: measured share of the reachable free workspace inside, or nan when not measured.
        margin: (k,) metres, the proved separation from the nearest obstacle (>= 0); None when nothing was proved.
        skipped_seeds: seeds that lay inside an obstacle or outside the workspace.
        polytopes: where cuboids fit badly.
        admissible: (m, k) of some cover of m spheres, False where a sphere is never inside a cuboid; None: not
            computed.
        table_key: what `admissible` is true of: a hash of robot, cover and cuboids (`check_table`).
    """

    lower: Array
    upper: Array
    covered_fraction: float = float("nan")
    margin: Array | None = None
    skipped_seeds: int = 0
    polytopes: tuple[FreePolytope, ...] = ()
    admissible: NDArray[np.bool_] | None = None
    table_key: bytes = b""

    def __post_init__(self) -> None:
        if self.margin is not None:
            object.__setattr__(self, "margin", read_only(self.margin))
        object.__setattr__(self, "lower", read_only(np.asarray(self.lower, dtype=float).reshape(-1, 3)))
        object.__setattr__(self, "upper", read_only(np.asarray(self.upper, dtype=float).reshape(-1, 3)))
        if self.admissible is not None:
            object.__setattr__(self, "admissible", read_only(self.admissible, np.bool_))
        if self.lower.shape != self.upper.shape or np.any(self.lower > self.upper):
            raise InputError("a cuboid's lower corner must not exceed its upper one")
        if self.admissible is not None and (
            self.admissible.ndim != 2 or self.admissible.shape[1] != len(self)
        ):
            raise InputError("a table of pairs has a row for each sphere and a column for each cuboid")

    def __len__(self) -> int:
        return len(self.lower)


def obstacle_name(piece: Piece) -> str:
    """What a piece is part of, all of which is taken away together: a body, or a geom that stands alone."""
    return piece.part_of or piece.name
