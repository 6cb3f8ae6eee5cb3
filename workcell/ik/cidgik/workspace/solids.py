"""Obstacles that are no spheres, as spheres: an outer cover of each, made where a robot's sphere breaks it.

The paper's obstacles are spheres (Eq. 6). A solid is held by thousands of them, which stick out of it by `OVERSHOOT` at
most (`LocalCover`): a robot's sphere that is farther from the solid breaks none. Of one that is nearer, the ball is
looked at that holds the solid's nearest point; where they overlap, the sphere has to keep out of that ball.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from workcell.geometry.covers.local_cover import LocalCover
from workcell.geometry.obstacle_arrays import ObstacleArrays
from workcell.geometry.pieces import move_piece
from workcell.geometry.separation import bounding_box
from workcell.geometry.types import Piece
from workcell.pose import Array

OVERSHOOT = 2e-4
"""Metres by which a ball of a solid's cover may stick out of it."""
_INSIDE = 1e-6
"""Metres below a solid's surface where its nearest point is looked for."""


class Solids:
    """Bounded convex pieces in the world, none of them a sphere, with their covers.

    Attributes:
        pieces: the same.
    """

    def __init__(self, pieces: tuple[Piece, ...]) -> None:
        self.pieces = pieces
        self._shapes: dict[int, ObstacleArrays] = {}
        self._covers: dict[int, LocalCover] = {}
        boxes = [bounding_box(move_piece(piece, piece.pose.inverse())) for piece in pieces]
        lower, upper = (np.array(side).reshape(-1, 3) for side in zip(*boxes, strict=True))
        self._half = 0.5 * (upper - lower)
        self._turned = np.array([piece.pose.rotation for piece in pieces])
        middles = [piece.pose.apply(m) for piece, m in zip(pieces, 0.5 * (lower + upper), strict=True)]
        self._middle = np.array(middles)

    def near(self, centres: Array, reach: Array) -> tuple[NDArray[np.int64], Array, Array]:
        """Where points come nearer to solids than they may.

        Args:
            centres: (m, 3) in the world.
            reach: (m,) metres from each; -inf: it is never too near.

        Returns:
            (p, 2) pairs of point and solid, in ascending order of solids, with the signed distance (p,) and its
            gradient (p, 3).
        """
        local = np.einsum("mkj,kji->mki", centres[:, None] - self._middle, self._turned)
        beyond = np.maximum(np.abs(local) - self._half, 0.0)
        likely = np.einsum("mki,mki->mk", beyond, beyond) <= np.maximum(reach, 0.0)[:, None] ** 2
        likely &= np.isfinite(reach)[:, None]
        pairs, distances, gradients = [np.zeros((0, 2), dtype=np.int64)], [np.zeros(0)], [np.zeros((0, 3))]
        for k in np.flatnonzero(likely.any(axis=0)).tolist():
            i = np.flatnonzero(likely[:, k])
            if k not in self._shapes:
                self._shapes[k] = ObstacleArrays([self.pieces[k]])
            distance, gradient, _ = self._shapes[k].nearest(centres[i])
            too_near = distance < reach[i]
            pairs.append(np.column_stack([i, np.full(len(i), k)])[too_near])
            distances.append(distance[too_near])
            gradients.append(gradient[too_near])
        return np.concatenate(pairs), np.concatenate(distances), np.concatenate(gradients)

    def ball_between(
        self, k: int, centre: Array, needed: float, distance: float, outwards: Array
    ) -> tuple[Array, float] | None:
        """The ball (3,) and its radius of solid k's cover that pushes a sphere out of it most directly.

        It holds the solid's point nearest to the sphere's centre; where that is inside, it may be the ball of the
        centre itself. None: the sphere overlaps neither.

        Args:
            k: the solid.
            centre: (3,) of the sphere, in the world.
            needed: metres that it keeps from solids.
            distance, outwards: signed, from the solid, and the gradient (3,).
        """
        held = (centre - (distance + _INSIDE) * outwards)[None]
        if distance < -_INSIDE:
            held = np.vstack([held, centre])
        if k not in self._covers:
            self._covers[k] = LocalCover(self.pieces[k], OVERSHOOT)
        centres, radii = self._covers[k].holding(held)
        away = centre - centres
        length = np.linalg.norm(away, axis=1)
        directness = np.where(length < radii + needed, away @ outwards / np.maximum(length, _INSIDE), -np.inf)
        best = int(directness.argmax())
        return (centres[best], float(radii[best])) if np.isfinite(directness[best]) else None


class SolidSpheres:
    """The balls of solids that one query's spheres have met.

    Args:
        solids: what is covered.
        needed: (m,) metres that the centre of each of the robot's spheres keeps from a solid; -inf: it can't move.
        start: (m, 3) where the centres are at the configuration that a step begins from, in the world; None: it is no
            step. What overlaps there no row can part, within a step: these pairs of sphere and solid are left out.
        spare: (m,) metres by which each of the robot's spheres may stick out of the robot: an overlap by so much may be
            none. Zero where nobody knows better than the spheres.

    Attributes:
        centre, radius, solid: of the balls so far, (3,) in the world, metres, and what they cover.
        left_out: pairs of sphere and solid.
    """

    def __init__(self, solids: Solids, needed: Array, start: Array | None, spare: Array) -> None:
        self._solids, self._needed, self._spare = solids, needed, spare
        self.centre: list[Array] = []
        self.radius: list[float] = []
        self.solid: list[int] = []
        self.left_out: set[tuple[int, int]] = set()
        self._number: dict[bytes, int] = {}
        self._least: dict[tuple[int, int], float] = {}
        self._start = start

    def met(self, centres: Array) -> list[tuple[int, int]]:
        """Sphere and ball of each pair that overlaps, the robot's spheres being at centres (m, 3) in the world."""
        pairs, distances, outwards = self._solids.near(centres, self._needed + OVERSHOOT)
        if len(pairs):
            self._look_at_start()
        found = []
        for (i, k), distance, outward in zip(pairs.tolist(), distances.tolist(), outwards, strict=True):
            if (i, k) in self.left_out:
                continue
            needed = float(self._needed[i])
            ball = self._solids.ball_between(k, centres[i], needed, distance, outward)
            if ball is not None:
                found.append((i, self._numbered(k, *ball)))
                self._least[i, k] = min(needed - distance, self._least.get((i, k), np.inf))
        return found

    def may_be_clear(self, i: int, j: int) -> bool:
        """Whether sphere i has once overlapped the solid of ball j by no more than the sphere itself sticks out."""
        return bool(self._least[i, self.solid[j]] <= self._spare[i])

    def leave_out(self, i: int, j: int) -> None:
        """From now on sphere i need not keep out of the solid of ball j."""
        self.left_out.add((i, self.solid[j]))

    def _look_at_start(self) -> None:
        """Look, once and only where something is near, at what overlaps where a step begins."""
        if self._start is not None:
            pairs, _, _ = self._solids.near(self._start, self._needed + OVERSHOOT)
            self.left_out |= {(i, k) for i, k in pairs.tolist()}
            self._start = None

    def _numbered(self, k: int, centre: Array, radius: float) -> int:
        key = np.append(centre, k).tobytes()
        if key not in self._number:
            self._number[key] = len(self.centre)
            self.centre.append(centre)
            self.radius.append(radius)
            self.solid.append(k)
        return self._number[key]
