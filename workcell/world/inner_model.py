"""A scene's model from inside: what is impossible for it is impossible for the real geometry.

Spheres inside the robot's links, and convex pieces that are the obstacles themselves. A sphere in a piece is real
only if MuJoCo collides the two geoms they belong to, so obstacles that it doesn't collide with every one of the
links' geoms (contype, conaffinity, excludes, intended contacts) are left out: that can only make the model easier to
satisfy.
"""

from __future__ import annotations

import functools
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from workcell.geometry.covers.cache import cached_cover
from workcell.geometry.covers.inner import inscribed_balls
from workcell.geometry.obstacle_arrays import ObstacleArrays
from workcell.geometry.pieces import robot_pieces
from workcell.geometry.types import Piece, SphereCover
from workcell.identity_cache import ByIdentity
from workcell.model.collision_model import CollisionModel
from workcell.model.scene import Scene
from workcell.model.scene_parts import SceneRobot
from workcell.pose import Array

SHARE = 0.9
"""Of each link's volume that spheres are to fill."""


@dataclass(frozen=True, slots=True)
class InnerModel:
    """Spheres inside the robot, the obstacles that all of them collide with, and pairs of spheres that collide."""

    cover: SphereCover
    obstacles: tuple[Piece, ...]
    self_pairs: NDArray[np.int64]


_covers = ByIdentity()


def inner_model(
    scene: Scene, robot: SceneRobot, obstacles: tuple[Piece, ...], collision: CollisionModel
) -> InnerModel:
    """The inner model of a robot among obstacles, whose geom pairs `collision` lists.

    What the hand carries is left out.
    """
    cover, owner = _covers.get((scene.model, robot), lambda: _moving_cover(scene, robot))
    collides = {frozenset(pair) for pair in collision.pair_geoms.tolist()}
    owners, fields = sorted(set(owner)), _height_fields(scene)
    kept = tuple(
        piece
        for piece in obstacles
        if piece.geom not in fields and all(frozenset((one, piece.geom)) in collides for one in owners)
    )
    return InnerModel(cover, kept, _self_pairs(cover, owner, collides))


def _height_fields(scene: Scene) -> set[int]:
    """Ids of the height fields, whose many prisms no solver of inner models is asked about."""
    import mujoco

    return set(np.flatnonzero(scene.model.geom_type == mujoco.mjtGeom.mjGEOM_HFIELD).tolist())


def _moving_cover(scene: Scene, robot: SceneRobot) -> tuple[SphereCover, tuple[int, ...]]:
    """Spheres inside the links that joints move, and the geom that each is in; each link's made once, kept on disk.

    On the tool's link every piece is filled by itself: thin fingers go where the target is.
    """
    tool = robot.robot.tool().link
    parts: list[tuple[int, Array, Array, list[Piece]]] = []
    for link, pieces in enumerate(robot_pieces(scene.model, robot)):
        if link == 0 or not pieces:
            continue
        each = link == tool
        make, purpose = functools.partial(_fill, pieces, each), "inner, each piece" if each else "inner"
        centre, radius, _ = cached_cover(pieces, SHARE, make, purpose)
        owner = ObstacleArrays(pieces).nearest(centre)[2]
        parts.append((link, centre, radius, [pieces[int(k)] for k in owner]))
    inside = [piece for part in parts for piece in part[3]]
    cover = SphereCover(
        np.repeat([part[0] for part in parts], [len(part[2]) for part in parts]),
        np.concatenate([np.zeros((0, 3)), *(part[1] for part in parts)]),
        np.concatenate([np.zeros(0), *(part[2] for part in parts)]),
        "inner",
        source=tuple(piece.name for piece in inside),
    )
    return cover, tuple(piece.geom for piece in inside)


def _fill(pieces: tuple[Piece, ...], each: bool) -> tuple[Array, Array, Array]:
    groups = [(piece,) for piece in pieces] if each else [pieces]
    balls = [inscribed_balls(group, share=SHARE) for group in groups]
    radius = np.concatenate([part.radius for part in balls])
    return np.concatenate([part.centre for part in balls]), radius, np.zeros(len(radius))


def _self_pairs(
    cover: SphereCover, geoms: tuple[int, ...], collides: set[frozenset[int]]
) -> NDArray[np.int64]:
    """Pairs of spheres on different links whose geoms MuJoCo collides."""
    first, second = np.triu_indices(len(cover), 1)
    apart = cover.link[first] != cover.link[second]
    real = [frozenset((geoms[a], geoms[b])) in collides for a, b in zip(first, second, strict=True)]
    kept = apart & np.array(real, dtype=bool)
    return np.stack([first[kept], second[kept]], axis=1)
