"""Ellipsoids for inflation: the largest one in a polytope, and where a convex piece comes nearest to one."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np

from workcell.errors import InputError
from workcell.geometry.separation import support_point
from workcell.geometry.types import Piece
from workcell.pose import Array

_STEPS = 60
_NEAR = 1e-6
"""Relative gap at which the nearest point is near enough: any direction gives a valid plane, this one a good one."""


@dataclass(frozen=True, slots=True)
class Ellipsoid:
    """The points `centre + shape u` with |u| <= 1; `shape` (3, 3) is lower triangular with a positive diagonal."""

    shape: Array
    centre: Array

    @property
    def volume(self) -> float:
        """Cubic metres."""
        return float(4.0 / 3.0 * np.pi * np.prod(np.diag(self.shape)))


def largest_ellipsoid(A: Array, b: Array) -> Ellipsoid:
    """The ellipsoid of most volume inside {x: A x <= b}; A (m, 3) with unit rows, b (m,) metres; bounded.

    Maximises the geometric mean of the diagonal of a lower triangular shape L under |L^T a| + a . d <= b. Every
    ellipsoid has such a shape, and its volume is the product of that diagonal, so second-order cones suffice.

    Raises:
        InputError: the polytope is empty or flat.
    """
    import clarabel
    from scipy.sparse import csc_matrix

    # variables: L (l00, l10, l11, l20, l21, l22), d (3), u, v, t with u^2 <= l00 l11, v^2 <= l22 t, t^2 <= u v
    m = len(A)
    G, h = np.zeros((4 * m + 9, 12)), np.zeros(4 * m + 9)
    G[0 : 4 * m : 4, 6:9], h[0 : 4 * m : 4] = A, b
    for variable, (row, column) in enumerate(zip(*np.tril_indices(3), strict=True)):
        G[1 + column : 4 * m : 4, variable] = -A[:, row]
    for k, (first, second, mean) in enumerate([(0, 2, 9), (5, 11, 10), (9, 10, 11)]):
        at = 4 * m + 3 * k
        G[at, [first, second]], G[at + 1, [first, second]], G[at + 2, mean] = -1.0, (-1.0, 1.0), -2.0
    cones = [clarabel.SecondOrderConeT(4)] * m + [clarabel.SecondOrderConeT(3)] * 3
    q = np.zeros(12)
    q[11] = -1.0
    solver = clarabel.DefaultSolver(csc_matrix((12, 12)), q, csc_matrix(G), h, cones, _settings(clarabel))
    solution = solver.solve()
    x = np.asarray(solution.x)
    if str(solution.status) not in ("Solved", "AlmostSolved") or not x[11] > 1e-9:
        raise InputError("the polytope is empty or flat", where="A x <= b", remedy="give it an inside")
    return Ellipsoid(np.array([[x[0], 0.0, 0.0], [x[1], x[2], 0.0], [x[3], x[4], x[5]]]), x[6:9].copy())


def _settings(clarabel: Any) -> Any:
    settings = clarabel.DefaultSettings()
    settings.verbose = False
    settings.max_threads = 1
    return settings


def facing(piece: Piece, ellipsoid: Ellipsoid) -> Array:
    """The unit normal (3,) of the ellipsoid, blown up until it touches the piece, at the point of touch.

    The centre must lie outside the piece. The plane with this normal that supports the piece cuts off the least of the
    ellipsoid (Deits and Tedrake, IRIS, section 3.2).
    """
    if piece.kind == "halfspace":
        down: Array = -piece.pose.rotation[:, 2]
        return down
    inverse = np.linalg.inv(ellipsoid.shape)

    def farthest(direction: Array) -> Array:
        """Of the piece in the coordinates where the ellipsoid is the unit ball."""
        found: Array = inverse @ (support_point(piece, inverse.T @ direction) - ellipsoid.centre)
        return found

    normal: Array = inverse.T @ nearest_to_origin(
        farthest, inverse @ (piece.pose.position - ellipsoid.centre)
    )
    unit: Array = normal / np.linalg.norm(normal)
    return unit


def nearest_to_origin(farthest: Any, guess: Array) -> Array:
    """The point of a convex set nearest to the origin, by Wolfe's algorithm on its support points."""
    corners = np.array([farthest(-guess)])
    weights: Array = np.ones(1)
    x: Array = corners[0]
    for _ in range(_STEPS):
        corner = farthest(-x)
        if x @ x - x @ corner <= _NEAR * (x @ x):
            break
        corners, weights = np.vstack([corners, corner]), np.append(weights, 0.0)
        while True:
            wanted: Array = _affine_weights(corners)
            if wanted.min() > 1e-12:
                weights = wanted
                break
            falling = wanted <= 1e-12
            share = float(np.min(weights[falling] / np.maximum(weights[falling] - wanted[falling], 1e-300)))
            weights = np.asarray(weights + min(share, 1.0) * (wanted - weights))
            kept = weights > 1e-12
            if kept.all():
                break
            corners, weights = corners[kept], weights[kept] / weights[kept].sum()
        x = weights @ corners
    return x


def _affine_weights(corners: Array) -> Array:
    """Weights that sum to one of the point of the corners' affine hull nearest to the origin."""
    k = len(corners)
    system = np.ones((k + 1, k + 1))
    system[0, 0], system[1:, 1:] = 0.0, corners @ corners.T
    right = np.zeros(k + 1)
    right[0] = 1.0
    found: Array = np.asarray(np.linalg.lstsq(system, right, rcond=None)[0][1:], dtype=float)
    return found
