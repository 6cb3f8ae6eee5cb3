"""Free space as convex polytopes: inflation from seeds by separating planes and ellipsoids (IRIS), proved free.

Deits and Tedrake, "Computing large convex regions of obstacle-free space through semidefinite programming" (2015):
planes that keep the obstacles out, chosen by the current ellipsoid; then the largest ellipsoid between those planes;
and so on.
"""

from __future__ import annotations

import heapq
from collections.abc import Sequence

import numpy as np
from numpy.typing import ArrayLike, NDArray

from workcell.errors import InputError
from workcell.geometry.free_space.cuboids import GAP
from workcell.geometry.free_space.ellipsoid import Ellipsoid, facing, largest_ellipsoid
from workcell.geometry.obstacle_arrays import ObstacleArrays
from workcell.geometry.polytope import Polytope, hull_of
from workcell.geometry.separation import support
from workcell.geometry.types import FreePolytope, Piece
from workcell.pose import Array

_ROUNDS = 12
_LEAST_GROWTH = 0.02
"""Share of volume that a round must add for another one."""


def inflate_polytope(
    seed: ArrayLike, obstacles: Sequence[Piece], bounds: ArrayLike, *, radius: float = 0.0
) -> FreePolytope | None:
    """Grow a convex polytope around a point until its largest ellipsoid hardly grows; the point stays inside.

    Args:
        seed: (3,) metres.
        obstacles: convex pieces in the same frame.
        bounds: (2, 3) lower and upper corner of the workspace.
        radius: metres, of a ball around the point that stays inside too.

    Returns:
        the polytope with its proved margin; None when the seed is inside an obstacle, closer than the radius and twice
        `GAP`, or outside the workspace.

    Raises:
        InputError: a seed that is not finite.
    """
    point, box = np.asarray(seed, dtype=float).reshape(3), np.asarray(bounds, dtype=float)
    if not np.all(np.isfinite(point)):
        raise InputError("the seed must be finite", where="seed")
    room = float(min((point - box[0]).min(), (box[1] - point).min()))
    if len(obstacles):
        room = min(room, float(ObstacleArrays(obstacles).distances(point).min()))
    if room <= radius + 2 * GAP:
        return None
    ellipsoid, best = Ellipsoid(0.9 * room * np.eye(3), point), None
    for _ in range(_ROUNDS):
        A, b = _planes_around(ellipsoid, obstacles, box)
        if np.any(A @ point + radius > b):
            break
        grown, best = largest_ellipsoid(A, b), (A, b)
        if grown.volume <= (1.0 + _LEAST_GROWTH) * ellipsoid.volume:
            break
        ellipsoid = grown
    if best is None:
        return None
    return _proved(*best, obstacles)


def solid_of(polytope: FreePolytope) -> Polytope:
    """Corners, edges and triangles of a free polytope."""
    from scipy.spatial import HalfspaceIntersection

    middle = largest_ellipsoid(polytope.A, polytope.b).centre
    planes = np.column_stack([polytope.A, -polytope.b])
    return hull_of(HalfspaceIntersection(planes, middle).intersections, "free polytope")


def _planes_around(ellipsoid: Ellipsoid, obstacles: Sequence[Piece], box: Array) -> tuple[Array, Array]:
    """Planes A x <= b: the workspace's six, and one before each obstacle that no earlier plane has cut off.

    Nearest obstacles first, as the ellipsoid measures it. Where an obstacle comes nearest is computed late: until then
    it waits with the distance of some plane that keeps it out, which is never more.
    """
    normals, offsets = [*np.eye(3), *-np.eye(3)], [*box[1], *-box[0]]
    metric = np.linalg.inv(ellipsoid.shape @ ellipsoid.shape.T)
    waiting = []
    for k, piece in enumerate(obstacles):
        towards = metric @ (piece.pose.position - ellipsoid.centre)
        waiting.append((_distance(ellipsoid, piece, towards) if towards.any() else 0.0, k, False))
    heapq.heapify(waiting)
    nearest: dict[int, Array] = {}
    while waiting:
        _, k, known = heapq.heappop(waiting)
        piece = obstacles[k]
        if _is_behind(piece, np.array(normals), np.array(offsets)):
            continue
        if known:
            normals.append(nearest[k])
            offsets.append(-float(support(piece, -nearest[k])) - GAP)
        else:
            nearest[k] = facing(piece, ellipsoid)
            heapq.heappush(waiting, (_distance(ellipsoid, piece, nearest[k]), k, True))
    return np.array(normals), np.array(offsets)


def _distance(ellipsoid: Ellipsoid, piece: Piece, normal: Array) -> float:
    """How far a plane with this normal that supports the piece is from the centre, in the ellipsoid's measure."""
    ahead = -float(support(piece, -normal)) - float(normal @ ellipsoid.centre)
    return ahead / float(np.linalg.norm(ellipsoid.shape.T @ normal))


def _is_behind(piece: Piece, A: Array, b: Array) -> bool:
    """Whether one of the planes already keeps the piece out, with the gap (less rounding)."""
    return bool(np.max(-support(piece, -A) - b) >= GAP - 1e-12)


def _proved(A: Array, b: Array, obstacles: Sequence[Piece]) -> FreePolytope | None:
    """The polytope, if every obstacle lies wholly behind one of its planes; exact support functions say so.

    Planes that bound nothing and that no obstacle needs are left out.
    """
    needed = _facets(A, b)
    margin = np.inf
    for piece in obstacles:
        apart = -support(piece, -A) - b
        best = int(np.argmax(np.where(needed, apart, -np.inf)))
        if apart[best] < 0.0:
            best = int(np.argmax(apart))
            needed[best] = True
        margin = min(margin, float(apart[best]))
    return FreePolytope(A[needed], b[needed], margin) if margin >= 0.0 else None


def _facets(A: Array, b: Array) -> NDArray[np.bool_]:
    """Which planes bound the polytope, but for some that only graze it."""
    from scipy.spatial import HalfspaceIntersection

    cut = HalfspaceIntersection(np.column_stack([A, -b]), largest_ellipsoid(A, b).centre)
    used = np.zeros(len(b), dtype=bool)
    used[np.concatenate([np.asarray(facet, dtype=int) for facet in cut.dual_facets])] = True
    return used
