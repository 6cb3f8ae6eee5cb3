"""Whether free space is free: cuboids and polytopes against obstacles that they were not made for."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from itertools import product

import numpy as np

from workcell.errors import InputError
from workcell.geometry.free_space.ellipsoid import nearest_to_origin
from workcell.geometry.free_space.polytopes import solid_of
from workcell.geometry.separation import separations, support, support_point
from workcell.geometry.types import FreePolytope, FreeSpace, Piece, obstacle_name
from workcell.pose import Array

_DEEP = 1e-6
"""Metres by which solids must overlap before they are said to."""


def still_free(free_space: FreeSpace, obstacles: Sequence[Piece]) -> FreeSpace:
    """What of a free space is proved free of some obstacles too: the same object where that is all of it."""
    if not len(obstacles) or not (len(free_space) or free_space.polytopes):
        return free_space
    apart = separations(free_space.lower, free_space.upper, obstacles)[0]
    margin = apart.min(axis=1)
    free = margin >= 0.0
    polytopes = tuple(p for p in free_space.polytopes if min(_apart(p, obstacles)) >= 0.0)
    if free.all() and len(polytopes) == len(free_space.polytopes):
        return free_space
    known = np.full(len(free), np.inf) if free_space.margin is None else free_space.margin
    return replace(
        free_space,
        lower=free_space.lower[free],
        upper=free_space.upper[free],
        margin=np.minimum(known, margin)[free],
        polytopes=polytopes,
        admissible=None,
    )


def check_free(free_space: FreeSpace, obstacles: Sequence[Piece], where: str = "free_space") -> None:
    """Refuses free space that is not free of the obstacles, such as that of another scene.

    Raises:
        InputError: a cuboid or polytope overlaps an obstacle.
    """
    found = _overlap(free_space, obstacles)
    if found is not None:
        raise InputError(
            f"{found[0]} overlaps the obstacle {obstacle_name(found[1])!r}: this free space is of another scene",
            where=where,
            remedy="make it for these obstacles (workcell.geometry.free_space.cuboids.inflate_cuboids, or a "
            "PlanningWorld of this scene)",
        )


def _overlap(free_space: FreeSpace, obstacles: Sequence[Piece]) -> tuple[str, Piece] | None:
    """The first solid and obstacle that share a ball of `_DEEP`, about; None: there are none."""
    if not len(obstacles):
        return None
    apart = separations(free_space.lower, free_space.upper, obstacles)[0]
    for k, p in np.argwhere(apart < -_DEEP).tolist():
        lower, upper = free_space.lower[k], free_space.upper[k]
        corners = np.array(list(product(*zip(lower, upper, strict=True))))
        if _meets(corners, obstacles[p]):
            return f"cuboid {k}", obstacles[p]
    for k, polytope in enumerate(free_space.polytopes):
        apart = _apart(polytope, obstacles)
        for p in np.flatnonzero(apart < -_DEEP).tolist():
            if _meets(solid_of(polytope).vertices, obstacles[p]):
                return f"polytope {k}", obstacles[p]
    return None


def _apart(polytope: FreePolytope, obstacles: Sequence[Piece]) -> Array:
    """(p,) metres by which one of the polytope's own planes keeps each obstacle out; negative: none does."""
    return np.array([np.max(-support(piece, -polytope.A) - polytope.b) for piece in obstacles])


def _meets(corners: Array, piece: Piece) -> bool:
    """Whether the hull of corners (c, 3) meets a piece: whether their difference holds the origin."""
    if piece.kind == "halfspace":
        return bool(np.min((corners - piece.pose.position) @ piece.pose.rotation[:, 2]) < -_DEEP)

    def farthest(direction: Array) -> Array:
        point: Array = support_point(piece, direction) - corners[np.argmin(corners @ direction)]
        return point

    nearest = nearest_to_origin(farthest, piece.pose.position - corners.mean(axis=0))
    return float(np.linalg.norm(nearest)) < _DEEP
