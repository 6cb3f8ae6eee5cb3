import numpy as np
import pytest

from tests.geometry.shapes import BOUNDED, random_piece
from workcell.errors import InputError
from workcell.geometry.covers.inner import inner_obstacle_cover, inscribed_balls, volume_samples
from workcell.geometry.covers.outer import model_cover, obstacle_cover, robot_cover
from workcell.geometry.covers.reach_ball import ReachBall
from workcell.geometry.pieces import robot_pieces
from workcell.geometry.separation import support
from workcell.geometry.types import Piece
from workcell.model.loading.load import load_compiled
from workcell.model.scene import Scene
from workcell.pose import Pose


def directions(count):
    found = np.random.default_rng(3).normal(size=(count, 3))
    return found / np.linalg.norm(found, axis=1, keepdims=True)


def inside_by_support(piece, centres, radii):
    """A ball lies in a convex set just when no direction has it reach further: independent of any distance."""
    n = directions(4000)
    return all(np.all(n @ c + r <= support(piece, n)) for c, r in zip(centres, radii, strict=True))


@pytest.mark.parametrize("kind", BOUNDED)
def test_balls_lie_inside_the_piece_and_fill_most_of_it(kind):
    piece = random_piece(np.random.default_rng(2), kind, small=0.05, large=0.08)
    balls = inscribed_balls([piece], count=20)
    assert 0 < len(balls.radius) <= 20
    assert inside_by_support(piece, balls.centre, balls.radius)
    assert np.all(np.diff(balls.gain) <= 1e-12)
    assert 0.6 < balls.gain.sum() / balls.volume <= 1.0


def test_a_ball_is_filled_by_itself():
    ball = Piece("ball", "sphere", Pose.from_xyz([1, 2, 3]), np.array([0.2]))
    balls = inscribed_balls([ball], count=1)
    assert balls.radius[0] == pytest.approx(0.2, abs=2e-3)
    assert np.linalg.norm(balls.centre[0] - [1, 2, 3]) + balls.radius[0] <= 0.2
    assert balls.volume == pytest.approx(4 / 3 * np.pi * 0.2**3, rel=0.02)


def test_volume_of_a_union_counts_what_pieces_share_once():
    boxes = [Piece(str(x), "box", Pose.from_xyz([x, 0, 0]), np.array([0.1, 0.1, 0.1])) for x in (0.0, 0.1)]
    points, each = volume_samples(boxes)
    assert len(points) * each == pytest.approx(0.3 * 0.2 * 0.2, rel=0.02)


def test_a_share_is_reached_with_fewer_balls_than_a_larger_one():
    capsule = Piece("arm", "capsule", Pose.identity(), np.array([0.05, 0.3]))
    few, many = (inscribed_balls([capsule], share=share) for share in (0.5, 0.85))
    assert len(few.radius) < len(many.radius)
    assert few.gain.sum() / few.volume >= 0.5 and many.gain.sum() / many.volume >= 0.85


@pytest.mark.parametrize("count", [5, 10])
def test_robot_spheres_lie_in_one_piece_of_their_link(count):
    scene = Scene.load("shelf_grasp")
    robot = scene.robot()
    cover = robot_cover(scene.model, robot, kind="inner", count=count)
    assert cover.kind == "inner" and len(cover) == count and not cover.overshoot.any()
    links = robot_pieces(scene.model, robot)
    for link, centre, radius, name in zip(cover.link, cover.centre, cover.radius, cover.source, strict=True):
        (piece,) = [piece for piece in links[link] if piece.name == name]
        assert link > 0 and inside_by_support(piece, centre[None], [radius])


def test_the_base_is_filled_where_wanted():
    model, robot = load_compiled("sawyer")[:2]
    assert model_cover(model, robot, kind="inner", count=3).link.min() == 1
    assert model_cover(model, robot, kind="inner", count=3, base=True).link.min() == 0


def test_obstacles_are_filled_piece_by_piece_and_where_the_robot_reaches():
    floor = Piece("floor", "halfspace", Pose.identity(), np.zeros(0))
    wall = Piece("wall", "box", Pose.from_xyz([0, 0, 1]), np.array([0.05, 3.0, 1.0]))
    cover = inner_obstacle_cover([floor, wall], count=9)
    assert set(cover.source) == {"wall"} and len(cover) == 9
    near = obstacle_cover([floor, wall], kind="inner", count=9, reach=ReachBall(np.array([0, 0, 1.0]), 1.1))
    assert set(near.source) == {"floor", "wall"} and near.link.max() == 0
    for centre, radius, name in zip(near.centre, near.radius, near.source, strict=True):
        if name == "floor":
            assert centre[2] + radius <= 0
        else:
            assert inside_by_support(wall, centre[None], [radius])


def test_nothing_has_no_spheres():
    assert len(inner_obstacle_cover([])) == 0


@pytest.mark.parametrize("budget", [{"count": 0}, {"count": 2.5}, {"share": 0.0}, {"share": 1.1}])
def test_a_budget_that_makes_no_sense_is_refused(budget):
    with pytest.raises(InputError, match="no sense"):
        inner_obstacle_cover([], **budget)


def test_an_unknown_kind_is_refused():
    model, robot = load_compiled("ur10")[:2]
    with pytest.raises(InputError, match=r"unknown kind.*outer or inner"):
        model_cover(model, robot, kind="given")
