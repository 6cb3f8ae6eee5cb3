import numpy as np
import pytest

from tests.geometry.shapes import points_inside, random_piece
from workcell.geometry.covers.outer import obstacle_cover, robot_cover
from workcell.geometry.covers.proof import prove_cover
from workcell.geometry.covers.reach_ball import ReachBall, part_in_reach, reach_ball
from workcell.geometry.covers.subdivision import cover_by_cells
from workcell.geometry.obstacle_arrays import ObstacleArrays
from workcell.geometry.types import Piece
from workcell.model.scene import Scene
from workcell.pose import Pose

TILTED = Pose(np.array([0.3, -0.2, 0.1]), np.array([0.8, 0.36, -0.48, 0.0]))


def ball_points(rng, ball, count):
    direction = rng.normal(size=(count, 3))
    direction /= np.linalg.norm(direction, axis=1, keepdims=True)
    return ball.centre + ball.radius * direction * rng.uniform(size=(count, 1)) ** (1 / 3)


def test_no_sphere_of_the_robot_leaves_the_ball():
    scene = Scene.load("shelf_grasp")
    actor = scene.robot()
    cover = robot_cover(scene.model, actor, overshoot=0.05)
    ball = reach_ball(actor.robot, cover)
    rng = np.random.default_rng(0)
    q = actor.robot.random_configuration(rng, 2000)
    centres = cover.centres_world(actor.robot.link_transforms(q))
    assert (np.linalg.norm(centres - ball.centre, axis=-1) + cover.radius).max() <= ball.radius + 1e-12


@pytest.mark.parametrize("kind", ["box", "halfspace"])
def test_the_part_in_reach_holds_all_that_the_ball_holds(kind):
    rng = np.random.default_rng(1)
    size = np.array([2.0, 0.02, 1.5]) if kind == "box" else np.zeros(0)
    piece = Piece("wall", kind, TILTED, size)
    ball = ReachBall(np.array([0.4, 0.1, 0.3]), 0.6)
    part = part_in_reach(piece, ball)
    assert part is not None and part.kind == "box" and part.name == "wall"
    points = ball_points(rng, ball, 20_000)
    points = points[ObstacleArrays([piece]).floor(points) <= 0]
    assert len(points) > 300
    assert ObstacleArrays([part]).floor(points).max() <= 1e-12
    assert part.size.max() <= ball.radius + 0.01
    cover = obstacle_cover([piece], overshoot=0.03, reach=ball)
    gaps = np.linalg.norm(points[:, None] - cover.centre, axis=2) - cover.radius
    assert gaps.min(axis=1).max() <= 0
    assert prove_cover([part], cover.centre, cover.radius) is None
    assert cover.overshoot.max() <= 0.03 + 1e-9 and set(cover.source) == {"wall"}
    outermost = cover.radius + ObstacleArrays([piece]).floor(cover.centre)
    np.testing.assert_allclose(np.maximum(outermost, 0), cover.overshoot, atol=1e-12)


def test_what_is_far_is_left_out_and_what_is_near_stays_whole():
    near = Piece("near", "box", Pose.from_xyz([0.2, 0, 0]), np.array([0.1, 0.1, 0.1]))
    far = Piece("far", "cylinder", Pose.from_xyz([3, 0, 0]), np.array([0.1, 0.1]))
    post = Piece("post", "cylinder", Pose.from_xyz([0.9, 0, 0]), np.array([0.1, 2.0]))
    ball = ReachBall(np.zeros(3), 1.0)
    assert part_in_reach(near, ball) is near and part_in_reach(post, ball) is post
    assert part_in_reach(far, ball) is None
    assert set(obstacle_cover([near, far, post], overshoot=0.05, reach=ball).source) == {"near", "post"}


def test_a_board_is_a_lattice_of_equal_balls():
    board = Piece("board", "box", TILTED, np.array([0.17, 0.4, 0.01]))
    centres, radii = cover_by_cells(board, 0.02)
    half = np.array([0.17, 0.4, 0.01])
    assert np.ptp(radii) < 1e-12
    local = TILTED.inverse().apply(centres)
    steps = [len(np.unique(np.round(column, 9))) for column in local.T]
    assert np.prod(steps) == len(radii)
    assert np.isclose(radii[0], np.linalg.norm(half / steps), atol=1e-3)
    assert prove_cover([board], centres, radii) is None
    assert prove_cover([board], centres, radii - 1e-3) is not None


def test_cylinders_are_cut_around_their_axis():
    rng = np.random.default_rng(2)
    for size in ([0.18, 0.31], [0.1, 0.04], [0.03, 0.5]):
        can = Piece("can", "cylinder", TILTED, np.array(size))
        centres, radii = cover_by_cells(can, 0.02)
        assert prove_cover([can], centres, radii) is None
        points = points_inside(rng, can, 10_000)
        gaps = np.linalg.norm(points[:, None] - centres, axis=2) - radii
        assert gaps.min(axis=1).max() <= 0
        assert (radii + ObstacleArrays([can]).floor(centres)).max() <= 0.02 + 1e-9


@pytest.mark.parametrize("kind", ["box", "cylinder", "hull", "capsule", "ellipsoid"])
def test_one_ball_less_is_caught(kind):
    rng = np.random.default_rng(3)
    piece = random_piece(rng, kind, small=0.05, large=0.15)
    centres, radii = cover_by_cells(piece, 0.02)
    assert prove_cover([piece], centres, radii) is None
    points = points_inside(rng, piece, 20_000)
    held = np.linalg.norm(points[:, None] - centres, axis=2) <= radii
    alone = np.flatnonzero((held & (held.sum(axis=1, keepdims=True) == 1)).any(axis=0))
    assert len(alone)
    for index in alone[:10]:
        assert prove_cover([piece], np.delete(centres, index, 0), np.delete(radii, index)) is not None
