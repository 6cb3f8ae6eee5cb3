"""Random convex pieces for the geometry tests, and independent views of them."""

from __future__ import annotations

import numpy as np

from workcell.geometry.pieces import hull_piece
from workcell.geometry.types import Piece
from workcell.pose import Array, Pose

BOUNDED = ("box", "sphere", "capsule", "cylinder", "ellipsoid", "hull")
_SIZES = {"box": 3, "sphere": 1, "capsule": 2, "cylinder": 2, "ellipsoid": 3}


def random_pose(rng: np.random.Generator, spread: float = 0.5) -> Pose:
    quat = rng.normal(size=4)
    return Pose(rng.uniform(-spread, spread, 3), quat / np.linalg.norm(quat))


def random_piece(
    rng: np.random.Generator, kind: str, *, small: float = 0.03, large: float = 0.2, spread: float = 0.5
) -> Piece:
    pose = random_pose(rng, spread)
    if kind == "hull":
        points = rng.normal(size=(16, 3))
        points *= rng.uniform(small, large, 3) / np.linalg.norm(points, axis=1, keepdims=True)
        return hull_piece(f"hull_{rng.integers(1e6)}", points, pose)
    if kind == "halfspace":
        return Piece("ground", "halfspace", pose, np.zeros(0))
    return Piece(f"{kind}_{rng.integers(1e6)}", kind, pose, rng.uniform(small, large, _SIZES[kind]))


def points_inside(rng: np.random.Generator, piece: Piece, count: int) -> Array:
    """Points (count, 3) of the piece, made from its definition and not from any distance; many on its surface."""
    size = piece.size
    shell = np.where(rng.uniform(size=count) < 0.5, 1.0, rng.uniform(size=count))
    direction = rng.normal(size=(count, 3))
    direction /= np.linalg.norm(direction, axis=1, keepdims=True)
    if piece.kind == "box":
        local = rng.uniform(-1, 1, (count, 3))
        axis = rng.integers(3, size=count)
        rows = np.arange(count)
        local[rows, axis] = np.where(shell == 1.0, np.sign(local[rows, axis]), local[rows, axis])
        local *= size
    elif piece.kind == "sphere":
        local = direction * (shell * size[0])[:, None]
    elif piece.kind == "ellipsoid":
        local = direction * shell[:, None] * size
    elif piece.kind == "capsule":
        local = direction * (shell * size[0])[:, None]
        local[:, 2] += rng.uniform(-1, 1, count) * size[1]
    elif piece.kind == "cylinder":
        angle, radius = rng.uniform(0, 2 * np.pi, count), size[0] * np.maximum(shell, rng.uniform(size=count))
        height = np.where(
            rng.uniform(size=count) < 0.3, np.sign(rng.normal(size=count)), rng.uniform(-1, 1, count)
        )
        local = np.column_stack([radius * np.cos(angle), radius * np.sin(angle), height * size[1]])
    else:
        assert piece.vertices is not None
        corners = piece.vertices[rng.integers(len(piece.vertices), size=(count, 4))]
        local = np.einsum("nk,nki->ni", rng.dirichlet(np.full(4, 0.5), count), corners)
    return piece.pose.apply(local)
