"""Local covers hold every point of the piece, with balls that stick out no more than asked."""

from __future__ import annotations

import numpy as np
import pytest

from workcell.errors import InputError
from workcell.geometry.covers.local_cover import LocalCover
from workcell.geometry.obstacle_arrays import ObstacleArrays
from workcell.geometry.types import Piece
from workcell.pose import Pose

POSE = Pose(np.array([0.3, -0.2, 0.5]), np.array([0.8, 0.6, 0.0, 0.0]))
CORNERS = np.random.default_rng(3).normal(size=(20, 3)) * 0.1
PIECES = [
    Piece("board", "box", POSE, np.array([0.5, 0.4, 0.02])),
    Piece("block", "box", POSE, np.array([0.2, 0.3, 0.25])),
    Piece("drum", "cylinder", POSE, np.array([0.1, 0.2])),
    Piece("rod", "capsule", POSE, np.array([0.03, 0.3])),
    Piece("egg", "ellipsoid", POSE, np.array([0.2, 0.1, 0.05])),
    Piece("stone", "hull", POSE, np.zeros(0), CORNERS),
]


@pytest.mark.parametrize("overshoot", [1e-3, 2e-2])
@pytest.mark.parametrize("piece", PIECES, ids=lambda piece: piece.name)
def test_every_point_of_the_piece_is_in_its_ball(piece: Piece, overshoot: float) -> None:
    shape = ObstacleArrays([piece])
    spread = POSE.position + np.random.default_rng(0).uniform(-0.6, 0.6, (4000, 3))
    distance, outwards, _ = shape.nearest(spread)
    inside, surface = spread[distance < 0], spread - distance[:, None] * outwards
    points = np.vstack([inside, surface[shape.nearest(surface)[0] < 1e-9]])
    assert len(points) > 1000
    centres, radii = LocalCover(piece, overshoot).holding(points)
    assert np.all(np.linalg.norm(points - centres, axis=1) <= radii)
    assert np.all(shape.nearest(centres)[0] + radii <= overshoot)


def test_points_of_one_cell_share_its_ball() -> None:
    """The cover is finite, and the same whoever asks: together or one by one."""
    points = POSE.apply(np.random.default_rng(1).uniform(-1, 1, (500, 3)) * [0.5, 0.4, 0.02])
    cover = LocalCover(PIECES[0], 0.05)
    centres, radii = cover.holding(points)
    assert len(np.unique(centres.round(12), axis=0)) < 200
    alone = [cover.holding(point[None]) for point in points[:50]]
    assert np.array_equal(centres[:50], np.vstack([centre for centre, _ in alone]))
    assert np.array_equal(radii[:50], np.concatenate([radius for _, radius in alone]))


def test_bad_input() -> None:
    with pytest.raises(InputError, match="half-space"):
        LocalCover(Piece("floor", "halfspace", POSE, np.zeros(0)), 1e-3)
    with pytest.raises(InputError, match="overshoot"):
        LocalCover(PIECES[0], 0.0)
